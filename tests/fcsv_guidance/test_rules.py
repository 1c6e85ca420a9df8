# SPDX-License-Identifier: Apache-2.0
"""Numbers of the nodes' rules: one that no robot can be guided by is refused by its field's name."""

import numpy as np
import pytest

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.messages import ClearanceMap, RobotPlace
from fcsv_guidance.place.cooperative_place import CooperativeRules
from fcsv_guidance.place.steps import StepRules
from fcsv_guidance.place.tag_fix import TagFixRules
from fcsv_guidance.place.tracker import PlaceRules
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route.following import FollowerRules, RouteFollower, RouteToFollow
from fcsv_guidance.route.goal_giver import GivingRules
from fcsv_guidance.route.ground_server import GroundRules, GroundServer
from fcsv_guidance.route.planning import RouteRules

GRID = Grid(0.0, -5.0, 0.1, 100, 200)


@pytest.mark.parametrize(
    "rules, field, value",
    [
        (GroundRules, "cell_m", 0.0),
        (GroundRules, "reach_m", -1.0),
        (GroundRules, "replan_s", -1.0),
        (GroundRules, "still_s", -2.5),
        (GroundRules, "area_m", [5.0, 5.0, 0.0, 1.0]),
        (GroundRules, "area_m", [-1e300, 1e300, 0.0, 1.0]),
        (GroundRules, "area_m", [0.0, 1e6, 0.0, 1e6]),
        (RouteRules, "sigmas", -2.0),
        (RouteRules, "spare_m", -1.0),
        (RouteRules, "comfort_m", 0.0),
        (RouteRules, "comfort_cost", -5.0),
        (RouteRules, "goal_off_m", -1.0),
        (FollowerRules, "sigmas", -2.0),
        (FollowerRules, "oldest_place_s", 1e9),
        (FollowerRules, "oldest_map_s", -1.0),
        (FollowerRules, "look_ahead_m", 0.0),
        (GivingRules, "apart_m", 0.0),
        (GivingRules, "near_m", -1.0),
        (PlaceRules, "gate", 5.0),
        (PlaceRules, "distance_noise_m", -1.0),
        (PlaceRules, "common_share", 1.5),
        (PlaceRules, "to_begin", 0),
        (CooperativeRules, "gate", 1.0),
        (CooperativeRules, "drift_mps", -0.1),
        (StepRules, "grown_m", 0.0),
        (TagFixRules, "gate", 5.0),
    ],
)
def test_a_number_out_of_range_is_refused_by_its_name(rules, field, value):
    with pytest.raises(ConfigError, match=f"^/node: {field}: ") as caught:
        config.from_mapping({field: value}, rules, "/node")
    assert caught.value.field == field


@pytest.mark.parametrize("cell_m", [1e-300, 1e-9])
def test_a_grid_of_absurd_cells_is_refused(cell_m):
    with pytest.raises(GroundError, match="take .*cells|cannot be laid"):
        Grid.around((5.0, -8.0), (26.0, 8.0), cell_m)


def test_a_server_refuses_cells_in_which_an_obstacle_hides(root):
    """Cells of 50 m gave a route of 0 m through a wall."""
    small = load_robot(root / "config/robots/small.yaml")
    GroundServer(small, GroundRules(cell_m=0.15))
    with pytest.raises(GroundError, match="^cell_m: 0.16 m is above the radius of small, 0.15 m"):
        GroundServer(small, GroundRules(cell_m=0.16))


def test_a_follower_looks_no_farther_than_its_routes_end(root, monkeypatch):
    """A place that may be old made it look along 40 km, sample by sample."""
    follower = RouteFollower(
        load_robot(root / "config/robots/rescue.yaml"), FollowerRules(oldest_place_s=60.0)
    )
    follower.receive(0.0, ClearanceMap(0.0, GRID, np.full(GRID.shape, 3.0)))
    follower.receive(0.0, RouteToFollow(np.array([[1.0, 0.0], [9.0, 0.0]])))
    follower.receive(0.0, RobotPlace(0.0, 1.0, 0.0, 0.0, 0.02))
    looked_at, clear_m = [], follower._clear_m
    monkeypatch.setattr(
        follower, "_clear_m", lambda points: looked_at.append(len(points)) or clear_m(points)
    )
    (command,) = follower.step(0.1)
    assert command.speed_mps > 0 and max(looked_at) <= 8.0 / 0.05 + 3
