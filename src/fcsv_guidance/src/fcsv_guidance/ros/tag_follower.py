# SPDX-License-Identifier: Apache-2.0
"""The part of a node that sends a vehicle after the robot whose tags it reads."""

from collections import deque
from dataclasses import dataclass, field
from typing import Callable, Optional, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.messages import transform_from_msg
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros import telemetry_messages as telemetry
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.telemetry import SeenTags
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.messages import OwnVehicle
from fcsv_guidance.place.tag_follower import (
    FlyCamera,
    FollowingCamera,
    InitialPlace,
    TagFollower,
    TagFollowRules,
)
from fcsv_guidance.robot import Robot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_msgs.msg import VehicleMove

_PERIOD_S, _MOST_HEARD = 0.5, 1000


@dataclass(frozen=True)
class TagFollowerParameters:
    """``vehicle`` follows the robot and reads its tags; empty: none does."""

    vehicle: str = ""
    rules: TagFollowRules = field(default_factory=TagFollowRules)


class TagFollowerShell:
    """/NAME/tags/detections, tf from home to NAME/odom, initialpose -> move. ``seen`` gives the
    newest ground and the place (3,) of the camera that watches it, ``tell`` takes where the vehicle
    is. Callbacks file; one timer decides."""

    def __init__(
        self,
        parameters: TagFollowerParameters,
        robot: Robot,
        seen: Callable[[], Tuple[Optional[Ground], Optional[np.ndarray]]],
        tell: Callable[[OwnVehicle], None],
        health: Health,
    ):
        self._vehicle, self._seen, self._tell = parameters.vehicle, seen, tell
        self._ids = {tag.id for tag in robot.tags}
        self._health, self._came = health, deque(maxlen=_MOST_HEARD)
        self._port = TagFollower(robot, parameters.rules)
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer)
        self._moves = rospy.Publisher("move", VehicleMove, queue_size=5)
        telemetry.subscribe(self._vehicle, [SeenTags], self._on_tags, health)
        rospy.Subscriber("initialpose", PoseWithCovarianceStamped, self._on_start, queue_size=1)
        self._timer = node.every(_PERIOD_S, lambda _event: self._step())

    def receive(self, message: object) -> None:
        """A place of the robot, or its route."""
        self._came.append((rospy.get_time(), message))

    def _on_tags(self, seen: SeenTags) -> None:
        if seen.T_odom_cam is None:
            return  # counted already
        try:
            home, own = frames.HOME, frames.odom(self._vehicle)
            found = self._buffer.lookup_transform(home, own, rospy.Time(0))
            T_home_cam = transform_from_msg(found.transform) @ seen.T_odom_cam
            reads = any(tag.id in self._ids for tag in seen.tags)
            self.receive(FollowingCamera(seen.stamp_s, T_home_cam, reads))
        except (FcsvError, tf2_ros.TransformException) as error:
            self._health.drop("vehicle that follows", f"{self._vehicle}: {error}")
            return
        self._tell(OwnVehicle(seen.stamp_s, self._vehicle, T_home_cam[:3, 3]))

    def _on_start(self, message: PoseWithCovarianceStamped) -> None:
        try:
            stamped = PoseStamped(message.header, message.pose.pose)
            self.receive(InitialPlace(*messages.place_of(stamped, "initialpose")))
        except FcsvError as error:
            self._health.drop("initialpose", str(error))

    def _step(self) -> None:
        while self._came:
            try:
                self._port.receive(*self._came.popleft())
            except FcsvError as error:
                self._health.drop("vehicle that follows", f"{self._vehicle}: {error}")
        move = self._port.step(rospy.get_time(), *self._seen())
        self._health.problem("vehicle that follows", self._port.problem)
        if move is not None:
            self._moves.publish(self._message(move))

    def _message(self, move: FlyCamera) -> VehicleMove:
        x_m, y_m, z_m = map(float, move.p_home_cam)
        rospy.loginfo("%s follows the robot: to (%.1f, %.1f, %.1f) m", self._vehicle, x_m, y_m, z_m)
        header = conversions.header(rospy.get_time(), frames.HOME)
        return VehicleMove(header, self._vehicle, x_m, y_m, z_m, move.yaw_rad, True)
