# SPDX-License-Identifier: Apache-2.0
"""Whoever sends a simulated robot to its goal: gives the goal, notes what guidance says, and ends
with the drive."""

import json
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Tuple

import rospy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as RosPath
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import String

from fcsv_geometry import frames, transforms
from fcsv_geometry.ros import conversions, node
from fcsv_guidance.ros import ground_messages as messages
from fcsv_sim.robot.sent import DriveLimits, SentRobot

_PERIOD_S = 0.1


@dataclass(frozen=True)
class RobotGoalParameters:
    """Parameters of the node."""

    goal_m: Tuple[float, float]  # x, y in home
    out: str  # file that is written at the end: robot/sent.py, SentDrive
    limits: DriveLimits = DriveLimits()


class RobotGoalNode:
    """Waits for a grid and the robot's place, publishes the goal, and ends when the drive is
    over."""

    def __init__(self):
        p = self._parameters = node.parameters(RobotGoalParameters)
        self._port, self._lock = SentRobot(p.goal_m, p.limits), threading.Lock()
        self._goal = rospy.Publisher("move_base_simple/goal", PoseStamped, queue_size=1, latch=True)
        rospy.Subscriber("map", OccupancyGrid, self._on_grid, queue_size=1, buff_size=1 << 24)
        rospy.Subscriber("robot_pose", PoseWithCovarianceStamped, self._on_place, queue_size=1)
        rospy.Subscriber("cmd_vel", Twist, self._on_command, queue_size=1)
        rospy.Subscriber("path", RosPath, self._on_path, queue_size=5)
        for topic in ("status", "follower/status"):
            rospy.Subscriber(topic, String, self._on_words, topic, queue_size=20)
        rospy.Subscriber("/robot/way", String, self._on_way, queue_size=5)
        rospy.Subscriber("hold", String, self._on_hold, queue_size=5)
        rospy.Subscriber("/map/watch/camera_info", CameraInfo, self._on_depth, queue_size=5)
        rospy.Subscriber("/robot/touched", String, self._on_touched, queue_size=1)

    def _on_grid(self, _message: OccupancyGrid) -> None:
        with self._lock:
            self._port.on_grid()

    def _on_place(self, message: PoseWithCovarianceStamped) -> None:
        at = message.pose.pose.position
        with self._lock:
            self._port.on_place(at.x, at.y)

    def _on_command(self, message: Twist) -> None:
        with self._lock:
            self._port.on_command(time.time(), message.linear.x, message.angular.z)

    def _on_path(self, message: RosPath) -> None:
        with self._lock:
            self._port.on_route(time.time(), messages.route_of(message))

    def _on_words(self, message: String, topic: str) -> None:
        with self._lock:
            self._port.on_words(time.time(), topic, message.data)

    def _on_way(self, message: String) -> None:
        with self._lock:
            self._port.way.on_way(message.data)

    def _on_hold(self, message: String) -> None:
        with self._lock:
            self._port.way.on_hold(time.time(), message.data)

    def _on_depth(self, message: CameraInfo) -> None:
        with self._lock:
            self._port.way.on_depth(time.time(), messages.stamp_of(message))

    def _on_touched(self, message: String) -> None:
        with self._lock:
            self._port.on_touched(message.data)

    def spin(self) -> None:
        """Runs until the drive is over; then the node ends."""
        while not rospy.is_shutdown():
            time.sleep(_PERIOD_S)
            with self._lock:
                goal, drive = self._port.step(time.time())
            if goal is not None:
                T_home_goal = transforms.from_xyz_yaw([*goal, 0.0], 0.0)
                self._goal.publish(conversions.pose_stamped(T_home_goal, time.time(), frames.HOME))
            if drive is not None:
                Path(self._parameters.out).write_text(json.dumps(asdict(drive), indent=1))
                return


def main() -> int:
    """Run the node."""
    return node.run("robot_goal", RobotGoalNode)
