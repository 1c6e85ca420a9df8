# SPDX-License-Identifier: Apache-2.0
"""A simulated robot on the ground under the topics of a real one: cmd_vel in, wheel odometry and
fixes out."""

import csv
import json
import threading
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Optional, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as RosPath
from std_msgs.msg import String

from fcsv_geometry import transforms
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.robot import load_robot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_sim.robot.closing import WayCloser
from fcsv_sim.robot.placed import PlacedRobot, RobotSense
from fcsv_sim.robot.things import Box
from fcsv_sim.truth import TruthWriter
from fcsv_sim.world.movers import CRATE, ROBOT
from fcsv_sim.world.town import Town

_FRAMES = "robot/odom", "robot/base_link"
_ANYHOW_DEG = 999.0
_AWAY_M = -50.0  # below the ground: what is not there


@dataclass(frozen=True)
class RobotNodeParameters:
    """Parameters of the node; ``home_xyz_yaw``: of home in the world (m, rad). ``sim_dir``: where
    cameras and gimbals learn where robot and crate are; empty: none shows them. ``tag``: a vehicle
    reads one on it, and gives fixes; ``yaw_deg``: how it stands, 999: anyhow.
    ``closes``: a crate comes into its way and goes again, noted in ``things``."""

    robot: str  # its file, config/robots/NAME.yaml
    world: str
    truth: str  # file of its true way that is written
    seed: int = 1
    home_xyz_yaw: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    rate_hz: float = 20.0
    sim_dir: str = ""
    tag: bool = True
    yaw_deg: float = _ANYHOW_DEG
    closes: bool = False
    things: str = ""  # file of what came into the way; empty: none is written

    def __post_init__(self):
        if not 5.0 <= self.rate_hz <= 100.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 5..100")


class RobotNode:
    """One loop drives, senses and publishes; where the footprint touches something, it says so and
    stands."""

    def __init__(self):
        p = self._parameters = node.parameters(RobotNodeParameters)
        *xyz_m, yaw_rad = p.home_xyz_yaw
        town, T_world_home = (
            Town.generate(p.seed, p.world),
            transforms.from_xyz_yaw(xyz_m, yaw_rad),
        )
        stands_rad = None if p.yaw_deg == _ANYHOW_DEG else float(np.radians(p.yaw_deg))
        robot = load_robot(p.robot)
        self._port = PlacedRobot(robot, town, T_world_home, p.seed, stands_rad, p.tag)
        self._closer = WayCloser(town.plan, T_world_home, p.seed) if p.closes else None
        names = (ROBOT, CRATE) if p.sim_dir else ()
        self._shown = {name: TruthWriter(p.sim_dir, name) for name in names}
        self._crate: Optional[Box] = None
        self._things = []
        self._lock, self._health = threading.Lock(), Health("robot", {"odom": 0.5 * p.rate_hz})
        Path(p.truth).parent.mkdir(parents=True, exist_ok=True)
        self._truth = open(p.truth, "w", newline="", buffering=1)
        self._rows = csv.writer(self._truth)
        self._rows.writerow(["stamp_s", "x", "y", "yaw", "room_m"])
        self._began_s, self._told = time.time(), False
        self._odometry = rospy.Publisher("odom", Odometry, queue_size=1, tcp_nodelay=True)
        self._fix = rospy.Publisher("robot_fix", PoseWithCovarianceStamped, queue_size=5)
        self._touched = rospy.Publisher("robot/touched", String, queue_size=1, latch=True)
        self._way = rospy.Publisher("robot/way", String, queue_size=5, latch=True)
        rospy.Subscriber("cmd_vel", Twist, self._on_command, queue_size=1, tcp_nodelay=True)
        if self._closer is not None:
            rospy.Subscriber("ground/path", RosPath, self._on_path, queue_size=5)

    def _on_command(self, message: Twist) -> None:
        with self._lock:
            command = DriveCommand(message.linear.x, message.angular.z)
            self._port.receive(time.time() - self._began_s, command)

    def _on_path(self, message: RosPath) -> None:
        with self._lock:
            self._closer.on_route(messages.route_of(message))

    def spin(self) -> None:
        """Runs until ROS shuts the node down."""
        period_s = 1.0 / self._parameters.rate_hz
        due_s = time.time()
        while not rospy.is_shutdown():
            due_s = max(due_s + period_s, time.time())
            time.sleep(max(0.0, due_s - time.time()))
            with self._lock:
                sense = self._port.step(time.time() - self._began_s, self._crate)
                change = ""
                if self._closer is not None:
                    change = self._closer.step(time.time(), *sense.at[:2])
                    self._crate = self._closer.box
            self._show(sense)
            if change:
                self._note(change)
            self._publish(sense)
        self._truth.close()

    def _show(self, sense: RobotSense) -> None:
        """Where cameras see robot and crate."""
        if not self._shown:
            return
        x, y, yaw = sense.at
        box = self._crate
        places = {
            ROBOT: self._port.T_world_robot(x, y, yaw),
            CRATE: transforms.from_xyz_yaw([x, y, _AWAY_M], 0.0)
            if box is None
            else transforms.from_xyz_yaw([box.x_m, box.y_m, box.z_m], box.yaw_rad),
        }
        stamp_s = sense.wheels.stamp_s + self._began_s
        for name, T_world_thing in places.items():
            self._shown[name].write(stamp_s, T_world_thing, np.zeros(3))

    def _note(self, change: str) -> None:
        self._way.publish(String(f"{change} {time.time():.3f}"))
        if self._crate is not None:
            self._things.append(asdict(self._crate))
            if self._parameters.things:
                Path(self._parameters.things).write_text(json.dumps(self._things))

    def _publish(self, sense: RobotSense) -> None:
        stamp_s = sense.wheels.stamp_s + self._began_s
        wheels = replace(sense.wheels, stamp_s=stamp_s)
        self._odometry.publish(messages.odometry_message(wheels, *_FRAMES))
        self._health.tick("odom")
        for fix in sense.fixes:
            fix = replace(fix, stamp_s=fix.stamp_s + self._began_s)
            self._fix.publish(messages.fix_message(fix))
        self._rows.writerow([f"{v:.4f}" for v in (stamp_s, *sense.at, sense.room_m)])
        if sense.touched_m and not self._told:
            self._told = True
            x, y = sense.touched_m
            self._touched.publish(String(f"touches something at ({x:.2f}, {y:.2f}) m (world)"))


def main() -> int:
    """Run the node."""
    return node.run("sim_robot", RobotNode)
