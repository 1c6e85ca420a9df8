# SPDX-License-Identifier: Apache-2.0
"""The command check: kinds are found out, the product's own parsers judge, errors name file, field
and remedy."""

import re
import shutil
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from fcsv_control.file_check import command, kinds
from fcsv_control.file_check.checking import check, files_of
from fcsv_control.file_check.kinds import KINDS, YAML_KINDS, recognised
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import write_camera
from fcsv_geometry.errors import ConfigError
from fcsv_multimaster.links import SECTIONS
from fcsv_stereo import fcsv_command

CONFIG = Path(__file__).resolve().parents[2] / "config"
FILES = files_of([CONFIG])
#: What neither ROS nor the wheel's dependencies bring: a check must not need it.
NOT_THERE = (
    "rospy",
    "rosbag",
    "rosgraph",
    "rospkg",
    "cv_bridge",
    "fcsv_msgs",
    "pymavlink",
    "zenoh",
    "embreex",
    "serial",
)
BLOCKED = f"""
import sys

class Block:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {NOT_THERE!r}:
            raise ImportError(name + " is not in the wheel")

sys.meta_path.insert(0, Block())
from fcsv_stereo.fcsv_command import main
sys.exit(main(sys.argv[1:]))
"""


def written(folder, name, document):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(
        document if isinstance(document, str) else yaml.safe_dump(document, sort_keys=False)
    )
    return path


def changed(folder, source, change):
    """A copy of one of config/'s files of the same name in ``folder``, ``change`` called with its
    document."""
    document = yaml.safe_load((CONFIG / source).read_text())
    change(document)
    return written(folder, Path(source).name, document)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(CONFIG)))
def test_every_file_that_comes_along_is_good_and_of_its_folders_kind(path):
    found = check(path)
    assert not found.problem and found.words.endswith("ok") == (not found.note)
    folder = path.parent.name
    assert KINDS[found.kind].folder == folder


@pytest.mark.parametrize(
    "path", [p for p in FILES if p.parent.name != "trackers"], ids=lambda p: p.name
)
def test_the_kind_is_found_by_content_in_any_folder(path, tmp_path):
    """t265.yaml names itself only; guardian/uav.yaml has no key but fence, which missions have,
    too."""
    copy = Path(shutil.copy(path, tmp_path / path.name))
    assert check(copy).kind == check(path).kind and not check(copy).problem


def test_every_kind_but_those_of_the_users_own_has_an_example():
    assert {k.name for k in KINDS.values()} - {check(p).kind for p in FILES} == {
        "camera",
        "points of interest",
    }


@pytest.mark.parametrize(
    "source, change, kind, words",
    [
        (
            "missions/short.yaml",
            lambda d: d["configurations"][1].update(baselin_m=3.0),
            "mission",
            [
                "error in line",
                "unknown key 'configurations[1].baselin_m'",
                "did you mean 'baseline_m'?",
            ],
        ),
        (
            "missions/short.yaml",
            lambda d: d.update(configuration=d.pop("configurations")),
            "mission",
            ["unknown key 'configuration'", "did you mean 'configurations'?"],
        ),
        (
            "missions/outdoor.yaml",
            lambda d: d["configurations"][7].update(baseline_m=-10.0),
            "mission",
            ["configurations[7].baseline_m: -10.0 must be positive; the axis says the direction"],
        ),
        (
            "vehicles/uav1.yaml",
            lambda d: d.update(sytem_id=d.pop("system_id")),
            "vehicle",
            ["unknown key 'sytem_id'", "did you mean 'system_id'?"],
        ),
        (
            "vehicles/uav1.yaml",
            lambda d: d.update(name="uav9"),
            "vehicle",
            ["name is 'uav9', the file says 'uav1'"],
        ),
        (
            "vehicles/uav2.yaml",
            lambda d: d["camera"].update(xyz_m=[0.1, 0.0]),
            "vehicle",
            ["'camera.xyz_m' must have 3"],
        ),
        (
            "robots/small.yaml",
            lambda d: d.update(largest_slope_deg=80),
            "robot",
            ["largest_slope_deg: at most 60, got 80"],
        ),
        (
            "trackers/t265.yaml",
            lambda d: d.update(rate_hz=1000),
            "tracker",
            ["rate_hz: 1000.0 is not in 1..400"],
        ),
        (
            "links/default.yaml",
            lambda d: d["to_control"][0].update({"class": "critcal"}),
            "links",
            ["to_control[0].class", "'critcal'", "did you mean 'critical'?"],
        ),
        (
            "links/default.yaml",
            lambda d: d["to_vehicle"][1].pop("class"),
            "links",
            ["'to_vehicle[1].class' is missing"],
        ),
        (
            "links/default.yaml",
            lambda d: d["to_vehicle"][1].update(traffic="state"),
            "links",
            ["'to_vehicle[1].traffic'"],
        ),
        (
            "links/default.yaml",
            lambda d: d.update(classes=[1]),
            "links",
            ["'classes' must be a mapping"],
        ),
        (
            "links/default.yaml",
            lambda d: d.update(to_controll=[]),
            "links",
            ["did you mean 'to_control'?"],
        ),
        (
            "guardian/tello.yaml",
            lambda d: d.update(feed_warn_s=9.0),
            "guardian",
            ["feed_warn_s: 9.0 is over feed_land_s"],
        ),
        (
            "guardian/uav.yaml",
            lambda d: d["fence"].update(radius=3.0),
            "guardian",
            ["did you mean 'radius_m'?"],
        ),
        (
            "tello/flight_check.yaml",
            lambda d: d.update(red_feed_hz=9.0),
            "flight check",
            ["9.0 is over amber"],
        ),
        (
            "tello/velocity.yaml",
            lambda d: d["yaw"].update(most=0.0),
            "Tello controller",
            ["yaw.p, most: must be positive"],
        ),
        (
            "gimbal/ground_robot.yaml",
            lambda d: d["gimbals"][1]["tags"][0].update(id=20),
            "gimbals",
            ["tag id 20 is"],
        ),
        (
            "tilting/rig.yaml",
            lambda d: d["left"]["camera"].update(fx=-1.0),
            "tilting rig",
            ["'left.camera'", "not a"],
        ),
    ],
)
def test_an_error_names_file_field_and_remedy(tmp_path, source, change, kind, words):
    path = changed(tmp_path / Path(source).parent.name, source, change)
    found = check(path)
    assert found.kind == kind and found.problem and all(w in found.words for w in words), (
        found.words
    )
    assert found.words.startswith(f"{path}: {kind}: error") and found.words.count(str(path)) == 1


