# SPDX-License-Identifier: Apache-2.0
"""Files of the ground, read back by map_server's rules and by a TIFF reader; the command that
writes them."""

import doctest
import json
import re

import cv2
import numpy as np
import pytest
import tifffile
import yaml

from fcsv_guidance.files import command
from fcsv_guidance.files.map_files import layers_of, write_layers, write_map_server
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import ground_from, stand_probability
from fcsv_guidance.ground.occupancy import FREE_PERCENT, OCCUPIED_PERCENT, occupancy
from fcsv_guidance.ground.standing import disk, least
from fcsv_guidance.ground.tuning import FREE_P
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route import search

GRID = Grid.around((5, -8), (26, 8), 0.1)
BOX = (13.0, 14.0, -2.0, 1.0, 0.0, 0.6)
ROBOT = "config/robots/rescue.yaml"


@pytest.fixture
def ground(scene):
    return ground_from([scene([BOX]).view()], grid=GRID)


def occupied_of(ground, robot):
    return occupancy(ground, robot, stand_probability(ground, robot))


def map_server_reads(path):
    """(rows, columns) int8 as map_server's image_loader gives it, by its documented rules (negate
    0)."""
    described = yaml.safe_load(path.read_text())
    picture = cv2.imread(str(path.parent / described["image"]), cv2.IMREAD_UNCHANGED)
    grey, alpha = (
        (picture, np.full(picture.shape, 255))
        if picture.ndim == 2
        else (picture[..., 0], picture[..., 3])
    )
    if described["mode"] == "trinary" and picture.ndim == 3:
        grey = picture.mean(-1)
    occupied = (255 - grey.astype(float)) / 255
    low, high = described["free_thresh"], described["occupied_thresh"]
    graded = np.where(alpha < 1, -1, np.rint(99 * (occupied - low) / (high - low)))
    between = graded if described["mode"] == "scale" else -1
    return np.select([occupied > high, occupied < low], [100, 0], between)[::-1].astype(
        np.int8
    ), described


def test_map_server_reads_free_occupied_and_unknown(ground, root, tmp_path):
    occupied = occupied_of(ground, load_robot(root / ROBOT))
    read, described = map_server_reads(write_map_server(occupied, GRID, tmp_path, "map")[1])
    assert described["resolution"] == 0.1 and described["origin"] == [GRID.x0_m, GRID.y0_m, 0.0]
    assert (read[(occupied >= 0) & (occupied <= FREE_PERCENT)] == 0).all()
    assert (read[occupied > OCCUPIED_PERCENT] == 100).all() and (read[occupied == -1] == -1).all()
    assert read[GRID.cell_of(13.05, -0.5)] == 100 and read[GRID.cell_of(10, 3)] == 0
    assert read[GRID.cell_of(14.6, -0.5)] == -1  # hidden by the box


def test_a_planner_that_inflates_finds_where_the_robot_can_stand(scene, root, ground):
    """Free cells are those below a footprint that can stand: shrunk by it they hold all of these,
    and no middle from which the footprint reaches over the box."""
    robot = load_robot(root / ROBOT)
    stands = stand_probability(ground, robot)
    occupied = occupied_of(ground, robot)
    free = (occupied >= 0) & (occupied <= FREE_PERCENT)
    middles = least(free, disk(robot.radius_m, GRID.cell_m), 0.0) > 0
    y, x = np.indices(GRID.shape)
    inner = (np.minimum(y, GRID.rows - 1 - y) > 4) & (np.minimum(x, GRID.columns - 1 - x) > 4)
    assert (middles | ~(stands >= FREE_P))[inner].all() and middles.sum() > 3000
    xy = GRID.middle_of(y, x)
    apart = np.maximum(np.maximum([BOX[0], BOX[2]] - xy, xy - [BOX[1], BOX[3]]), 0)
    assert np.hypot(*apart[middles].T).min() > robot.radius_m - 0.05
    assert not free[~ground.known].any() and (occupied[~ground.known] == -1).all()


def test_the_scaled_pair_keeps_grades_and_what_is_unknown(ground, root, tmp_path):
    occupied = occupied_of(ground, load_robot(root / ROBOT))
    occupied[0, :3] = 20, 30, 40
    read, _ = map_server_reads(write_map_server(occupied, GRID, tmp_path, "map", scaled=True)[1])
    assert (read[occupied == -1] == -1).all() and (read[occupied > OCCUPIED_PERCENT] == 100).all()
    assert 0 < read[0, 0] < read[0, 1] < read[0, 2] < 100


def test_layers_lie_where_the_grid_does(ground, root, tmp_path):
    stands = stand_probability(ground, load_robot(root / ROBOT))
    paths = {
        path.stem: path for path in write_layers(layers_of(ground, stands), ground.grid, tmp_path)
    }
    with tifffile.TiffFile(paths["height"]) as file:
        page = file.pages[0]
        height, tie, scale = page.asarray(), page.tags[33922].value, page.tags[33550].value
    assert tuple(tie[3:5]) == (GRID.x0_m, GRID.y0_m + 0.1 * GRID.rows) and scale[0] == 0.1
    column, row = int((13.05 - tie[3]) / 0.1), int((tie[4] + 0.5) / 0.1)
    assert height[row, column] > 0.2  # the box's near face, at y = -0.5
    assert np.isnan(height).sum() == (~ground.known).sum()
    read = tifffile.imread(paths["stand"])[::-1]
    assert np.array_equal(np.isfinite(read), np.isfinite(stands))


