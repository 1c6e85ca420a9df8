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
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_guidance.place.mapped_camera import MappedCamera
from fcsv_guidance.place.tag_fix import RobotSight, RobotTagReader, TagFixRules
from fcsv_guidance.robot import load_robot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_msgs.msg import Calibration, Home, RefinedCameras
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
    tracker_profile: str = ""  # as in uav.launch; empty: the T265's
    rules: TagFixRules = field(default_factory=TagFixRules)


class RobotTagsNode:
    """/NAME/tags/detections, /NAME/camera_pose, tf from home to NAME/odom, /map/refined ->
    robot_fix."""

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
        profile = load_profile(p.tracker_profile)
        self._mapped = {n: MappedCamera(profile) for n in p.vehicles}
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer)
        self._fixes = rospy.Publisher("robot_fix", PoseWithCovarianceStamped, queue_size=5)
        subscribe_covariances(p.vehicles, self._on_covariance, self._health)
        for topic, kind in (("/calibration", Calibration), ("/home", Home)):
            rospy.Subscriber(topic, kind, self._on_frame, queue_size=1)
        rospy.Subscriber("/map/refined", RefinedCameras, self._on_refined, queue_size=5)
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
            T_home_odom = transform_from_msg(found.transform)
        except (FcsvError, tf2_ros.TransformException) as error:
            self._health.drop("vehicle's place", f"{name}: {error}")
            return
        with self._lock:
            T_home_cam, covariance = self._placed(seen, T_home_odom)
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

    def _placed(self, seen: SeenTags, T_home_odom: np.ndarray) -> tuple:
        """T_home_cam and its covariance: by a map in which a picture of the vehicle took part, else
        as its tracker tells; no covariance where that is stale."""
        camera = self._mapped[seen.vehicle]
        corrected = camera.corrected(seen.stamp_s, T_home_odom, seen.T_odom_cam)
        told = self._known[seen.vehicle].at(seen.stamp_s)
        if told is None:
            corrected = None
        self._health.value(f"{seen.vehicle}'s place", "by a map" if corrected else "by its tracker")
        if corrected is not None:
            return corrected
        return T_home_odom @ seen.T_odom_cam, told

    def _on_refined(self, message: RefinedCameras) -> None:
        try:
            found = messages.refined_of(message)
        except FcsvError as error:
            self._health.drop("map", str(error))
            return
        with self._lock:
            for each in found:
                if each.vehicle in self._mapped:
                    self._mapped[each.vehicle].refine(each)

    def _on_frame(self, message) -> None:
        with self._lock:
            for camera in self._mapped.values():
                camera.framed(message.header.stamp.to_sec())

    def _tell(self) -> None:
        with self._lock:
            wrong = self._port.step(rospy.get_time())
        self._health.problem("robot", wrong)


def main() -> int:
    """Run the node."""
    return node.run("robot_tags", RobotTagsNode)
