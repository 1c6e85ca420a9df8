# SPDX-License-Identifier: Apache-2.0
"""What a better choice could gain: the nearest candidate, and where pixels lie."""

import bench_choice
import numpy as np
import pytest
from support import scenes

from fcsv_stereo.joint.views import grey, views


def test_the_candidate_nearest_to_truth_is_taken():
    """Of pixels with three, one and two candidates; by ratio, not by difference."""
    start, count = np.array([[0, 3, 4]]), np.array([[3, 1, 2]])
    values = np.float32([0.1, 0.05, 0.021, 0.3, 0.01, 0.04])
    choice = bench_choice._Choice(None, start, count, values, None)
    true_w = np.float32([[0.02, 0.1, 0.018]])
    assert choice.nearest(true_w)[0] == pytest.approx([0.021, 0.3, 0.01])
    assert list(choice.best_is_right(true_w)[0]) == [True, False, False]


def test_places_are_told_by_what_the_pairs_see():
    """A wall at 20 m, a smaller one at 12 m before it, another camera 3 m to the right: it does not see the left border
    and what the near wall hides, left of it."""
    poses = [scenes.camera_pose(p) for p in ([0, 0, 0], [0, -3.0, 0])]
    pictures = [scenes.picture(f"{i}", "uav1", 0.0, T) for i, T in enumerate(poses)]
    true = scenes.true_depth(poses[0])
    found = views(pictures[0], pictures[1:], 1.0, [grey(p) for p in pictures])
    where = bench_choice.places(found, (1.0 / true).astype(np.float32))
    shift_px = scenes.CAMERA.fx * 3.0 / 20.0
    assert where["outside of every other picture"][:, : int(shift_px) - 1].all()
    assert not where["outside of every other picture"][:, int(shift_px) + 2 :].any()
    edge = np.flatnonzero(true[120] < 15.0)[0]
    hidden = where["hidden from every pair"]
    assert hidden[100:140, edge - 20 : edge - 3].all() and not hidden[100:140, edge + 5 : edge + 40].any()
    assert where["within 3 px of a step"][120, edge - 2] and not where["within 3 px of a step"][120, edge + 20]
    assert where["elsewhere"].all() and not where["beyond 100 m"].any()