def test_the_command_writes_all_and_says_what_it_found(scene, write_map, root, tmp_path, capsys):
    write_map(scene([BOX]).view(), tmp_path / "map")
    call = [str(tmp_path / "map"), "--robot", str(root / ROBOT), "-o", str(tmp_path / "out")]
    assert command.main([*call, "--route", "10", "0", "18", "0", "--octomap", "0.4"]) == 0
    text = capsys.readouterr().out
    assert "free to stand on" in text and "route of" in text
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {
        "map.pgm",
        "map.yaml",
        "map_scaled.png",
        "height.tif",
        "ground.png",
        "ground.json",
        "map.bt",
        "map.ot",
    } <= names
    assert json.loads((tmp_path / "out/ground.json").read_text())["route"]["length_m"] > 8


def test_the_command_without_a_route_ends_with_one(scene, write_map, root, tmp_path, capsys):
    write_map(scene(blank=[(13, 16, -9, 9)]).view(), tmp_path / "map")
    call = [str(tmp_path / "map"), "--robot", str(root / ROBOT), "-o", str(tmp_path / "out")]
    assert command.main([*call, "--route", "10", "0", "20", "0"]) == 1
    assert "no safe route is known" in capsys.readouterr().out
    assert json.loads((tmp_path / "out/ground.json").read_text())["no_route"]["to_see_m"]
    call[-1] = str(tmp_path / "dared")
    dares = ["--route", "10", "0", "20", "0", "--through-unknown", "2"]
    assert command.main([*call, *dares]) == 0
    assert re.search(r"risk 0\.0\d\d; some \d\.\d m of it were never seen", capsys.readouterr().out)


@pytest.mark.parametrize(
    "lacking, words", [("sigma.npy", "has no sigma.npy"), ("report.json", "has no report.json")]
)
def test_the_command_refuses_a_map_that_lacks_a_file(
    scene, write_map, root, tmp_path, capsys, lacking, words
):
    write_map(scene().view(), tmp_path / "map")
    (tmp_path / "map" / lacking).unlink()
    call = [str(tmp_path / "map"), "--robot", str(root / ROBOT), "-o", str(tmp_path / "out")]
    assert command.main(call) == 2
    assert words in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "options, words",
    [
        (["--cell-m", "0"], "--cell-m: must be above 0 m, got 0.0"),
        (["--cell-m", "nan"], "--cell-m: must be above 0 m, got nan"),
        (["--reach-m=-5"], "--reach-m: must be above 0 m"),
        (["--cell-m", "0.41"], "0.41 m is above the radius of rescue, 0.4 m"),
        (["--cell-m", "1e300"], "above the radius of rescue"),
        (["--octomap", "1e300"], "--octomap: voxels are at most 10 m"),
        (["--octomap", "0"], "--octomap: must be above 0 m"),
        (["--octomap", "0.0001"], "take larger voxels"),
        (["--through-unknown", "2"], "--through-unknown is of --route X0 Y0 X1 Y1"),
        (["--place-sigma-m", "2"], "--place-sigma-m is of --route X0 Y0 X1 Y1"),
    ],
)
def test_the_command_refuses_a_wrong_option_and_leaves_nothing(
    scene, write_map, root, tmp_path, capsys, options, words
):
    write_map(scene().view(), tmp_path / "map")
    call = [str(tmp_path / "map"), "--robot", str(root / ROBOT), "-o", str(tmp_path / "out")]
    assert command.main([*call, *options]) == 2
    assert words in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["map"]


def test_the_same_map_twice_is_no_second_witness(scene, write_map, root, tmp_path, capsys):
    for name in ("map", "copy"):
        write_map(scene().view(), tmp_path / name)
    maps = [str(tmp_path / name) for name in ("map", "copy")]
    call = [*maps, "--robot", str(root / ROBOT), "-o", str(tmp_path / "out")]
    assert command.main(call) == 2
    assert "copy: is the same map as" in capsys.readouterr().err


@pytest.mark.parametrize("module", [command, search])
def test_what_the_docstrings_say(module):
    result = doctest.testmod(module)
    assert result.attempted > 0 and result.failed == 0


def test_a_negative_number_with_an_exponent_is_no_option(scene, write_map, root, tmp_path, capsys):
    write_map(scene().view(size=(320, 240)), tmp_path / "map")
    call = [str(tmp_path / "map"), "--robot", str(root / ROBOT), "-o", str(tmp_path / "out")]
    words = ["--cell-m", "0.2", "--route", "10", "0", "16", "-1e0"]
    assert command.main([*call, *words]) == 0
    points_m = json.loads((tmp_path / "out/ground.json").read_text())["route"]["points_m"]
    assert points_m[-1] == [16.0, -1.0]