def test_the_line_is_that_of_the_wrong_key(tmp_path):
    text = "name: a\nconfigurations:\n  - {axis: horizontal, baseline_m: 4.0}\n  - {axis: sideways, baseline_m: 4.0}\n"
    found = check(written(tmp_path, "a.yaml", text))
    assert found.line == 4 and "'sideways' is not one of horizontal, vertical" in found.problem


@pytest.mark.parametrize(
    "name, text, words",
    [
        (
            "a.yaml",
            "colour: red\nsize: 3\n",
            ["no kind of configuration file has the keys colour, size", "known kinds"],
        ),
        ("a.yaml", "", ["holds nothing", "known kinds"]),
        ("a.yaml", "- 1\n", ["holds list"]),
        ("a.yaml", "name: [\n", ["line 2", "not valid YAML"]),
        ("a.yaml", "radius_m: 0.3\n", ["may be vehicle or robot by its keys", "--kind"]),
        ("a.yaml", b"\xff\xfe\x00".decode("latin-1"), ["not valid YAML"]),
        (
            "a.param",
            "VISO_TYPE,2\nFS_THR_ENABLE three\n",
            ["line 2", "'FS_THR_ENABLE three' is not NAME,VALUE"],
        ),
        ("a.param", "#: must 5: poses\nVISO_TYPE,2\n", ["line 2", "VISO_TYPE 2 is not 5"]),
    ],
)
def test_what_is_of_no_kind_or_cannot_be_read_is_one_clear_error(tmp_path, name, text, words):
    found = check(written(tmp_path, name, text))
    assert found.problem and all(w in found.words for w in words), found.words


def test_a_file_that_is_not_there_is_named(tmp_path):
    assert "cannot be read (No such file" in check(tmp_path / "none.yaml").problem
    assert "cannot be read (No such file" in check(tmp_path / "none.param").problem


def test_a_kind_can_be_forced(tmp_path):
    path = written(tmp_path, "a.yaml", {"radius_m": 0.3})
    assert (
        "'name' is missing" in check(path, "robot").problem and check(path, "robot").kind == "robot"
    )


CAMERA = PinholeCamera(800, 600, 700.0, 702.0, 401.0, 298.0, (-0.1, 0.02, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("plumb_bob", "plumb_bob", ""),
        ("plumb_bob", "equidistant", "distortion model 'equidistant' is of a fisheye"),
        ("camera_matrix", "camera_matrx", "'camera_matrix' is missing; is 'camera_matrx' meant?"),
        ("image_width: 800", "image_width: 80", "principal point"),
        (
            "cols: 3\n  data: [700.0, ",
            "cols: 3\n  data: [",
            "'camera_matrix' is not a (3, 3) matrix",
        ),
    ],
)
def test_a_cameras_calibration_is_checked_as_drivers_need_it(tmp_path, old, new, words):
    path = tmp_path / "front.yaml"
    write_camera(path, "front", CAMERA)
    path.write_text(path.read_text().replace(old, new, 1))
    found = check(path)
    assert found.kind == "camera" and (words in found.problem if words else not found.problem), (
        found.words
    )


