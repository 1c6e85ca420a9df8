# SPDX-License-Identifier: Apache-2.0
"""Where the robot is by the gimbals on it: the vehicles that they see, wheels, and the vehicles'
own odometry become one pose with covariance."""

import threading
from dataclasses import dataclass, field
from typing import Callable, List

import rospy
from nav_msgs.msg import Odometry, Path
from std_msgs.msg import String

from fcsv_geometry import frames, rotations
from fcsv_geometry.config import require_positive
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_guidance.place.cooperative_place import CooperativeRules
from fcsv_guidance.place.stepped_place import PlaceInSteps, SteppedPlace
from fcsv_guidance.ros import ground_messages as messages
from fcsv_guidance.ros.place_publisher import PlacePublisher
from fcsv_guidance.route.following import RouteToFollow
from fcsv_msgs.msg import Home, VehicleMove
from fcsv_tracking.gimbal.config import load_gimbals

_PERIOD_S = 0.05


@dataclass(frozen=True)
class CooperativePlaceParameters:
    """Parameters of the node. ``robot_file``: where gimbals sit on the robot. ``follow``: vehicles
    are asked to follow the robot's path, on place/move. ``own_odometry``: below each vehicle's name,
    what it says without a tracker. ``start_*``: standard deviation of the robot's place in home when
    home is set."""

    vehicles: List[str]
    vehicles_dir: str
    robot_file: str
    follow: bool = False
    own_odometry: str = "tello/odom"
    start_m: float = 0.01
    start_deg: float = 0.5
    rules: CooperativeRules = field(default_factory=CooperativeRules)

    def __post_init__(self):
        if not self.vehicles:
            raise ValueError("vehicles: is empty; name those that the gimbals follow")
        require_positive(self)
        if self.follow and len(self.vehicles) != 2:
            raise ValueError(f"follow: is for two vehicles, {len(self.vehicles)} are named")
        if not (self.start_m > 0 and self.start_deg > 0):
            raise ValueError("start_m, start_deg: must be positive")


class CooperativePlaceNode:
    """odom, /NAME/gimbal/body (by gimbal_tracker, in the robot's frame), /NAME/tello/odom, /home,
    path -> robot_pose at 20 Hz, while the place is known; place/hold, why the robot shall stand, and
    place/move."""

    def __init__(self):
        p = node.parameters(CooperativePlaceParameters)
        self._T_body_cam = {
            n: v.T_body_cam for n, v in node.vehicles(p.vehicles_dir, p.vehicles).items()
        }
        gimbals = list(load_gimbals(p.robot_file, p.vehicles).values())
        self._port, self._lock = PlaceInSteps(gimbals, p.rules, p.follow), threading.Lock()
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
        rospy.Subscriber("path", Path, self._on_path, queue_size=1)
        self._hold = rospy.Publisher("place/hold", String, queue_size=1, latch=True)
        self._hold.publish(String(""))
        self._held = ""
        self._move = rospy.Publisher("place/move", VehicleMove, queue_size=5)
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

    def _on_path(self, message: Path) -> None:
        try:
            points_m = messages.route_of(message)
            if len(points_m):
                with self._lock:
                    self._port.receive(rospy.get_time(), RouteToFollow(points_m))
        except FcsvError as error:
            self._health.drop("path", str(error))

    def _step(self) -> None:
        with self._lock:
            found = self._port.step(rospy.get_time())
        self._lead(found)
        state = found.robot
        stamp_s = -1.0 if state.place is None else state.place.stamp_s
        self._publisher.publish(state, with_pose=stamp_s > self._stamp_s)
        self._stamp_s = max(self._stamp_s, stamp_s)

    def _lead(self, found: SteppedPlace) -> None:
        """Holds the robot, and sends a vehicle on."""
        if found.robot.hold != self._held:
            self._held = found.robot.hold
            self._hold.publish(String(self._held))
            rospy.loginfo("cooperative_place: %s", self._held or "the robot may drive")
        if found.move is None:
            return
        move, now = found.move, found.vehicles[found.move.vehicle]
        lever_m = rotations.turn_about_z(now.yaw_rad) @ self._T_body_cam[move.vehicle][:3, 3]
        at_m = move.x_m + float(lever_m[0]), move.y_m + float(lever_m[1])
        header = conversions.header(rospy.get_time(), frames.HOME)
        self._move.publish(VehicleMove(header, move.vehicle, *at_m, 0.0, 0.0, False))


def main() -> int:
    """Run the node."""
    return node.run("cooperative_place", CooperativePlaceNode)
