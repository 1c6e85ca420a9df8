# SPDX-License-Identifier: Apache-2.0
"""The simulated robot, what it touches, and whole drives through a small drawn place with every
fault."""

import csv
from dataclasses import replace

import cv2
import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.robot import load_robot
from fcsv_sim.errors import SimulationError
from fcsv_sim.robot.contact import TrueGround
from fcsv_sim.robot.drawn_watch import DrawnWatch, drawn_box
from fcsv_sim.robot.drive import WATCHDOG_S, SimulatedRobot, WheelFlaws
from fcsv_sim.robot.places import mapped
from fcsv_sim.robot.places.looking import Lookout
from fcsv_sim.robot.places.mapped import CELL_M, MappedPlace
from fcsv_sim.robot.rehearsal import command
from fcsv_sim.robot.rehearsal.faults import FAULTS, faults_of
from fcsv_sim.robot.rehearsal.free_ground import FreeGround, free_ground
from fcsv_sim.robot.rehearsal.one_drive import ARRIVES, SAYS_NONE, PlaceGuides, RobotDrive
from fcsv_sim.robot.rehearsal.picture import draw_drive
from fcsv_sim.robot.rehearsal.table import ground_table, table, verdict_line
from fcsv_sim.robot.things import Box, Watcher
from fcsv_sim.sensors.camera import CameraParameters
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.materials import CONCRETE
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.place import PlacePlan, Solid, draw_place
from fcsv_sim.world.town import Town
from fcsv_stereo.depth import pixels_of

AREA = (18.0, 36.0, -6.0, 6.0)
STEP_S = 0.05


@pytest.fixture(scope="module")
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


def town_of(gap_m):
    """A wall across the area with a gap at its left end, or none."""
    half = np.array([0.15, 0.5 * (12.0 - gap_m), 0.5])
    wall = Solid(np.array([27.0, -6.0 + half[1], 0.4]), half, np.eye(3), CONCRETE, (0.4, 0.4, 0.4))
    plan = PlacePlan(
        np.empty(0),
        np.empty(0),
        np.zeros(2),
        np.zeros(6),
        area_m=AREA,
        start_m=(21.0, -2.0),
        goal_m=(33.0, -2.0),
        solids=(wall,),
    )
    mesh, random = MeshBuilder(), np.random.default_rng(3)
    draw_place(mesh, plan, random)
    return Town(3, plan, *mesh.build())


def place_of(robot, gap_m):
    """Seen from two stations with the true depth and the noise of a pair's matches."""
    town = town_of(gap_m)
    footing = Footing.of(town.plan)
    clear = footing.clearance(robot)
    looked = Lookout(town, clear).first(2, 4)
    camera = CameraParameters().model
    grid = Grid.around(AREA[::2], AREA[1::2], CELL_M)
    views = []
    for number, station in enumerate(looked.stations):
        T_home_cam = transforms.from_xyz_yaw(station.xyz_m, station.yaw_rad)
        T_home_cam[:3, :3] = T_home_cam[:3, :3] @ transforms.R_FLU_OPTICAL
        nothing = np.zeros((camera.height, camera.width), np.float32)
        bare = DepthView(
            f"station {number}",
            nothing,
            nothing,
            nothing.astype(np.uint8),
            camera.K,
            T_home_cam,
            0.0,
        )
        true = np.where(Watcher(town, bare, 1)._true < 70.0, Watcher(town, bare, 1)._true, np.nan)
        sigma = (true**2 / (camera.fx * 6.0) * 0.1).astype(np.float32)
        depth = true + 0.3 * sigma * np.random.default_rng(number).standard_normal(true.shape)
        kind = np.where(np.isfinite(true), 2, 0).astype(np.uint8)
        views.append(replace(bare, depth=depth.astype(np.float32), sigma=sigma, kind=kind))
    grounds = tuple(ground_from([view], grid=grid) for view in views)
    return MappedPlace("maze", town, footing, clear, looked, tuple(views), grounds)


@pytest.fixture(scope="module")
def open_place(rescue):
    return place_of(rescue, 4.5)


@pytest.fixture(scope="module")
def guides(open_place, rescue):
    return PlaceGuides(open_place, rescue)


