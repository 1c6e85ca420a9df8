# SPDX-License-Identifier: Apache-2.0
"""Fixes of the robot's place from the tags on it that vehicles read."""

import threading
from dataclasses import dataclass, field
from typing import List

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped

from fcsv_geometry import frames
from fcsv_geometry.errors import ConfigError, FcsvError
from fcsv_geometry.messages import transform_from_msg
from fcsv_geometry.ros import node
from fcsv_geometry.ros import telemetry_messages as telemetry
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.telemetry import SeenTags
from fcsv_guidance.place.tag_fix import RobotSight, RobotTagReader, TagFixRules
from fcsv_guidance.robot import load_robot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_stereo.pose_covariance import KnownCovariances
from fcsv_stereo.ros.camera_covariances import subscribe_covariances
from fcsv_tracking.robot_tags import load_robot_tags, readable_m

_PERIOD_S, _POSES_KEPT = 0.5, 60


@dataclass(frozen=True)
class RobotTagsParameters:
    """Parameters of the node. ``robot``: file of the robot, with its tags."""

    vehicles: List[str]
    vehicles_dir: str
    robot: str
    rules: TagFixRules = field(default_factory=TagFixRules)


class RobotTagsNode:
    """/NAME/tags/detections, /NAME/camera_pose, tf from home to NAME/odom -> robot_fix."""

    def __init__(self):
        p = node.parameters(RobotTagsParameters)
        tags = load_robot_tags(p.robot, node.vehicles(p.vehicles_dir, p.vehicles))
        if not tags:
            raise ConfigError(
                f"{p.robot}: 'tags' is missing: no vehicle can read any on this robot"
            )
        self._tags = list(tags.values())
        slope_rad = np.arctan(load_robot(p.robot).largest_slope)
        self._port, self._lock = RobotTagReader(tags, slope_rad, p.rules), threading.Lock()
        self._health = Health("robot_tags", {"robot_fix": 0.2})
        self._known = {n: KnownCovariances(_POSES_KEPT) for n in p.vehicles}
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer)
        self._fixes = rospy.Publisher("robot_fix", PoseWithCovarianceStamped, queue_size=5)
        subscribe_covariances(p.vehicles, self._on_covariance, self._health)
        for n in p.vehicles:
            telemetry.subscribe(n, [SeenTags], self._on_tags, self._health)
        self._timer = node.every(_PERIOD_S, lambda _event: self._tell())

    def _on_covariance(self, name: str, stamp_s: float, covariance: np.ndarray) -> None:
        with self._lock:
            self._known[name].add(stamp_s, covariance)

    def _on_tags(self, seen: SeenTags) -> None:
        name = seen.vehicle
        if seen.T_odom_cam is None:
            return  # counted already
        far_m = readable_m(self._tags, seen.focal_px)
        self._health.value(f"{name} reads the robot's tags to [m]", f"{far_m:.0f}")
        try:
            found = self._buffer.lookup_transform(frames.HOME, frames.odom(name), rospy.Time(0))
            T_home_cam = transform_from_msg(found.transform) @ seen.T_odom_cam
        except (FcsvError, tf2_ros.TransformException) as error:
            self._health.drop("vehicle's place", f"{name}: {error}")
            return
        with self._lock:
            covariance = self._known[name].at(seen.stamp_s)
            if covariance is None:
                why = f"{name}: no camera_pose within half a second of its picture"
                self._health.drop("vehicle's place is stale", why)
                return
            sight = RobotSight(name, seen.stamp_s, T_home_cam, covariance, seen.focal_px, seen.tags)
            fix, dropped = self._port.receive(rospy.get_time(), sight)
        for each in dropped:
            self._health.drop(each.what, each.why)
        if fix is not None:
            self._fixes.publish(messages.fix_message(fix))
            self._health.tick("robot_fix")

    def _tell(self) -> None:
        with self._lock:
            wrong = self._port.step(rospy.get_time())
        self._health.problem("robot", wrong)


def main() -> int:
    """Run the node."""
    return node.run("robot_tags", RobotTagsNode)
