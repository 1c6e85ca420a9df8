# SPDX-License-Identifier: Apache-2.0
"""Messages of guidance that do not mean what they should: each is refused with a sentence."""

import numpy as np
import pytest

from fcsv_guidance.errors import GroundError, RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.route.grid_regions import Region

pytestmark = pytest.mark.ros
PERCENTS = np.zeros((3, 4), np.int8)


def grid():
    from fcsv_guidance.ros import ground_messages

    return ground_messages.grid_message(Grid(1.0, 2.0, 0.1, 3, 4), PERCENTS, 5.0, 6.0)


def test_a_grid_in_another_frame_turned_or_not_finite_is_refused():
    from fcsv_guidance.ros import ground_messages

    read, percents = ground_messages.grid_of(grid())
    assert read == Grid(1.0, 2.0, 0.1, 3, 4) and (percents == PERCENTS).all()
    wrong = grid()
    wrong.header.frame_id = "map"
    with pytest.raises(GroundError, match="a grid in frame 'map' is not in home"):
        ground_messages.grid_of(wrong)
    for axis in "xyzw":
        wrong = grid()
        setattr(wrong.info.origin.orientation, axis, np.nan)
        with pytest.raises(GroundError, match="orientation of a grid's origin is not finite"):
            ground_messages.grid_of(wrong)
    wrong = grid()
    wrong.info.origin.orientation.z = 0.7
    with pytest.raises(GroundError, match="turned against home"):
        ground_messages.grid_of(wrong)


def test_an_update_in_another_frame_is_refused():
    from fcsv_guidance.ros import ground_messages

    update = ground_messages.update_message(Region(1, 0, PERCENTS[:2]), 5.0)
    assert ground_messages.region_of(update).row == 1
    update.header.frame_id = "map"
    with pytest.raises(GroundError, match="an update of a grid in frame 'map' is not in home"):
        ground_messages.region_of(update)


def test_a_path_whose_poses_have_another_frame_is_refused():
    from fcsv_guidance.ros import ground_messages

    path = ground_messages.path_message(np.array([[0.0, 0.0], [1.0, 0.0]]), 5.0)
    for pose in path.poses:
        pose.header.frame_id = ""  # as the path
    assert ground_messages.route_of(path).shape == (6, 2)
    path.poses[3].header.frame_id = "map"
    with pytest.raises(RouteError, match="a path with a pose in frame 'map' is not in home"):
        ground_messages.route_of(path)