@pytest.fixture(scope="module")
def closed_place(rescue):
    return place_of(rescue, 0.0)


@pytest.mark.parametrize("fault", [name for name in FAULTS if name != "pose lost for good"])
def test_it_arrives_whatever_befalls_it_and_touches_nothing(open_place, guides, rescue, fault):
    drive = RobotDrive(open_place, rescue, FAULTS[fault], 5, guides=guides)
    result = drive.run()
    assert not result.broke and result.least_room_m > 0.1, result
    assert result.befell == (fault != "none") and result.expected in (ARRIVES, "either")
    assert result.ended == "arrived" or (
        fault == "way closes" and result.ended == "no safe route"
    ), result
    if fault in ("way closes", "runs at it"):
        assert result.reaction_s is not None and result.reaction_s <= 1.0


def test_without_its_place_for_good_it_stands(open_place, rescue):
    result = RobotDrive(open_place, rescue, FAULTS["pose lost for good"], 5).run()
    assert not result.broke and result.honest >= 0.95
    assert result.ended == "waiting" and result.text.startswith("the robot's place is")


def test_behind_a_closed_wall_it_says_that_there_is_no_route(closed_place, rescue):
    result = RobotDrive(closed_place, rescue, FAULTS["none"], 5).run()
    assert (result.ended, result.expected, result.broke) == (
        "no safe route",
        SAYS_NONE,
        "",
    ) and result.way_m == 0.0


def test_a_seed_is_a_drive_and_a_table_and_a_picture(open_place, guides, rescue, tmp_path):
    first, again = (
        RobotDrive(open_place, rescue, FAULTS["wheels slip"], 8, guides=laid)
        for laid in (None, guides)
    )
    a, b = first.run(), again.run()
    assert first.track.way == again.track.way and replace(a, slowest_s=0.0) == replace(
        b, slowest_s=0.0
    )
    assert RobotDrive(open_place, rescue, FAULTS["wheels slip"], 9).run().time_s != a.time_s
    draw_drive(open_place, first.track, a, tmp_path / "drive.png")
    assert (tmp_path / "drive.png").stat().st_size > 10_000
    lines = table([a, replace(a, fault="none", contact="touches a wall")])
    assert len({line.count("|") for line in lines}) == 1 and "| 1 of 1 |" in lines[2]
    assert verdict_line([a]).startswith(
        "Verdict: nothing touched"
    ) and "1 of them by a contact" in verdict_line([a, replace(a, contact="touches a wall")])


def test_what_is_called_free_is_counted_against_the_truth(open_place, closed_place, rescue):
    """The maps of the open place over the truth of the closed one: where its gap is, ground and
    wall are called free."""
    right = free_ground(open_place, rescue)
    assert right.not_free == right.missed == 0 and right.obstacles > 200
    assert right.called_free == right.found > 0.5 * right.free > 2000
    wrong = free_ground(replace(closed_place, grounds=open_place.grounds), rescue)
    # of the gap of 4.5 m the robot's middle can be in 3.4 m
    assert 0.0 < wrong.missed < wrong.not_free < 3.4 * 1.8 / CELL_M**2
    assert wrong.called_free == right.called_free == wrong.found + wrong.not_free


def test_the_ground_of_a_world_is_a_line():
    counts = [FreeGround("maze", n, 300, 200, 201, 1, 40, 0) for n in (1, 2)]
    _, _, maze, rubble = ground_table([*counts, FreeGround("rubble", 1, 9, 0, 0, 0, 0, 0)])
    assert (
        maze == "| maze | 2 | 0.498% | 0.000% | 66.7% |"
        and rubble == "| rubble | 1 | – | – | 0.0% |"
    )


def test_a_robot_that_believes_wrong_maps_touches_the_wall_and_it_is_seen(
    closed_place, open_place, rescue
):
    """The maps of the open place over the truth of the closed one: the rehearsal must find the
    contact."""
    wrong = replace(closed_place, views=open_place.views, grounds=open_place.grounds)
    drive = RobotDrive(wrong, rescue, FAULTS["none"], 5)
    result = drive.run()
    assert result.ended == "contact" and "touches the ground's obstacle" in result.broke
    assert abs(drive.track.contact[0] - 27.0) < 1.0


