# SPDX-License-Identifier: Apache-2.0
"""The mission around a robot whose gimbals follow two Tellos: where they look from, and on which
ways."""

import numpy as np
import pytest

from fcsv_control.mission.plans.plan_check import require_flyable
from fcsv_geometry import transforms
from fcsv_geometry.config import from_mapping, read_yaml
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME, mover_place
from fcsv_geometry.missions.mission import Mission, load_mission
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_guidance.robot import load_robot
from fcsv_sim.bringup import mission_file, robot_file, vehicles_folder
from fcsv_sim.demo.gimbal_guided import world_of
from fcsv_sim.errors import SimulationError
from fcsv_sim.machines.machines import MachineError
from fcsv_sim.robot.gimbals.mission import BESIDE_M, gimbal_mission
from fcsv_sim.robot.gimbals.rehearsal import SMALL, small_survey
from fcsv_sim.robot.gimbals.survey import T_world_level
from fcsv_sim.robot.gimbals.ways import GimbalWays
from fcsv_sim.world.town import Town
from fcsv_tracking.gimbal.reach import gimbal_problem

VEHICLES = load_vehicles(vehicles_folder(), ("tello1", "tello2"))
SURVEY = small_survey()
SEED = 1


@pytest.fixture(scope="module")
def made():
    base = mission_file("guidance")
    document = {**read_yaml(base), "follow_s": 90.0}
    town, robot = Town.generate(SEED, SMALL), load_robot(robot_file("small"))
    return town, gimbal_mission(town, robot, SURVEY, load_mission(base), document)


def test_the_mission_can_be_flown_and_ends_with_vehicles_that_follow(made, tmp_path):
    _, found = made
    (tmp_path / "mission.yaml").write_text(found.text())
    mission = load_mission(tmp_path / "mission.yaml")
    require_flyable(mission, tuple(VEHICLES), {n: v.radius_m for n, v in VEHICLES.items()})
    assert len(mission.stations) >= 4 and mission.stations[-1].name == "hold"
    assert mission.configurations[-1].follow_s == 90.0
    assert f"from {len(mission.stations) - 1} places" in found.words


def test_the_gimbals_see_both_vehicles_at_every_place_and_way(made):
    town, found = made
    mission = from_mapping(found.document, Mission, "guidance")
    T_world_ground = T_world_level(town.plan)
    x, y = found.reference_xy_m
    body = transforms.from_xyz_yaw([x, y, T_world_ground[2, 3] + mission.home_height_m], 0.0)
    lever = transforms.transform(np.eye(3), SURVEY.T_body_cam[:3, 3])
    T_ground_home = transforms.invert(T_world_ground) @ body @ lever
    for index, c in enumerate(mission.configurations):
        T_view_cam = mission.viewpoint(index).T_home_view
        mover = mover_place(mission, index) @ transforms.invert(T_HOME_CAM_AT_HOME)
        bodies = T_view_cam, mover
        for gimbal, T in zip(SURVEY.gimbals, bodies):
            problem = gimbal_problem(gimbal, T_ground_home @ T @ transforms.invert(lever))
            assert not problem, (c.title, problem)
    ways = GimbalWays(SURVEY, T_world_ground, BESIDE_M, mission.flight)
    T_world_home, at = body @ lever, body @ lever
    for viewpoint in mission.viewpoints[1:]:
        for T_home_view in viewpoint.T_home_ways:
            there = T_world_home @ T_home_view
            assert ways.keeps_sight(at, there), viewpoint.title
            at = there


def test_a_column_out_of_the_gimbals_sight_is_none():
    ways = GimbalWays(SURVEY, np.eye(4), BESIDE_M, load_mission(mission_file("guidance")).flight)
    ahead = transforms.from_xyz_yaw([2.6, 0.7, 1.8], 0.0)
    assert ways.sees(ahead)
    assert not ways.sees(transforms.from_xyz_yaw([9.0, 0.0, 1.8], 0.0)), "too far"
    assert not ways.sees(transforms.from_xyz_yaw([-2.6, 0.6, 1.8], 0.0)), "behind"
    through = transforms.from_xyz_yaw([-0.5, 3.2, 1.8], 0.0)
    assert not ways.keeps_sight(through, transforms.from_xyz_yaw([-0.5, -1.9, 1.8], 0.0))
    assert ways.ordered([ahead, transforms.from_xyz_yaw([9.0, 0.0, 1.8], 0.0)]) is None


def test_only_the_small_maze_is_driven_through():
    assert world_of("street", "street") == world_of(SMALL, "street") == SMALL
    with pytest.raises(MachineError, match="drives through small_maze"):
        world_of("rubble", "street")


def test_without_any_station_the_gimbals_say_so(made, monkeypatch):
    town, _ = made
    monkeypatch.setattr(GimbalWays, "ordered", lambda *_: None)
    base = mission_file("guidance")
    with pytest.raises(SimulationError, match="lose sight"):
        robot = load_robot(robot_file("small"))
        gimbal_mission(town, robot, SURVEY, load_mission(base), {"follow_s": 9.0})
