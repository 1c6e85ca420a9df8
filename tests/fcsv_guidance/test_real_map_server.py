# SPDX-License-Identifier: Apache-2.0
"""The pairs of files as the real map_server and amcl read them, where these are installed (ROS
Noetic has them)."""

import shutil
import subprocess

import numpy as np
import pytest
from support.waiting import within

from fcsv_guidance.files.map_files import write_map_server
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import ground_from, stand_probability
from fcsv_guidance.ground.occupancy import FREE_PERCENT, OCCUPIED_PERCENT, occupancy
from fcsv_guidance.robot import load_robot

pytestmark = pytest.mark.ros
until = within(30.0)
GRID = Grid.around((5, -8), (26, 8), 0.1)
BOX = (13.0, 14.0, -2.0, 1.0, 0.0, 0.6)


def require(package):
    """Skips where the package's executable of the same name is not to be had."""
    asked = ["rospack", "find", package]
    if not shutil.which("rospack") or subprocess.run(asked, capture_output=True).returncode:
        debian = package.replace("_", "-")
        pytest.skip(
            f"the ROS package {package} is not installed; Debian has none (ROS Noetic: ros-noetic-{debian})"
        )


@pytest.fixture
def occupied(scene, root):
    ground, robot = (
        ground_from([scene([BOX]).view()], grid=GRID),
        load_robot(root / "config/robots/rescue.yaml"),
    )
    made = occupancy(ground, robot, stand_probability(ground, robot))
    made[0, :3] = 20, 30, 40
    return made


@pytest.fixture
def served(ros_master):
    """served(yaml, name) -> OccupancyGrid that the real map_server publishes of it."""
    import rospy
    from nav_msgs.msg import OccupancyGrid

    require("map_server")
    started = []

    def serve(path, name):
        command = [
            "rosrun",
            "map_server",
            "map_server",
            str(path),
            f"__name:={name}",
            f"map:=/{name}/map",
        ]
        started.append(ros_master.run(command, name))
        return rospy.wait_for_message(f"/{name}/map", OccupancyGrid, 30.0)

    yield serve
    for process in started:
        process.stop()


@pytest.mark.parametrize("scaled", [False, True])
def test_map_server_reads_both_pairs(occupied, served, tmp_path, scaled):
    said = served(
        write_map_server(occupied, GRID, tmp_path, "map", scaled)[1], f"map_server_{int(scaled)}"
    )
    read = np.array(said.data, np.int8).reshape(said.info.height, said.info.width)
    assert said.info.resolution == pytest.approx(0.1) and read.shape == GRID.shape
    assert (said.info.origin.position.x, said.info.origin.position.y) == (GRID.x0_m, GRID.y0_m)
    assert (read[(occupied >= 0) & (occupied <= FREE_PERCENT)] == 0).all() and (
        read[occupied == -1] == -1
    ).all()
    assert (read[occupied > OCCUPIED_PERCENT] == 100).all()
    assert read[GRID.cell_of(13.05, -0.5)] == 100 and read[GRID.cell_of(10, 3)] == 0
    if scaled:
        assert 0 < read[0, 0] < read[0, 1] < read[0, 2] < 100
    else:
        assert (read[0, :3] == -1).all()


def test_amcl_takes_the_map(occupied, served, ros_master, tmp_path):
    require("amcl")
    served(write_map_server(occupied, GRID, tmp_path, "map")[1], "map_server_amcl")
    command = [
        "env",
        "ROSCONSOLE_STDOUT_LINE_BUFFERED=1",
        "rosrun",
        "amcl",
        "amcl",
        "_use_map_topic:=true",
        "map:=/map_server_amcl/map",
        "__name:=amcl_of_test",
    ]
    amcl = ros_master.run(command, "amcl")
    size = f"Received a {GRID.columns} X {GRID.rows} map"
    until(
        lambda: size in amcl.tail(50) or amcl.returncode is not None, what="amcl's word on the map"
    )
    until(
        lambda: "Done initializing likelihood field model" in amcl.tail(50),
        what="its model of the map",
    )
    assert amcl.returncode is None
    amcl.stop()