def test_wheels_report_what_they_believe_and_the_truth_differs(rescue):
    robot = SimulatedRobot(
        rescue, (0.0, 0.0, 0.0), WheelFlaws(left_scale=1.05, right_scale=1.05), 1
    )
    speeds = []
    for k in range(200):
        robot.command(k * STEP_S, DriveCommand(2.0, 0.0))  # faster than it can
        robot.step((k + 1) * STEP_S)
        speeds.append(robot.speed_mps)
    reported = robot.odometry()
    assert robot.x_m == pytest.approx(1.05 * reported.x_m, rel=0.01) and robot.y_m == pytest.approx(
        0.0, abs=1e-6
    )
    assert max(speeds) == pytest.approx(rescue.speed_mps)
    assert np.diff(speeds).max() <= rescue.acceleration_mps2 * STEP_S + 1e-9


def test_its_watchdog_ends_a_command_that_is_not_repeated(rescue):
    robot = SimulatedRobot(rescue, (0.0, 0.0, 0.0), WheelFlaws(), 1)
    for k in range(60):
        robot.command(k * STEP_S, DriveCommand(0.8, 0.0))
        robot.step((k + 1) * STEP_S)
    last_s, x_m = 59 * STEP_S, robot.x_m
    robot.step(last_s + WATCHDOG_S - 0.02)
    assert not robot.watchdog_ended and robot.speed_mps == pytest.approx(0.8)
    robot.command(robot.now_s, DriveCommand(np.nan, 0.0))  # is none
    robot.step(last_s + WATCHDOG_S + 0.8 / 0.6 + 0.1)
    assert robot.watchdog_ended and robot.stands and robot.x_m - x_m < 0.8 * 0.35 + 0.8**2 / 1.2


def test_slip_turns_the_wheels_and_not_the_robot(rescue):
    robot = SimulatedRobot(
        rescue, (0.0, 0.0, 0.0), WheelFlaws(), 1, lambda now_s, x, y: now_s > 2.0
    )
    for k in range(100):
        robot.command(k * STEP_S, DriveCommand(0.5, 0.0))
        robot.step((k + 1) * STEP_S)
    assert robot.odometry().x_m > 2.0 and robot.x_m < 1.0


def test_room_and_stand_on_the_true_ground(open_place, rescue):
    true = TrueGround(open_place.footing, open_place.clear)
    assert true.room_m(27.0 - 0.15 - 0.4 - 0.3, -2.0) == pytest.approx(0.3, abs=0.05)
    assert true.room_m(26.5, -2.0) < 0.0
    T = true.T_world_robot(21.0, -2.0, 0.7)
    assert transforms.yaw(T) == pytest.approx(0.7) and T[2, 3] == pytest.approx(0.0, abs=0.02)
    transforms.require_rigid(T, "T_world_robot")


def test_a_watch_shows_a_box_where_nothing_hides_it(open_place):
    watcher = Watcher(open_place.town, open_place.views[0], 1)
    box = Box(23.0, 1.0, 0.0, (0.4, 0.4), 1.2)
    before, after = open_place.views[0].depth, watcher.look(3.0, [box])
    nearer = after.depth < before - 0.3
    assert after.stamp_s == 3.0 and nearer.sum() > 50
    assert box.gap_m(23.9, 1.0) == pytest.approx(0.5) and box.gap_m(23.0, 1.0) < 0


def test_a_watch_blurs_edges_and_not_what_is_even(open_place):
    """As live matching does (docs/lab/guidance.md)."""
    watcher = Watcher(open_place.town, open_place.views[0], 1)
    box = Box(30.0, 1.0, 0.0, (0.4, 2.0), 2.5)
    hit, around = watcher._hit(box), np.ones((9, 9), np.uint8)
    true = (hit < watcher._true).astype(np.uint8)
    inside, beside = cv2.erode(true, around) > 0, cv2.dilate(true, around) - true > 0
    wrong = []
    for stamp_s in range(10):
        view = watcher.look(float(stamp_s), [box])
        known = (view.kind > 0) & np.isfinite(view.depth)
        if known[inside].mean() < 0.5:
            continue  # one in ten misses it
        off_px = 3600 * np.abs(1.0 / view.depth - 1.0 / np.where(true, hit, watcher._true))
        assert np.median(off_px[known & inside]) < 6.0
        wrong.append((off_px[known & beside] > 6.0).mean())
    assert 0.02 < np.mean(wrong) < 0.5


