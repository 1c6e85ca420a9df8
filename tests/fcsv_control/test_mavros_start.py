# SPDX-License-Identifier: Apache-2.0
"""uav.launch with flight_link:=mavros, and the program that becomes MAVROS's node. No master is
started."""

import os
import subprocess

import pytest
from support import mavros_package


def run(*command, path=None):
    environment = dict(os.environ, ROS_PACKAGE_PATH=path or os.environ["ROS_PACKAGE_PATH"])
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout + done.stderr


def nodes(*arguments, path=None):
    return run(
        "roslaunch",
        "--nodes",
        "fcsv_bringup",
        "uav.launch",
        "uav:=uav1",
        "sim:=true",
        *arguments,
        path=path,
    )


def become(root, path, fcu_url="udpin:127.0.0.1:14550"):
    """The program as the launch file starts it."""
    return run(
        "rosrun",
        "fcsv_control",
        "mavros",
        "--vehicle",
        "uav2",
        "--vehicles-dir",
        str(root / "config/vehicles"),
        "--fcu-url",
        fcu_url,
        "__name:=mavros",
        "__log:=/dev/null",
        path=path,
    )


@pytest.fixture
def path(tmp_path):
    """ROS's path with a MAVROS that says how it was called."""
    return mavros_package.stand_in(tmp_path, 'for a in "$@"; do echo "$a"; done')


def test_the_argument_chooses_which_link_is_started(path):
    assert "/uav1/mavros" not in nodes()[1].split() and "/uav1/flight_link" in nodes()[1].split()
    code, said = nodes("flight_link:=mavros", path=path)
    assert code == 0 and {
        "/uav1/mavros",
        "/uav1/flight_link",
        "/uav1/guardian",
        "/uav1/agent",
    } <= set(said.split())
    code, said = nodes("flight_link:=mavrs")
    assert code and "flight_link_mavrs.launch" in said


@pytest.mark.skipif(mavros_package.installed(), reason="the real MAVROS is installed")
def test_a_missing_mavros_is_named_before_anything_is_started(root):
    code, said = nodes("flight_link:=mavros")
    assert code and "MAVROS is not installed" in said and "docs/user/vehicles.md" in said
    code, said = become(root, None)
    assert code == 2 and "which is not installed here" in said and "ros-noetic-mavros" in said


def test_a_package_without_its_program_is_named(root, tmp_path):
    path = mavros_package.stand_in(tmp_path, "")
    (tmp_path / "mavros/mavros_node").unlink()
    if not mavros_package.installed():
        code, said = become(root, path)
        assert code == 2 and "not its program mavros_node" in said


def test_mavros_is_told_address_and_ids_of_its_vehicle(root, path):
    code, said = become(root, path)
    assert code == 0
    assert {
        "_fcu_url:=udp://127.0.0.1:14550@",
        "_gcs_url:=",
        "_system_id:=2",
        "_target_system_id:=2",
        "_component_id:=240",
        "__name:=mavros",
        "__log:=/dev/null",
    } <= set(said.split("\n"))


def test_an_address_that_it_does_not_understand_is_named(root, path):
    code, said = become(root, path, "usb:0")
    assert code == 2 and "'usb:0' is none that MAVROS understands" in said
