# SPDX-License-Identifier: Apache-2.0
"""Where the robot is by the gimbals on it: the vehicles that they see, wheels, and the vehicles'
own odometry become one pose with covariance."""

import threading
from dataclasses import dataclass, field
from typing import Callable, List

import rospy
from nav_msgs.msg import Odometry

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_guidance.cooperative_place import CooperativeRules, CooperativeTracker
from fcsv_guidance.ros import ground_messages as messages
from fcsv_guidance.ros.place_publisher import PlacePublisher
from fcsv_msgs.msg import Home

_PERIOD_S = 0.05


@dataclass(frozen=True)
class CooperativePlaceParameters:
    """Parameters of the node. ``own_odometry``: below each vehicle's name, what it says without a
    tracker. ``start_*``: standard deviation of the robot's place in home when home is set."""

    vehicles: List[str]
    own_odometry: str = "tello/odom"
    start_m: float = 0.01
    start_deg: float = 0.5
    rules: CooperativeRules = field(default_factory=CooperativeRules)

    def __post_init__(self):
        if not self.vehicles:
            raise ValueError("vehicles: is empty; name those that the gimbals follow")
        if not (self.start_m > 0 and self.start_deg > 0):
            raise ValueError("start_m, start_deg: must be positive")


class CooperativePlaceNode:
    """odom, /NAME/gimbal/body (by gimbal_tracker, in the robot's frame), /NAME/tello/odom, /home
    -> robot_pose at 20 Hz, while the place is known."""

    def __init__(self):
        p = node.parameters(CooperativePlaceParameters)
        self._p, self._port, self._lock = p, CooperativeTracker(p.rules), threading.Lock()
        flows = {f"{name} seen": 1.0 for name in p.vehicles}
        self._health = Health("cooperative_place", {"odom": 5.0, **flows})
        self._stamp_s = -1.0  # of the pose that was told last
        counted = "sightings used, messages refused"
        self._publisher = PlacePublisher("cooperative_place", counted, self._health)
        self._subscribe("odom", Odometry, "odom", messages.wheels_of)
        for name in p.vehicles:
            seen, own = f"/{name}/gimbal/body", f"/{name}/{p.own_odometry}"
            self._subscribe(seen, Odometry, f"{name} seen", messages.sighting_of, name)
            self._subscribe(own, Odometry, f"{name} odometry", messages.vehicle_odometry_of, name)
        self._subscribe("/home", Home, "home", messages.robot_start_of, p.start_m, p.start_deg)
        self._timer = node.every(_PERIOD_S, lambda _event: self._step())

    def _subscribe(self, topic: str, kind: type, flow: str, convert: Callable, *more) -> None:
        def receive(message) -> None:
            try:
                converted = convert(message, *more)
            except FcsvError as error:
                self._health.drop(flow, str(error))
                return
            with self._lock:
                self._port.receive(rospy.get_time(), converted)
            self._health.tick(flow)

        rospy.Subscriber(topic, kind, receive, queue_size=20, tcp_nodelay=True)

    def _step(self) -> None:
        with self._lock:
            state = self._port.step(rospy.get_time()).robot
        stamp_s = -1.0 if state.place is None else state.place.stamp_s
        self._publisher.publish(state, with_pose=stamp_s > self._stamp_s)
        self._stamp_s = max(self._stamp_s, stamp_s)


def main() -> int:
    """Run the node."""
    return node.run("cooperative_place", CooperativePlaceNode)