def test_a_drawn_watch_matches_a_box_that_came(open_place):
    """By its pictures: to 3 % of its distance, where the truth has it."""
    box = Box(24.0, -2.0, 0.0, (0.3, 0.9), 1.2)
    watch = DrawnWatch(open_place.town, open_place.looked.stations[0], 1)
    bare, shown = watch.look(1.0, []), watch.look(2.0, [drawn_box(box)])
    side_m = np.array([[24.0 - 0.3, -2.0, 0.6]])
    (row,), (column,), z_m, _ = pixels_of(shown.camera, shown.T_home_cam, side_m)
    assert shown.kind[row, column] > 0 and bare.kind[row, column] > 0
    assert shown.depth[row, column] == pytest.approx(z_m[0], rel=0.03)
    assert bare.depth[row, column] > shown.depth[row, column] + 0.5
    assert shown.stamp_s == 2.0


def test_stations_see_the_way(open_place):
    plan = open_place.town.plan
    assert open_place.looked.leads(open_place.clear, plan.start_m, plan.goal_m, 0.3)
    closed = np.ones(open_place.looked.grid.shape, bool)
    assert not open_place.looked.leads(open_place.clear, plan.start_m, plan.goal_m, 0.3, closed)


def test_wrong_arguments_are_refused(capsys):
    assert (
        command.main(["--mazes", "0"]) == 2 and "one of them 1 or more" in capsys.readouterr().err
    )
    assert command.main(["--faults", "storm", "--robot", "none.yaml"]) == 2
    with pytest.raises(SimulationError, match="'storm' is none of all, none"):
        faults_of("none,storm")


def test_a_place_that_was_just_mapped_has_the_views_that_are_read_later(
    open_place, rescue, tmp_path, monkeypatch
):
    """Each with a name of its own: of views with one name guidance takes the last."""
    views = iter(replace(v, name="station 0") for v in open_place.views)
    monkeypatch.setattr(mapped.Town, "generate", lambda *_: open_place.town)
    monkeypatch.setattr(mapped, "survey", lambda *_: [next(views)])
    plan = mapped.SurveyPlan(least=2, most=len(open_place.views), more=0)
    first, again = (
        mapped.mapped_place("maze", 3, rescue, tmp_path, survey_plan=plan) for _ in range(2)
    )
    assert len({v.name for v in first.views}) == len(first.views) > 1
    assert [v.name for v in first.views] == [v.name for v in again.views]


def test_the_command_says_what_broke(
    open_place, closed_place, rescue, root, tmp_path, monkeypatch, capsys
):
    """The same command over places that were mapped before: status 0, and 1 where a robot touches
    something."""
    places = {
        1: open_place,
        2: replace(closed_place, views=open_place.views, grounds=open_place.grounds),
    }
    monkeypatch.setattr(command, "mapped_place", lambda world, seed, robot, folder: places[seed])
    given = [
        "--robot",
        str(root / "config/robots/rescue.yaml"),
        "--faults",
        "none",
        "-o",
        str(tmp_path),
    ]
    assert command.main([*given, "--seed", "1"]) == 0
    out = capsys.readouterr().out
    assert (
        "places to look from" in out
        and "Verdict: nothing touched and nothing untrue said in 1 drives; 1 of 1 arrived" in out
    )
    assert command.main([*given, "--seed", "2"]) == 1
    out = capsys.readouterr().out
    assert "--mazes 1 --seed 3 --faults 'none'" in out and (tmp_path / "maze-3-none.png").is_file()
    (drive,) = csv.DictReader((tmp_path / "drives.csv").open())
    assert (drive["seed"], drive["fault"], drive["ended"]) == ("3", "none", "contact")
    assert drive["broke"] and drive["broke"] in out
    (place,) = csv.DictReader((tmp_path / "places.csv").open())
    assert place["seed"] == "3" and int(place["not_free"]) > 0
    share = int(place["not_free"]) / int(place["called_free"])
    assert f"| maze | 1 | {share:.3%} |" in out