def test_points_of_interest_are_a_kind(tmp_path):
    path = written(
        tmp_path,
        "poi.yaml",
        {"points_of_interest": [{"name": "a", "u_px": 3, "v_px": 4, "truth_m": -1}]},
    )
    assert (
        "truth_m: -1.0 must be positive" in check(path).words
        and check(path).kind == "points of interest"
    )


@pytest.mark.parametrize(
    "mission, vehicles, words",
    [
        ("short", "uav1,uav2", ""),
        ("at_once", "uav1,uav2,uav3", ""),
        ("five", "uav1,uav2", "configurations[1].vehicle is 'uav3', this fleet is uav1, uav2"),
        ("short", "uav1", "needs to be one of two or more vehicles"),
        ("short", "uav1,uav7", "uav7.yaml: cannot be read"),
    ],
)
def test_with_vehicles_a_mission_is_checked_as_the_mission_node_does(mission, vehicles, words):
    found = check(CONFIG / f"missions/{mission}.yaml", vehicles=vehicles.split(","))
    assert (words in found.problem) if words else not found.problem, found.words


def test_legs_outside_of_the_fence_are_found_with_vehicles_only(tmp_path):
    path = changed(tmp_path, "missions/short.yaml", lambda d: d.update(fence={"radius_m": 3.0}))
    assert not check(path).problem
    found = check(path, vehicles=["uav1", "uav2"], vehicles_dir=str(CONFIG / "vehicles"))
    assert "the fence ends at 3 m" in found.problem


def test_the_command_tells_all_files_and_its_status(tmp_path, capsys):
    good = str(CONFIG / "missions/short.yaml")
    assert command.main([good]) == 0 and capsys.readouterr().out == f"{good}: mission: ok\n"
    bad = changed(tmp_path, "robots/small.yaml", lambda d: d.update(radius_m=0.0))
    assert command.main([good, str(bad)]) == 1
    said = capsys.readouterr().out.splitlines()
    assert (
        said[0].endswith("mission: ok")
        and "robot: error in line 2: radius_m: must be positive" in said[1]
    )
    assert said[2] == "2 files: 1 with an error"
    assert (
        command.main([str(CONFIG)]) == 0
        and f"{len(FILES)} files: all ok" in capsys.readouterr().out
    )
    (tmp_path / "empty").mkdir()
    assert (
        command.main([str(tmp_path / "empty")]) == 2 and "holds no YAML" in capsys.readouterr().err
    )


def test_fcsv_check_needs_neither_ros_nor_what_only_vehicles_have():
    arguments = ["check", str(CONFIG), "--vehicles", "uav1,uav2"]
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, *arguments], capture_output=True, text=True, timeout=100
    )
    wrong = [line for line in done.stdout.splitlines() if ": error" in line]
    assert (
        done.returncode == 1 and wrong and all("this fleet is uav1, uav2" in line for line in wrong)
    ), done.stderr
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, *arguments[:2]], capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_wheel_holds_every_parser(root):
    """Of each kind, and of the command itself."""
    wheel = (
        (root / "pyproject.toml").read_text().partition("targets.wheel]")[2].partition("exclude")[0]
    )
    names = set(re.findall(r'"src/(\w+)/src/\1"', wheel))
    used = {n.split(".")[0] for k in KINDS.values() for n in (k.schema, k.reader) if n}
    assert (
        used <= names and fcsv_command.COMMANDS["check"][0].split(".")[0] in names and len(used) > 4
    )


def test_kinds_say_the_keys_that_their_parsers_know():
    links = next(k for k in YAML_KINDS if k.name == "links")
    assert set(links.known_keys()) == {"classes", *SECTIONS}
    robot = next(k for k in YAML_KINDS if k.name == "robot")
    assert set(robot.known_keys()) == {f.name for f in fields(kinds.imported(robot.schema))}
    assert "turning_radius_m" not in robot.required_keys() and "radius_m" in robot.required_keys()
    with pytest.raises(ConfigError, match="no kind"):
        recognised(CONFIG.parent / "compose.yaml")


def test_a_mission_anywhere_is_checked_against_the_workspaces_vehicles(tmp_path, monkeypatch):
    path = tmp_path / "mine.yaml"
    shutil.copy(CONFIG / "missions/short.yaml", path)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(CONFIG.parent))
    assert check(path, vehicles=["uav1", "uav2"]).problem == ""
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    assert "name their folder with --vehicles-dir" in check(path, vehicles=["uav1", "uav2"]).words
