# SPDX-License-Identifier: Apache-2.0
"""tf2 on every machine, and the pose of every camera in home, from what this machine hears."""

import threading
from dataclasses import dataclass, field
from typing import Dict, List, Optional

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.home import HomeFrames, Place, camera_in_home
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.streams.flow import RateGate
from fcsv_geometry.vehicles import home_messages
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_msgs.msg import Calibration, Home
from fcsv_tracking.column.camera_covariance import AgeRules, camera_covariance, stale_reason
from fcsv_tracking.column.drift import Drift
from fcsv_tracking.errors import TrackingError
from fcsv_tracking.ros.camera_message import camera_message
from fcsv_tracking.ros.static_frames import fixed_parts


@dataclass(frozen=True)
class FramesParameters:
    """Parameters of the node. ``rate_hz`` is for people and rviz: what needs every pose hears the
    odometry itself."""

    vehicles: List[str]
    vehicles_dir: str
    rate_hz: float = 15.0
    tracker_profile: str = ""  # config/trackers/NAME.yaml; empty: the T265 as TrackerProfile has it
    age: AgeRules = field(default_factory=AgeRules)

    def __post_init__(self):
        if not 1.0 <= self.rate_hz <= 200.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..200")


class FramesNode:
    """Only frames that are known are published; before home there is none above uavN/odom."""

    def __init__(self):
        parameters = node.parameters(FramesParameters)
        self._names = parameters.vehicles
        self._vehicles = node.vehicles(parameters.vehicles_dir, self._names)
        self._lock = threading.Lock()
        self._in_home = HomeFrames(alone=True)
        self._calibrated_s: Optional[float] = None
        tracker = load_profile(parameters.tracker_profile)
        self._drifts: Dict[str, Drift] = {n: Drift(tracker) for n in self._names}
        self._age_rules = parameters.age
        self._gates = {n: RateGate(parameters.rate_hz) for n in self._names}
        self._health = Health("frames", {f"odometry of {n}": 1.0 for n in self._names})
        self._tf = tf2_ros.TransformBroadcaster()
        self._static = tf2_ros.StaticTransformBroadcaster()
        self._static.sendTransform(
            [t for v in self._vehicles.values() for t in fixed_parts(v, tracker)]
        )
        self._cameras = {
            n: rospy.Publisher(f"/{n}/camera_pose", PoseWithCovarianceStamped, queue_size=5)
            for n in self._names
        }
        self._timer = node.every(0.1, self._publish_home)
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        rospy.Subscriber("/home", Home, self._on_home, queue_size=1)
        for name in self._names:
            rospy.Subscriber(
                f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=5
            )

    def _on_calibration(self, message: Calibration) -> None:
        with self._lock:
            try:
                home_messages.apply_calibration(self._in_home, message)
            except FcsvError as error:
                self._health.drop("calibration", str(error))
                return
            self._calibrated_s = message.header.stamp.to_sec()
            for drift in self._drifts.values():
                drift.begin(self._calibrated_s)

    def _on_home(self, message: Home) -> None:
        with self._lock:
            try:
                home_messages.apply_home(self._in_home, message)
            except FcsvError as error:
                self._health.drop("home", str(error))

    def _publish_home(self, _event) -> None:
        with self._lock:
            T_home_odom = self._in_home.T_home_odom
        stamp_s = rospy.get_time()
        self._tf.sendTransform(
            [
                conversions.transform_stamped(T, stamp_s, frames.HOME, frames.odom(n))
                for n, T in T_home_odom.items()
            ]
        )

    def _on_odometry(self, message: Odometry, name: str) -> None:
        stamp_s = message.header.stamp.to_sec()
        if not self._gates[name].passes(stamp_s):
            return
        expected = (frames.odom(name), frames.base_link(name))
        found = (message.header.frame_id, message.child_frame_id)
        try:
            if found != expected:
                raise TrackingError(f"has frames {found}, expected {expected}")
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", f"{name}: {error}")
            return
        self._health.tick(f"odometry of {name}")
        self._tf.sendTransform(conversions.transform_stamped(T_odom_body, stamp_s, *expected))
        with self._lock:
            self._drifts[name].add(stamp_s, T_odom_body[:3, 3])
            place = self._in_home.places.get(name)
        if place is not None:
            self._publish_camera(name, stamp_s, place, T_odom_body, message.pose.covariance)

    def _publish_camera(
        self, name: str, stamp_s: float, place: Place, T_odom_body, tracker
    ) -> None:
        tracker = np.array(tracker, float).reshape(6, 6)
        if not np.isfinite(tracker).all() or (np.diag(tracker) < 0).any():
            self._health.drop("odometry", f"{name}: its covariance is none")
            return
        T_body_cam, drift = self._vehicles[name].T_body_cam, self._drifts[name]
        with self._lock:
            covariance = camera_covariance(place, T_odom_body, T_body_cam, drift, tracker)
        T_home_cam = camera_in_home(place.T_a_b, T_odom_body, T_body_cam)
        self._cameras[name].publish(camera_message(stamp_s, T_home_cam, covariance))
        age_s = None if self._calibrated_s is None else stamp_s - self._calibrated_s
        self._health.problem(name, stale_reason(name, covariance, drift, age_s, self._age_rules))
        self._health.value(f"{name} known to [m]", f"{np.sqrt(np.trace(covariance[:3, :3])):.3f}")
        self._health.value(
            f"{name} yaw known to [deg]", f"{np.degrees(np.sqrt(covariance[5, 5])):.2f}"
        )
        self._health.value(f"{name} flown since calibration [m]", f"{drift.path_m:.0f}")


def main() -> int:
    """Run the node."""
    return node.run("frames", FramesNode)
