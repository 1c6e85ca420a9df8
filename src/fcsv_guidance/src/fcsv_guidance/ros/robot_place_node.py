# SPDX-License-Identifier: Apache-2.0
"""Where the robot is: fixes from outside and wheel odometry become one pose with covariance."""

import threading
from dataclasses import dataclass, field, replace

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_guidance.place.tracker import PlaceRules, RobotTracker
from fcsv_guidance.robot import load_robot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_guidance.ros.place_publisher import PlacePublisher


@dataclass(frozen=True)
class RobotPlaceParameters:
    """Parameters of the node."""

    robot: str = ""  # its file: wheels that go twice as fast have jumped; empty: not known
    rules: PlaceRules = field(default_factory=PlaceRules)


class RobotPlaceNode:
    """robot_fix, odom -> robot_pose with each odometry, while the place is known."""

    def __init__(self):
        p = node.parameters(RobotPlaceParameters)
        rules = p.rules
        if p.robot:
            rules = replace(rules, wheels=rules.wheels.of_robot(load_robot(p.robot)))
        self._port = RobotTracker(rules)
        self._lock = threading.Lock()
        self._health = Health("robot_place", {"odom": 5.0, "robot_fix": 0.2})
        self._publisher = PlacePublisher("robot_place", "fixes used, refused", self._health)
        rospy.Subscriber("robot_fix", PoseWithCovarianceStamped, self._on_fix, queue_size=20)
        rospy.Subscriber("odom", Odometry, self._on_wheels, queue_size=20, tcp_nodelay=True)

    def _on_fix(self, message: PoseWithCovarianceStamped) -> None:
        try:
            fix = messages.fix_of(message)
        except FcsvError as error:
            self._health.drop("robot_fix", str(error))
            return
        with self._lock:
            self._port.receive(rospy.get_time(), fix)
        self._health.tick("robot_fix")

    def _on_wheels(self, message: Odometry) -> None:
        try:
            wheels = messages.wheels_of(message)
        except FcsvError as error:
            self._health.drop("odom", str(error))
            return
        now_s = rospy.get_time()
        with self._lock:
            self._port.receive(now_s, wheels)
            state = self._port.step(now_s)
        self._health.tick("odom")
        self._publisher.publish(state)


def main() -> int:
    """Run the node."""
    return node.run("robot_place", RobotPlaceNode)
