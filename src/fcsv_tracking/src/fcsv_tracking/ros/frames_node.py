# SPDX-License-Identifier: Apache-2.0
"""tf2 on every machine, and the pose of every camera in home, from what this machine hears."""

import threading
from typing import Dict, List, Optional

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicle import VehicleGeometry, load_vehicles
from fcsv_msgs.msg import Calibration, Home
from fcsv_tracking.calibration import Link
from fcsv_tracking.chain import odoms_in_home
from fcsv_tracking.ros import link_messages


class FramesNode:
    """Only frames that are known are published; before home there is none above uavN/odom."""

    def __init__(self):
        self._names: List[str] = list(rospy.get_param("~vehicles"))
        self._vehicles = load_vehicles(rospy.get_param("~vehicles_dir"), self._names)
        self._lock = threading.Lock()
        self._links: List[Link] = []
        self._home: Optional[Home] = None
        self._T_home_odom: Dict[str, np.ndarray] = {}
        self._covariances: Dict[str, np.ndarray] = {}
        self._health = Health("frames")
        self._tf = tf2_ros.TransformBroadcaster()
        self._static = tf2_ros.StaticTransformBroadcaster()
        self._static.sendTransform([t for v in self._vehicles.values() for t in _fixed_parts(v)])
        self._cameras = {
            n: rospy.Publisher(f"/{n}/camera_pose", PoseWithCovarianceStamped, queue_size=5) for n in self._names
        }
        self._timer = rospy.Timer(rospy.Duration(0.1), self._publish_home)
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        rospy.Subscriber("/home", Home, self._on_home, queue_size=1)
        for name in self._names:
            rospy.Subscriber(f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=5)

    def _on_calibration(self, message: Calibration) -> None:
        with self._lock:
            self._links = [link_messages.from_message(link) for link in message.links]
        self._recompose()

    def _on_home(self, message: Home) -> None:
        with self._lock:
            self._home = message
        self._recompose()

    def _recompose(self) -> None:
        with self._lock:
            if self._home is None:
                return
            T_odom_home = conversions.pose_to_transform(self._home.home_in_odom)
            self._T_home_odom = odoms_in_home(self._links, self._home.reference, T_odom_home)
            self._covariances = {link.child: link.covariance for link in self._links}

    def _publish_home(self, _event) -> None:
        with self._lock:
            T_home_odom = dict(self._T_home_odom)
        stamp_s = rospy.get_time()
        self._tf.sendTransform(
            [conversions.transform_stamped(T, stamp_s, frames.HOME, frames.odom(n)) for n, T in T_home_odom.items()]
        )

    def _on_odometry(self, message: Odometry, name: str) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", f"{name}: {error}")
            return
        stamp_s = message.header.stamp.to_sec()
        self._tf.sendTransform(
            conversions.transform_stamped(T_odom_body, stamp_s, frames.odom(name), frames.base_link(name))
        )
        with self._lock:
            T_home_odom = self._T_home_odom.get(name)
            link_covariance = self._covariances.get(name)
        if T_home_odom is None:
            return
        out = PoseWithCovarianceStamped(header=conversions.header(stamp_s, frames.HOME))
        out.pose.pose = conversions.transform_to_pose(T_home_odom @ T_odom_body @ self._vehicles[name].T_body_cam)
        out.pose.covariance = _pose_covariance(message, link_covariance).ravel().tolist()
        self._cameras[name].publish(out)


def _pose_covariance(message: Odometry, link_covariance: Optional[np.ndarray]) -> np.ndarray:
    """6x6 about home's axes: the tracker's own, and the calibration's for all but the reference."""
    covariance = np.array(message.pose.covariance, float).reshape(6, 6)
    if link_covariance is not None:
        keep = [0, 1, 2, 5]
        covariance[np.ix_(keep, keep)] += link_covariance
    return covariance


def _fixed_parts(vehicle: VehicleGeometry):
    """Static transforms of one vehicle; the driver's optical frame is ours by definition."""
    n = vehicle.name
    optical = frames.camera_optical(n)
    parts = {
        optical: (frames.base_link(n), vehicle.T_body_cam),
        frames.tag(n): (frames.base_link(n), vehicle.T_body_tag),
        f"{n}/t265_pose_frame": (frames.base_link(n), vehicle.T_body_t265),
        f"{n}/camera_color_optical_frame": (optical, np.eye(4)),
    }
    return [conversions.transform_stamped(T, rospy.get_time(), a, b) for b, (a, T) in parts.items()]


def main() -> None:
    """Run the node."""
    rospy.init_node("frames")
    FramesNode()
    rospy.spin()
