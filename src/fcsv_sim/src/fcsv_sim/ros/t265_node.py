# SPDX-License-Identifier: Apache-2.0
"""The simulated T265 under realsense2_camera's topic and frame names."""

import time

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicle import load_vehicles
from fcsv_sim.t265 import T265, T265Errors
from fcsv_sim.truth import TruthReader

_LATENCY_S = 0.015  # from the middle of its sensing to the sample, as the real one has it


class T265Node:
    """Publishes t265/odom/sample at 200 Hz while the vehicle's truth is there."""

    def __init__(self):
        self._name = rospy.get_param("~vehicle")
        geometry = load_vehicles(rospy.get_param("~vehicles_dir"), [self._name])[self._name]
        errors = T265Errors(takeoff_jump_m=float(rospy.get_param("~takeoff_jump_m", 0.0)))
        seed = rospy.get_param("~seed", 1) * 1000 + geometry.system_id
        self._t265 = T265(errors, geometry.T_body_t265, seed)
        self._truth = TruthReader(rospy.get_param("~sim_dir"), self._name)
        self._period_s = 1.0 / rospy.get_param("~rate_hz", 200.0)
        # the driver's "high" confidence
        self._pose_covariance = (np.diag([1e-3] * 3 + [1e-4] * 3)).ravel().tolist()
        self._publisher = rospy.Publisher("t265/odom/sample", Odometry, queue_size=50)

    def spin(self) -> None:
        """One sample per period; after a hiccup periods are skipped, as a camera would drop frames."""
        due_s = time.time()
        while not rospy.is_shutdown():
            due_s = max(due_s + self._period_s, time.time() - 0.1)
            time.sleep(max(0.0, due_s - time.time()))
            try:
                self._publish(due_s - _LATENCY_S)
            except PoseUnavailable:
                time.sleep(0.1)  # the vehicle is not there yet

    def _publish(self, stamp_s: float) -> None:
        T_odom_t265, linear, angular = self._t265.odometry(stamp_s, self._truth.wait_for(stamp_s))
        message = Odometry(header=conversions.header(stamp_s, f"{self._name}/t265_odom_frame"))
        message.child_frame_id = f"{self._name}/t265_pose_frame"
        q = Quaternion(*transforms.fast_quaternion_xyzw(T_odom_t265))
        message.pose.pose = Pose(Point(*T_odom_t265[:3, 3]), q)
        message.twist.twist = Twist(Vector3(*linear), Vector3(*angular))
        message.pose.covariance = message.twist.covariance = self._pose_covariance
        self._publisher.publish(message)


def main() -> None:
    """Run the node."""
    rospy.init_node("t265")
    T265Node().spin()
