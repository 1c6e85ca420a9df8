# SPDX-License-Identifier: Apache-2.0
"""System I rehearsed: where two Tellos look from and hold, what gimbals tell of them, and a drive
through a small place by these gimbals; whole mazes: docs/lab/guidance.md."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.robot import load_robot
from fcsv_sim.robot.gimbals.rehearsal import gimbal_drive, gimbals_of_robot
from fcsv_sim.robot.gimbals.survey import GimbalSurvey, T_world_ground
from fcsv_sim.robot.places.looking import Lookout
from fcsv_sim.robot.places.mapped import MappedPlace
from fcsv_sim.robot.rehearsal import command
from fcsv_sim.robot.rehearsal.faults import FAULTS
from fcsv_sim.robot.things import Watcher
from fcsv_sim.trials.robot_among_vehicles import Held, HeldVehicle
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.materials import CONCRETE
from fcsv_sim.world.maze import build_small_maze, build_small_rubble
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.place import PlacePlan, Solid, draw_place
from fcsv_sim.world.town import Town

AREA = (1.4, 6.4, -2.2, 2.2)


@pytest.fixture(scope="module")
def small(root):
    return load_robot(root / "config/robots/small.yaml")


@pytest.fixture(scope="module")
def survey(root):
    vehicle = load_vehicles(root / "config/vehicles", ("tello1",))["tello1"]
    return GimbalSurvey(gimbals_of_robot(), vehicle.T_body_cam)


@pytest.fixture(scope="module")
def town():
    """A wall of 0.22 m across, with a gap at its left end."""
    half = np.array([0.05, 1.5, 0.16])
    wall = Solid(np.array([4.2, -0.7, 0.06]), half, np.eye(3), CONCRETE, (0.4, 0.4, 0.4))
    plan = PlacePlan(
        np.empty(0),
        np.empty(0),
        np.zeros(2),
        np.zeros(6),
        area_m=AREA,
        start_m=(3.4, 0.6),
        goal_m=(5.2, 1.0),
        solids=(wall,),
    )
    mesh = MeshBuilder()
    draw_place(mesh, plan, np.random.default_rng(3))
    return Town(3, plan, *mesh.build())


@pytest.fixture(scope="module")
def place(town, survey, small):
    """Seen from two stations with the true depth, noise of matches, and the poses of gimbals."""
    footing, rules = Footing.of(town.plan), survey.plan()
    clear = footing.clearance(small)
    stations = survey.candidates(town.plan)[::9]
    looked = Lookout(town, clear, rules.look, stations).first(2, 4)
    camera = replace(rules.look.survey.camera, distortion=(0.0,) * 5).model
    grid = Grid.around(AREA[::2], AREA[1::2], rules.cell_m)
    views = []
    for number, station in enumerate(looked.stations):
        T_true = station.T_world_body @ survey.T_body_cam
        nothing = np.zeros((camera.height, camera.width), np.float32)
        kind = nothing.astype(np.uint8)
        bare = DepthView(f"station {number}", nothing, nothing, kind, camera.K, T_true, 0.0)
        true = np.where(Watcher(town, bare, 1)._true < 12.0, Watcher(town, bare, 1)._true, np.nan)
        sigma = (true**2 / (camera.fx * 1.4) * 0.1).astype(np.float32)
        noise = np.random.default_rng(number).standard_normal(true.shape)
        depth = (true + 0.3 * sigma * noise).astype(np.float32)
        kind = np.where(np.isfinite(true), 2, 0).astype(np.uint8)
        T = survey.tracked(town.plan, 300 + number)(0, T_true)
        views.append(replace(bare, depth=depth, sigma=sigma, kind=kind, T_home_cam=T))
    grounds = tuple(ground_from([view], grid=grid) for view in views)
    return MappedPlace("small_maze", town, footing, clear, looked, tuple(views), grounds)


def test_a_small_maze_is_as_system_one_needs_it():
    for seed in (1, 2):
        plan = build_small_maze(MeshBuilder(), np.random.default_rng([seed, 1]))
        tops = [solid.middle_m[2] + solid.half_m[2] for solid in plan.solids]
        assert 0.2 <= min(tops) and max(tops) <= 0.25
        x0, x1, y0, y1 = plan.area_m
        walls = np.concatenate([solid.corners_m[:, :2] for solid in plan.solids])
        assert 5.0 < np.ptp(walls[:, 1]) < 8.0 and x0 < walls[:, 0].min() < walls[:, 0].max() < x1
        assert y0 < plan.start_m[1] < y1


def test_low_things_lie_about_in_small_rubble_and_none_where_the_robot_stands():
    maze, plan = (
        build(MeshBuilder(), np.random.default_rng([3, 1]))
        for build in (build_small_maze, build_small_rubble)
    )
    things = plan.solids[len(maze.solids) :]
    above = [t.corners_m[:, 2].max() - plan.height(*t.middle_m[:2]) for t in things]
    assert len(things) == 40 and 0.01 < min(above) < 0.03 < 0.09 < max(above) < 0.16
    away = [np.hypot(*(t.middle_m[:2] - plan.start_m)) for t in things]
    assert min(away) > 0.5


def test_vehicles_look_from_where_their_gimbals_see_both(place, survey):
    x, y = place.town.plan.start_m
    for station in place.looked.stations:
        for right_m in (0.0, *survey.plan().look.survey.baselines_m):
            xyz = np.array(station.beside(right_m).xyz_m)
            assert np.linalg.norm(xyz - [x, y, 0.4]) < 4.5, "a robot's gimbal sees tags to 4.2 m"
    aside = np.array(place.looked.stations[0].beside(1.0).xyz_m) - place.looked.stations[0].xyz_m
    yaw = place.looked.stations[0].yaw_rad
    assert aside @ [np.sin(yaw), -np.cos(yaw), 0.0] == pytest.approx(1.0)


def test_gimbals_tell_where_a_camera_is_as_well_as_tags_do(place, survey):
    """Within 2 cm and 1.5 degrees, as single poses of the demo are (docs/lab/gimbal.md)."""
    for view, station in zip(place.views, place.looked.stations):
        off = transforms.invert(station.T_world_body @ survey.T_body_cam) @ view.T_home_cam
        assert 0.0 < np.linalg.norm(off[:3, 3]) < 0.02 + 4.0 * np.radians(0.3)
        assert 0.0 < np.degrees(transforms.rotation_angle(np.eye(3), off[:3, :3])) < 1.5
    T = T_world_ground(place.town.plan)
    assert transforms.yaw(T) == pytest.approx(np.pi, abs=1e-6) or transforms.yaw(
        T
    ) == pytest.approx(-np.pi, abs=1e-6)


def test_a_vehicle_flies_where_it_is_sent_as_far_as_its_odometry_knows():
    vehicle = HeldVehicle(Held(1.0, 2.0, 1.8, flow_bias_mps=0.0, gust_m=0.0), 20.0, 3, 0.0)
    before = vehicle.odometry("tello1", 5.0)
    T = vehicle.T_world_body(5.0)
    vehicle.fly(5.0, np.array([1.0, -0.5]), before.yaw_rad - transforms.yaw(T))
    after, moved = vehicle.odometry("tello1", 12.0), vehicle.T_world_body(12.0)[:3, 3] - T[:3, 3]
    said_m = np.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    # 0.01 m in a root second beside the way; a scale of 3 % (standard deviation)
    assert said_m == pytest.approx(np.hypot(1.0, 0.5), abs=0.1)
    assert moved == pytest.approx([1.0, -0.5, 0.0], abs=0.1) and moved[0] != 1.0
    half = vehicle.T_world_body(5.0 + 0.5 * np.hypot(1.0, 0.5) / 0.4)[:3, 3] - T[:3, 3]
    assert half == pytest.approx(0.5 * moved, abs=0.02), "at 0.4 m/s"


def test_it_drives_to_its_goal_by_its_gimbals(place, small):
    drive, holds = gimbal_drive(place, small, FAULTS["none"], 3, 60.0)
    assert holds is not None and holds.seen == 1.0
    result = drive.run(60.0)
    assert (result.ended, result.contact) == ("arrived", "") and result.least_room_m > 0.05, result
    assert result.time_s > 6.0, "the vehicles' drift is learnt while it stands"
    assert result.place_rms_m < 0.1 and result.honest > 0.9


@pytest.mark.parametrize(
    "given, words",
    [
        (["--small", "1", "--mazes", "1"], "--small has a robot of its own"),
        (["--small", "1", "--faults", "pose jumps"], "'pose jumps' does not befall"),
        (["--small", "-1"], "must be 0 or more"),
        (["--seed", "-3"], "--seed must be 0 or more, got -3"),
    ],
)
def test_wrong_arguments_of_small_mazes_are_refused(given, words, capsys):
    assert command.main(given) == 2
    assert words in capsys.readouterr().err
