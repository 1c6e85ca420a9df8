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

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "reference"


def test_the_pages_are_as_the_code_has_them():
    env = dict(os.environ, ROS_MASTER_URI="http://127.0.0.1:9")  # nobody is asked
    done = subprocess.run([sys.executable, str(ROOT / "tools/docs/reference.py"), "--check"], env=env,
                          capture_output=True, text=True, timeout=240)  # fmt: skip
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
        command, node = f"## {path.name}" in commands, f"## {path.parents[1].name}/{path.name}" in nodes
        assert path.is_dir() or command != node, path


@pytest.mark.parametrize("path", sorted((ROOT / "launch").rglob("*.launch")), ids=lambda p: p.name)
def test_every_argument_of_a_launch_file_says_what_it_is(path):
    arguments = [a for a in xml.parse(path).getroot().findall("arg") if "value" not in a.attrib]
    assert not [a.get("name") for a in arguments if not a.get("doc")]


@pytest.mark.parametrize("section, module, registry", [
    ("A matcher", "fcsv_stereo.thesis.matchers", "MATCHERS"), ("A matcher", "fcsv_stereo.pipeline", "METHODS"),
    ("A tracker", "fcsv_sim.demo.systems", "SYSTEMS"), ("A simulated world", "fcsv_sim.world.town", "WORLDS"),
])  # fmt: skip
def test_a_recipe_names_the_command_that_writes_its_new_entry_into_the_reference(section, module, registry):
    entries, commands = getattr(importlib.import_module(module), registry), (PAGES / "commands.md").read_text()
    assert entries and all(re.search(rf"\b{name}\b", commands) for name in entries), "entries stand in the reference"
    page = (ROOT / "docs/design/changing.md").read_text()
    recipe = page.partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    assert registry in recipe or registry == "METHODS"
    assert "`tools/run reference`" in recipe


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
        End("publishes", "/answer", "String"), End("publishes", "/VEHICLE/camera/left", "Image"),
        End("publishes", "/VEHICLE/camera/right", "Image"), End("publishes", "/VEHICLE/camera/WHAT", "Image"),
        End("hears", "a", "Odometry"), End("hears", "b", "Pose"), End("hears", "/VEHICLE/c", "Joy"),
        End("publishes", "/tf", "tf2_msgs/TFMessage"),
    }  # fmt: skip


def test_what_is_heard_by_shared_functions_counts_where_they_are_called(monkeypatch):
    """The mission hears all of its vehicles by a table of topics; stop-all two of them, and no relay."""
    monkeypatch.syspath_prepend(str(ROOT / "tools" / "docs"))
    from node_topics import End, ends_of_node

    mission, stop_all = (ends_of_node(ROOT, f"fcsv_control.ros.{name}_node") for name in ("mission", "stop_all"))
    assert {
        End("hears", "/VEHICLE/odometry/state", "Odometry"), End("hears", "/VEHICLE/command_ack", "CommandAck"),
        End("hears", "/VEHICLE/tags/detections", "TagDetections"), End("hears", "/relay/ages", "RelayAges"),
        End("hears", "/calibration_epochs", "Epochs"), End("hears", "/stop_all", "String"),
    } <= mission  # fmt: skip
    heard = {e.name for e in stop_all if e.does == "hears" and e.name.startswith("/VEHICLE")}
    assert heard == {"/VEHICLE/mavros/state", "/VEHICLE/command_ack"}
    assert not any("relay" in e.name or "epochs" in e.name for e in stop_all)
