# SPDX-License-Identifier: Apache-2.0
"""What a node that locates the robot tells: its pose, and why that is not known."""

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import String

from fcsv_geometry.ros.health import Health, without_numbers
from fcsv_guidance.place.tracker import PlaceState
from fcsv_guidance.ros import ground_messages as messages

_WARN_EVERY_S = 5.0


class PlacePublisher:
    """robot_pose, place/status, and diagnostics of node ``name``. ``counted``: what its two numbers
    count."""

    def __init__(self, name: str, counted: str, health: Health):
        self._name, self._counted, self._health = name, counted, health
        self._last, self._last_refusal = "", ""
        self._pose = rospy.Publisher(
            "robot_pose", PoseWithCovarianceStamped, queue_size=1, tcp_nodelay=True
        )
        self._status = rospy.Publisher("place/status", String, queue_size=1, latch=True)

    def publish(self, state: PlaceState, with_pose: bool = True) -> None:
        """The pose where it is known, its reason once where it changes, a refusal now and then."""
        self._health.value(self._counted, f"{state.used}, {state.refused}")
        self._health.value("last refusal", state.last_refusal)
        if state.last_refusal != self._last_refusal:
            self._last_refusal = state.last_refusal
            rospy.logwarn_throttle(_WARN_EVERY_S, f"{self._name}: {state.last_refusal}")
        self._health.problem("place", state.reason)
        if state.place is not None and with_pose:
            self._pose.publish(messages.place_message(state))
        text = state.reason or "the robot's place is known"
        if without_numbers(text) != self._last:
            self._last = without_numbers(text)
            rospy.loginfo("%s: %s", self._name, text)
            self._status.publish(String(text))
