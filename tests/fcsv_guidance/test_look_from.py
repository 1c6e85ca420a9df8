# SPDX-License-Identifier: Apache-2.0
"""Where to look from, where no safe route is known: a place that shows what lacks, as a mission."""

import errno
from dataclasses import replace

import numpy as np
import pytest

from fcsv_geometry.missions.mission import load_mission
from fcsv_guidance.errors import GroundError
from fcsv_guidance.files import stations
from fcsv_guidance.files.command import main
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route.look_from import look_from
from fcsv_guidance.route.search import NoRoute, Route, plan_route
from fcsv_stereo.survey.views.station import load_station

GRID = Grid.around((8, -8), (30, 8), 0.1)
WALL = (17.0, 17.5, -3.0, 3.0, 0.0, 1.5)  # hides what lies behind it from the camera at the origin
START_M, GOAL_M = (14.0, 0.0), (19.0, 0.0)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def view(scene):
    return scene([WALL]).view(noise=0.3)


def seen_from(found, scene, view):
    """The view of the same scene from the place that was found."""
    c, s = np.cos(found.yaw_rad), np.sin(found.yaw_rad)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    R_flu_optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    other = scene([WALL], tilt_rad=0.0, eye=found.p_home_cam)
    # Scene casts along x only: turn the world about the place
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn.T @ R_flu_optical, found.p_home_cam
    v, u = np.indices(view.depth.shape)
    K = view.K
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
    depth = other._cast(rays @ T[:3, :3].T).astype(np.float32)
    sigma = (0.0002 * depth**2).astype(np.float32)
    kind = np.where(np.isfinite(depth), 2, 0).astype(np.uint8)
    return replace(view, name="second", depth=depth, sigma=sigma, kind=kind, T_home_cam=T)


def test_the_place_shows_what_the_wall_hides_and_a_route_is_known_then(rescue, scene, view):
    ground = ground_from([view], grid=GRID)
    behind = np.array([GRID.cell_of(*GOAL_M)])
    found = look_from(ground, rescue, behind, view)
    assert found.sees > 0.95 and 8.0 <= found.above_m <= 18.0
    assert len(found.plan.baselines) >= 2 and found.farthest_m <= 60.0
    both = ground_from([view, seen_from(found, scene, view)], grid=GRID)
    assert isinstance(plan_route(both, rescue, START_M, GOAL_M), Route)


def test_cells_without_a_place_and_no_cells_are_told_apart(rescue, view):
    ground = ground_from([view], grid=GRID)
    with pytest.raises(GroundError, match="no cell would have to be seen"):
        look_from(ground, rescue, np.empty((0, 2), int), view)
    walled = replace(ground, high_m=np.full(GRID.shape, 90.0, np.float32))
    walled = replace(walled, height_m=np.where(np.isfinite(ground.height_m), ground.height_m, 0.0))
    assert look_from(walled, rescue, np.array([GRID.cell_of(*GOAL_M)]), view) is None


def test_the_command_writes_a_mission_that_the_operator_can_fly(
    rescue, view, write_map, root, tmp_path, capsys
):
    write_map(view, tmp_path / "map")
    robot = ["--robot", str(root / "config/robots/rescue.yaml")]
    words = [str(tmp_path / "map"), *robot, "--route", *map(str, (*START_M, *GOAL_M))]
    assert main([*words, "-o", str(tmp_path / "a")]) == 2  # as ever
    assert "the goal (19.00, 0.00) m is not known" in capsys.readouterr().err
    mission = tmp_path / "look.yaml"
    assert main([*words, "-o", str(tmp_path / "b"), "--look-from", str(mission)]) == 1
    said = capsys.readouterr().out
    assert "cameras like the map's read the tags of rescue to 15 m" in said
    assert "look from (" in said and f"rosrun fcsv_control check {mission}" in said
    flown = load_mission(mission)
    assert flown.home_height_m >= 8.0 and len(flown.configurations) >= 2
    assert {c.axis for c in flown.configurations} == {"horizontal"}
    assert "Bring the reference there" in mission.read_text()
    flight, of_map = (load_stations(tmp_path, name) for name in ("look_station", "look_station_1"))
    assert f"cp {tmp_path}/look_station_1.yaml {tmp_path}/map/station.yaml" in said
    assert f"look from ({flight.place_m[0]:.1f}, {flight.place_m[1]:.1f}) m" in said
    assert of_map.place_m == pytest.approx(view.T_home_cam[:3, 3], abs=0.01)
    assert of_map.heading_deg == pytest.approx(0.0) and flight.place_sigma_m > of_map.place_sigma_m
    assert main([*words[:3], "-o", str(tmp_path / "c"), "--look-from", str(mission)]) == 2
    assert "give --route, too" in capsys.readouterr().err


def load_stations(folder, name):
    """The station that survey reads of a file."""
    into = folder / f"{name}_input"
    into.mkdir()
    (folder / f"{name}.yaml").rename(into / "station.yaml")
    return load_station(into)


def test_no_route_names_cells_that_a_place_can_show(rescue, scene):
    view = scene(blank=[(15, 17, -30, 30)]).view(noise=0.3)
    ground = ground_from([view], grid=GRID)
    none = plan_route(ground, rescue, (12.0, 0.0), (20.0, 0.0))
    assert isinstance(none, NoRoute)
    found = look_from(ground, rescue, none.to_see, view)
    assert found.sees > 0.95


@pytest.fixture
def no_route(view, write_map, root, tmp_path):
    """Words of the command that asks for a route that is not known, without -o."""
    write_map(view, tmp_path / "map")
    robot = ["--robot", str(root / "config/robots/rescue.yaml")]
    return [str(tmp_path / "map"), *robot, "--route", *map(str, (*START_M, *GOAL_M))]


@pytest.mark.parametrize("there", ["look.yaml", "look_station.yaml", "look_station_1.yaml"])
def test_no_file_is_overwritten(no_route, tmp_path, capsys, there):
    """It replaced the robot's own file."""
    (tmp_path / there).write_text("precious: 1\n")
    words = [*no_route, "-o", str(tmp_path / "out"), "--look-from", str(tmp_path / "look.yaml")]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert f"would overwrite {tmp_path / there}; name another file" in said
    assert (tmp_path / there).read_text() == "precious: 1\n"
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(["map", there])


@pytest.mark.parametrize(
    "mission, words",
    [
        ("out/look.yaml", "lies in the folder of -o"),
        ("out", "lies in the folder of -o"),
        ("map", "is a folder; name a new file"),
        ("map/depth.npy/look.yaml", "a file stands there"),
    ],
)
def test_a_mission_lies_beside_the_folder(no_route, tmp_path, capsys, mission, words):
    assert (
        main([*no_route, "-o", str(tmp_path / "out"), "--look-from", str(tmp_path / mission)]) == 2
    )
    assert words in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["map"]


def test_a_full_disk_leaves_neither_folder_nor_mission(no_route, tmp_path, capsys, monkeypatch):
    def full(path, text):
        if "station_1" in path.name:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        path.write_text(text)

    monkeypatch.setattr(stations, "write_whole", full)
    mission = tmp_path / "look.yaml"
    assert main([*no_route, "-o", str(tmp_path / "out"), "--look-from", str(mission)]) == 2
    assert "the disk is full" in (said := capsys.readouterr().err) and "nothing was written" in said
    assert [p.name for p in tmp_path.iterdir()] == ["map"]
