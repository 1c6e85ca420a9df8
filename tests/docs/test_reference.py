# SPDX-License-Identifier: Apache-2.0
"""docs/reference/ is as the code has it, and reads what it should out of the code."""

import importlib
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as xml
from pathlib import Path

import pytest
import yaml

from fcsv_control.file_check.kinds import KINDS, recognised

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "reference"


def test_the_pages_are_as_the_code_has_them():
    env = dict(os.environ, ROS_MASTER_URI="http://127.0.0.1:9")  # nobody is asked
    done = subprocess.run(
        [sys.executable, str(ROOT / "tools/docs/reference.py"), "--check"],
        env=env,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]


def test_the_drawings_are_as_the_code_draws_them():
    command = [sys.executable, str(ROOT / "tools/docs/figures.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    page = (ROOT / "docs/user/concepts.md").read_text()
    drawn = [p.name for p in (ROOT / "docs/figures").glob("*.svg")]
    assert drawn and not [name for name in drawn if f"(../figures/{name})" not in page]


def test_every_executable_stands_in_one_page():
    commands, nodes = ((PAGES / n).read_text().splitlines() for n in ("commands.md", "nodes.md"))
    for path in ROOT.glob("src/fcsv_*/nodes/*"):
        command, node = (
            f"## {path.name}" in commands,
            f"## {path.parents[1].name}/{path.name}" in nodes,
        )
        assert path.is_dir() or command != node, path


@pytest.mark.parametrize("path", sorted((ROOT / "launch").rglob("*.launch")), ids=lambda p: p.name)
def test_every_argument_of_a_launch_file_says_what_it_is(path):
    arguments = [a for a in xml.parse(path).getroot().findall("arg") if "value" not in a.attrib]
    assert not [a.get("name") for a in arguments if not a.get("doc")]


@pytest.mark.parametrize(
    "section, module, registry",
    [
        ("A matcher", "fcsv_stereo.thesis.matchers", "MATCHERS"),
        ("A matcher", "fcsv_stereo.pipeline", "METHODS"),
        ("A tracker", "fcsv_sim.demo.systems", "SYSTEMS"),
        ("A simulated world", "fcsv_sim.world.town", "WORLDS"),
    ],
)
def test_a_recipe_names_the_command_that_writes_its_new_entry_into_the_reference(
    section, module, registry
):
    entries, commands = (
        getattr(importlib.import_module(module), registry),
        (PAGES / "commands.md").read_text(),
    )
    assert entries and all(re.search(rf"\b{name}\b", commands) for name in entries), (
        "entries stand in the reference"
    )
    page = (ROOT / "docs/design/changing.md").read_text()
    recipe = page.partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    assert registry in recipe or registry == "METHODS"
    assert "`tools/run reference`" in recipe


def rows_of_files(section):
    """By key the cells of a kind's table: unit, default, range, meaning."""
    page = (PAGES / "files.md").read_text().partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    rows = (line.strip("|").split(" | ") for line in page.splitlines() if line.startswith("| `"))
    return {cells[0].strip(" `"): [c.strip() for c in cells[1:]] for cells in rows}


def keys_in(value, at=""):
    """Paths of all keys of a document, entries of lists as []."""
    if isinstance(value, list):
        return {key for entry in value for key in keys_in(entry, f"{at}[]")}
    if not isinstance(value, dict):
        return set()
    paths = {f"{at}.{key}".lstrip("."): inner for key, inner in value.items()}
    return set(paths) | {key for path, inner in paths.items() for key in keys_in(inner, path)}


@pytest.mark.parametrize("path", sorted((ROOT / "config").rglob("*.yaml")), ids=lambda p: p.name)
def test_every_key_of_a_file_in_config_stands_in_the_table_of_its_kind(path):
    kind = recognised(path)
    if kind.foreign or kind.name == "links":
        return
    rows = rows_of_files(kind.name[0].upper() + kind.name[1:])
    assert rows and keys_in(yaml.safe_load(path.read_text())) <= set(rows)
    assert all(cells[-1] for cells in rows.values()), "each has a meaning"


def test_every_kind_of_file_stands_in_the_page():
    page = (PAGES / "files.md").read_text()
    for kind in KINDS.values():
        assert (
            f"\n## {kind.name[0].upper()}{kind.name[1:]}\n" in page or f"\n| {kind.name} | " in page
        )


@pytest.mark.parametrize(
    "section, key, cells",
    [
        ("Mission", "configurations[].record_s", ["s", "`5`", "0.5 to 600"]),
        ("Mission", "configurations[].axis", ["", "none", "horizontal, vertical"]),
        ("Mission", "fence.floor_m", ["m", "`0.5`", "over 0, under 40"]),
        ("Vehicle", "system_id", ["", "must be given", "1 to 255"]),
        ("Robot", "largest_slope_deg", ["degrees", "must be given", "1.05 to 60"]),
        ("Gimbals", "gimbals[].servo.pan_sign", ["", "`1`", "-1, 1"]),
        ("Guardian", "fence.ceiling_m", ["m", "`45`", "over 0.3"]),
        ("Links", "classes.NAME.max_age_s", ["s", "none", "over 0"]),
        ("Tracker", "rate_hz", ["Hz", "`200`", "1 to 400"]),
    ],
)
def test_unit_default_and_range_are_those_of_the_parser(section, key, cells):
    """As the tests of these parsers have them."""
    assert rows_of_files(section)[key][:3] == cells


def test_a_field_without_a_meaning_is_refused(monkeypatch, tmp_path):
    """No key comes into a file without words for its user."""
    monkeypatch.syspath_prepend(str(ROOT / "tools" / "docs"))
    monkeypatch.syspath_prepend(str(tmp_path))
    import files_page

    (tmp_path / "mute.py").write_text(
        "import dataclasses\n\n\n@dataclasses.dataclass\nclass Mute:\n    told_m: float = 1.0  # it is told\n"
        "    mute_m: float = 1.0\n"
    )
    mute = importlib.import_module("mute").Mute
    rows = files_page._rows(mute, "", None, lambda _path, value: "" if value < 7 else "no")
    assert next(rows) == ("told_m", "m", "`1`", "under 7", "it is told")
    with pytest.raises(SystemExit, match="mute_m: no comment"):
        next(rows)


def test_topics_are_read_through_loops_helpers_and_names(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "tools" / "docs"))
    from node_topics import End, ends

    (tmp_path / "m.py").write_text("""
ANSWER = "/answer"
def go(self, name, names):
    at = f"/{name}/camera"
    rospy.Publisher(ANSWER, String, queue_size=1)
    self._p = {n: rospy.Publisher(f"{at}/{what}", Image) for what in ("left", "right")}
    for topic, kind in (("a", Odometry), ("b", Pose)):
        rospy.Subscriber(topic, kind, go)
    hear = lambda topic, kind: rospy.Subscriber(f"/{name}/{topic}", kind, go)
    hear("c", Joy)
    tf2_ros.TransformBroadcaster()
""")
    assert ends(tmp_path / "m.py") == {
        End("publishes", "/answer", "String"),
        End("publishes", "/VEHICLE/camera/left", "Image"),
        End("publishes", "/VEHICLE/camera/right", "Image"),
        End("publishes", "/VEHICLE/camera/WHAT", "Image"),
        End("hears", "a", "Odometry"),
        End("hears", "b", "Pose"),
        End("hears", "/VEHICLE/c", "Joy"),
        End("publishes", "/tf", "tf2_msgs/TFMessage"),
    }


def test_what_is_heard_by_shared_functions_counts_where_they_are_called(monkeypatch):
    """The mission hears all of its vehicles by a table of topics; stop-all two of them, and no
    relay."""
    monkeypatch.syspath_prepend(str(ROOT / "tools" / "docs"))
    from node_topics import End, ends_of_node

    names = (f"fcsv_control.ros.mission.{name}_node" for name in ("mission", "stop_all"))
    mission, stop_all = (ends_of_node(ROOT, name) for name in names)
    assert {
        End("hears", "/VEHICLE/odometry/state", "Odometry"),
        End("hears", "/VEHICLE/command_ack", "CommandAck"),
        End("hears", "/VEHICLE/tags/detections", "TagDetections"),
        End("hears", "/relay/ages", "RelayAges"),
        End("hears", "/calibration_epochs", "Epochs"),
        End("hears", "/stop_all", "String"),
    } <= mission
    heard = {e.name for e in stop_all if e.does == "hears" and e.name.startswith("/VEHICLE")}
    assert heard == {"/VEHICLE/mavros/state", "/VEHICLE/command_ack"}
    assert not any("relay" in e.name or "epochs" in e.name for e in stop_all)
