# SPDX-License-Identifier: Apache-2.0
"""MAVROS's package as tests need it: the real one where it is installed, else a stand-in of its
name."""

import os
import sys

from roslib.packages import find_node
from rospkg import ResourceNotFound


def installed():
    """Whether the real MAVROS is here."""
    try:
        return bool(find_node("mavros", "mavros_node"))
    except ResourceNotFound:
        return False


def stand_in(folder, command):
    """ROS's path to a package mavros in ``folder`` whose program mavros_node runs the shell's
    ``command``."""
    package, program = folder / "mavros", folder / "mavros/mavros_node"
    package.mkdir()
    (package / "package.xml").write_text('<package format="2"><name>mavros</name></package>')
    program.write_text(f"#!/bin/sh\n{command}\n")
    program.chmod(0o755)
    return f"{folder}:{os.environ['ROS_PACKAGE_PATH']}"


def path_to_mavros(root, folder):
    """ROS's path with a MAVROS on it: where the real one is not installed,
    tests/support/mavros_double.py."""
    if installed():
        return os.environ["ROS_PACKAGE_PATH"]
    return stand_in(folder, f'exec {sys.executable} {root}/tests/support/mavros_double.py "$@"')
