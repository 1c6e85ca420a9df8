# SPDX-License-Identifier: Apache-2.0
"""Where the robot is, from a topic or from tf, for every node that needs it."""

from dataclasses import dataclass
from typing import Callable, Optional

import rospy
import tf2_ros
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.messages import transform_from_msg
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_guidance.errors import DisputedPlaceError
from fcsv_guidance.messages import PlaceLost, RobotPlace
from fcsv_guidance.place.placing import PoseIntake, ReceivedPose

WITH_COVARIANCE, POSE, TF = SOURCES = ("pose_with_covariance", "pose", "tf")
_TF_PERIOD_S = 0.05


@dataclass(frozen=True)
class PlaceParameters:
    """Where a node learns the robot's place."""

    # pose_with_covariance or pose: the type of robot_pose; tf: from home to frame
    source: str = WITH_COVARIANCE
    frame: str = "base_link"  # of the robot, for tf
    # how well its place is known, x and y together, where no covariance says it
    sigma_m: Optional[float] = None

    def __post_init__(self):
        if self.source not in SOURCES:
            raise ValueError(f"source: '{self.source}' is not one of {', '.join(SOURCES)}")
        if self.source != WITH_COVARIANCE and self.sigma_m is None:
            raise ValueError(
                f"sigma_m: is missing; a place by {self.source} does not say how well it is known"
            )
        if self.sigma_m is not None and not self.sigma_m >= 0:
            raise ValueError(f"sigma_m: must be 0 or more, got {self.sigma_m}")


class PlaceSource:
    """Calls ``receive`` with each place; what is none is dropped, counted, and said. Calls ``lose``
    while two programs publish it."""

    def __init__(
        self,
        parameters: PlaceParameters,
        receive: Callable[[RobotPlace], None],
        health: Health,
        lose: Callable[[PlaceLost], None] = lambda _lost: None,
    ):
        self._parameters, self._receive, self._health = parameters, receive, health
        self._lose, self._intake = lose, PoseIntake(parameters.sigma_m)
        self._looked_s = -1.0
        if parameters.source == TF:
            self._buffer = tf2_ros.Buffer()
            self._listener = tf2_ros.TransformListener(self._buffer)
            self._timer = node.every(_TF_PERIOD_S, lambda _event: self._look())
        elif parameters.source == POSE:
            rospy.Subscriber(
                "robot_pose", PoseStamped, self._on_pose, queue_size=1, tcp_nodelay=True
            )
        else:
            rospy.Subscriber(
                "robot_pose",
                PoseWithCovarianceStamped,
                self._on_pose,
                queue_size=1,
                tcp_nodelay=True,
            )

    def _on_pose(self, message) -> None:
        stamped = self._parameters.source == POSE
        pose = message.pose if stamped else message.pose.pose
        covariance = None if stamped else message.pose.covariance
        caller = (getattr(message, "_connection_header", None) or {}).get("callerid", "")
        try:
            T_home_robot = conversions.pose_to_transform(pose)
            self._receive_pose(message.header, T_home_robot, covariance, caller)
        except FcsvError as error:
            self._health.drop("robot_pose", str(error))

    def _look(self) -> None:
        try:
            found = self._buffer.lookup_transform(
                frames.HOME, self._parameters.frame, rospy.Time(0)
            )
            if found.header.stamp.to_sec() != self._looked_s:
                self._looked_s = found.header.stamp.to_sec()
                self._receive_pose(found.header, transform_from_msg(found.transform), None, "tf")
        except (FcsvError, tf2_ros.TransformException) as error:
            self._health.drop("tf of the robot", str(error))

    def _receive_pose(self, header, T_home_robot, covariance, caller: str) -> None:
        stamp_s = header.stamp.to_sec()
        pose = ReceivedPose(stamp_s, header.frame_id, T_home_robot, covariance, caller)
        try:
            place = self._intake.receive(rospy.get_time(), pose)
        except DisputedPlaceError as error:
            self._health.problem("robot_pose", str(error))
            self._lose(PlaceLost(str(error)))
            return
        self._health.problem("robot_pose", "")
        self._health.tick("robot_pose")
        self._receive(place)
