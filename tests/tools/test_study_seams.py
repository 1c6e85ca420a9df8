# SPDX-License-Identifier: Apache-2.0
"""The study's seams, on made-up depths."""

import subprocess
import sys

_CODE = """
import sys
sys.path.insert(0, sys.argv[1])
import doctest
import numpy as np
import seams
assert doctest.testmod(seams).attempted
truth = np.tile(np.linspace(90.0, 150.0, 600), (40, 1))
at = seams.near_ends(truth, [120.0])
trimmed = np.where(truth > 120.0, 1.2 * truth, truth)
hole = np.where(at, np.nan, truth)
print(*seams.at_seams(truth, truth, at), *seams.at_seams(trimmed, truth, at), seams.broken(trimmed, truth, ~at))
print(*seams.at_seams(hole, truth, at))
"""


def test_a_step_at_a_trim_point_and_a_hole_are_seen(root):
    done = subprocess.run(
        [sys.executable, "-c", _CODE, str(root / "tools/study")],
        capture_output=True,
        text=True,
        cwd=root,
    )
    values = [list(map(float, line.split())) for line in done.stdout.splitlines()]
    assert len(values) == 2, done.stderr
    assert values[0][:3] == [1.0, 1.0, 0.0] and values[0][3] == 1.0 and 0.4 < values[0][4] < 0.6
    assert 0.0 < values[0][5] < 0.01 and values[0][6] == 0.0  # one of some hundred neighbours
    assert values[1][:2] == [0.0, 0.0] and values[1][2] != values[1][2]
