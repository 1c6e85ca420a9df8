# SPDX-License-Identifier: Apache-2.0
"""The definitions are MAVROS's own in all that ROS compares, and the package steps back where the
real one is.

The sums are those of mavros_msgs 1.20.1, computed with genmsg from its published definitions. They
hold since 1.5 (State), 0.29 or earlier (the others), and up to 1.21.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FIND = ROOT / "src/mavros_msgs/cmake/real_mavros_msgs.cmake"
HEADER = "std_msgs/Header header"
MESSAGES = {
    "State": (
        "65cd0a9fff993b062b91e354554ec7e9",
        [
            HEADER,
            "bool connected",
            "bool armed",
            "bool guided",
            "bool manual_input",
            "string mode",
            "uint8 system_status",
        ],
    ),
    "StatusText": ("6cfd33cd09e4abf5841d7be3c770a969", [HEADER, "uint8 severity", "string text"]),
    "Mavlink": (
        "41093e1fd0f3eea1da2aa33a177e5ba6",
        [
            HEADER,
            "uint8 framing_status",
            "uint8 magic",
            "uint8 len",
            "uint8 incompat_flags",
            "uint8 compat_flags",
            "uint8 seq",
            "uint8 sysid",
            "uint8 compid",
            "uint32 msgid",
            "uint16 checksum",
            "uint64[] payload64",
            "uint8[] signature",
        ],
    ),
    "RCIn": ("1c3eafdb5efbcda3c334e1788bbcfe39", [HEADER, "uint8 rssi", "uint16[] channels"]),
}
SERVICES = {
    "SetMode": (
        "e4f18fa93379f9ff1780d270ce110203",
        ["uint8 base_mode", "string custom_mode"],
        ["bool mode_sent"],
    ),
    "CommandBool": (
        "e09abbb4e5bae6b558e5010966eb6e9e",
        ["bool value"],
        ["bool success", "uint8 result"],
    ),
    "CommandTOL": (
        "93ff4eaa9907f58c0e7a909cddce23e2",
        [
            "float32 min_pitch",
            "float32 yaw",
            "float32 latitude",
            "float32 longitude",
            "float32 altitude",
        ],
        ["bool success", "uint8 result"],
    ),
}


def fields(kind):
    return [f"{t} {name}" for t, name in zip(kind._slot_types, kind.__slots__)]


def test_every_definition_is_compared():
    folder = ROOT / "src/mavros_msgs"
    assert {p.stem for p in (folder / "msg").glob("*.msg")} == set(MESSAGES)
    assert {p.stem for p in (folder / "srv").glob("*.srv")} == set(SERVICES)


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_is_mavros_own(name):
    import mavros_msgs.msg

    kind = getattr(mavros_msgs.msg, name)
    assert (kind._type, kind._md5sum, fields(kind)) == (f"mavros_msgs/{name}", *MESSAGES[name])


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_is_mavros_own(name):
    import mavros_msgs.srv

    kind = getattr(mavros_msgs.srv, name)
    found = (kind._type, kind._md5sum, fields(kind._request_class), fields(kind._response_class))
    assert found == (f"mavros_msgs/{name}", *SERVICES[name])


# --- stepping back -------------------------------------------------------------------------------


def package(folder, stand_in=False):
    """A mavros_msgs manifest in a folder: the real one's, or a stand-in's."""
    folder.mkdir(parents=True)
    export = '<export><stand_in of="mavros_msgs" by="fcsv"/></export>' if stand_in else ""
    (folder / "package.xml").write_text(
        f'<package format="2"><name>mavros_msgs</name>{export}</package>'
    )
    return folder


def space(prefix, sources=""):
    """The configuration of a catkin space that has mavros_msgs; ``sources`` only where it is a
    devel space."""
    folder = prefix / "share/mavros_msgs/cmake"
    folder.mkdir(parents=True)
    (folder / "mavros_msgsConfig.cmake").write_text(f"set(mavros_msgs_SOURCE_PREFIX {sources})\n")
    return prefix


def found(find, *prefixes):
    environment = dict(os.environ, CMAKE_PREFIX_PATH=":".join(str(p) for p in prefixes))
    done = subprocess.run(
        ["cmake", "-P", str(find)], env=environment, capture_output=True, text=True, check=True
    )
    return (done.stdout + done.stderr).strip()


@pytest.fixture
def workspace(tmp_path):
    """A workspace with this package in it, to put others beside it."""
    folder = tmp_path / "workspace/src/mavros_msgs"
    shutil.copytree(
        ROOT / "src/mavros_msgs", folder, ignore=shutil.ignore_patterns("CATKIN_IGNORE")
    )
    return folder.parents[1]


def test_the_real_package_is_found_where_it_may_be(tmp_path, workspace):
    find = workspace / "src/mavros_msgs/cmake/real_mavros_msgs.cmake"
    assert found(find, tmp_path / "nothing") == ""
    package(tmp_path / "opt/share/mavros_msgs")
    assert found(find, tmp_path / "nothing", space(tmp_path / "opt")) == str(
        tmp_path / "opt/share/mavros_msgs"
    )
    real = package(tmp_path / "other/src/mavros/mavros_msgs")
    assert found(find, space(tmp_path / "other/devel", real)) == str(real)
    beside = package(workspace / "src/mavros/mavros_msgs")
    assert found(find) == str(beside)


def test_what_was_built_from_a_stand_in_is_not_the_real_package(tmp_path, workspace):
    find = workspace / "src/mavros_msgs/cmake/real_mavros_msgs.cmake"
    clone = package(tmp_path / "clone/src/mavros_msgs", stand_in=True)
    package(tmp_path / "install/share/mavros_msgs", stand_in=True)
    prefixes = [
        space(workspace / "devel", workspace / "src/mavros_msgs"),
        space(tmp_path / "clone/devel", clone),
    ]
    assert found(find, *prefixes, space(tmp_path / "install")) == ""


def test_a_build_by_hand_refuses_to_hide_the_real_package(tmp_path, workspace):
    package(tmp_path / "opt/share/mavros_msgs")
    environment = dict(os.environ, CMAKE_PREFIX_PATH=str(space(tmp_path / "opt")))
    done = subprocess.run(
        [
            "cmake",
            "-S",
            workspace / "src/mavros_msgs",
            "-B",
            tmp_path / "build",
            f"-DPYTHON_EXECUTABLE={shutil.which('python')}",
        ],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode and f"the real mavros_msgs is in {tmp_path}/opt" in " ".join(
        done.stderr.split()
    )
    assert "CATKIN_IGNORE" in done.stderr


def setup_step(workspace, *prefixes):
    """Runs the step of tools/setup.sh that decides about this package."""
    text = (ROOT / "tools/setup.sh").read_text()
    step = text[text.index("mavros_messages() {") :]
    script = f'set -euo pipefail\nsay() {{ echo "$@"; }}\nDISTRO=debian\n{step[: step.index(chr(10) + "}") + 2]}'
    environment = dict(os.environ, CMAKE_PREFIX_PATH=":".join(str(p) for p in prefixes))
    done = subprocess.run(
        ["bash", "-c", script + "\nmavros_messages"],
        cwd=workspace,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_setup_leaves_the_package_out_and_takes_it_in_again(tmp_path, workspace):
    package(tmp_path / "opt/share/mavros_msgs")
    real, mark = space(tmp_path / "opt"), workspace / "src/mavros_msgs/CATKIN_IGNORE"
    stale = workspace / "devel/lib/python3/dist-packages/mavros_msgs"
    stale.mkdir(parents=True)
    assert setup_step(workspace) == "" and stale.is_dir() and not mark.exists()
    assert "left out" in setup_step(workspace, real) and mark.is_file() and not stale.exists()
    assert setup_step(workspace, real) == ""  # safe to repeat
    assert "is built" in setup_step(workspace) and not mark.exists()
    mark.write_text("")  # written by hand: setup does not take it away
    assert setup_step(workspace) == "" and mark.exists()
