# SPDX-License-Identifier: Apache-2.0
"""The simulated T265 under realsense2_camera's topic and frame names."""

import time
import warnings
from dataclasses import dataclass

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_sim.sensors.t265 import T265
from fcsv_sim.truth import TruthReader

# samples of this long leave together: waking up costs more than a sample, here and in who listens
_BURST_S = 0.01


@dataclass(frozen=True)
class T265Parameters:
    """Parameters of the node. ``takeoff_jump_m``: how far the altitude jumps at take-off.

    ``tracker_profile``: the file of what this tracker does, which may be other than what tracking
    assumes.
    """

    vehicle: str
    vehicles_dir: str
    sim_dir: str
    seed: int = 1
    takeoff_jump_m: float = 0.0
    tracker_profile: str = ""


class T265Node:
    """Publishes t265/odom/sample at the profile's rate while the vehicle's truth is there."""

    def __init__(self):
        parameters = node.parameters(T265Parameters)
        self._name = parameters.vehicle
        geometry = node.vehicles(parameters.vehicles_dir, [self._name])[self._name]
        self._profile = load_profile(parameters.tracker_profile)
        rospy.loginfo("%s", self._profile)
        seed = parameters.seed * 1000 + geometry.system_id
        self._t265 = T265(self._profile, geometry.T_body_t265, seed, parameters.takeoff_jump_m)
        self._truth = TruthReader(parameters.sim_dir, self._name)
        self._burst = max(1, round(_BURST_S * self._profile.rate_hz))
        # the driver's "high" confidence
        self._pose_covariance = (np.diag([1e-3] * 3 + [1e-4] * 3)).ravel().tolist()
        with warnings.catch_warnings():  # no queue: its thread would cost more than all else here
            warnings.simplefilter("ignore", SyntaxWarning)
            self._publisher = rospy.Publisher("t265/odom/sample", Odometry, queue_size=None)

    def spin(self) -> None:
        """One sample per period; after a hiccup periods are skipped, as a camera would drop
        frames."""
        due_s = time.time()
        while not rospy.is_shutdown():
            due_s = max(due_s + self._burst * self._profile.period_s, time.time() - 0.1)
            time.sleep(max(0.0, due_s - time.time()))
            try:
                for before in reversed(range(self._burst)):
                    self._publish(due_s - before * self._profile.period_s - self._profile.latency_s)
            except PoseUnavailable:
                time.sleep(0.1)  # the vehicle is not there yet

    def _publish(self, stamp_s: float) -> None:
        T_odom_t265, linear, angular = self._t265.odometry(stamp_s, self._truth.wait_for(stamp_s))
        message = Odometry(header=conversions.header(stamp_s, self._profile.odom_frame(self._name)))
        message.child_frame_id = self._profile.pose_frame(self._name)
        q = Quaternion(*transforms.fast_quaternion_xyzw(T_odom_t265))
        message.pose.pose = Pose(Point(*T_odom_t265[:3, 3]), q)
        message.twist.twist = Twist(Vector3(*linear), Vector3(*angular))
        message.pose.covariance = message.twist.covariance = self._pose_covariance
        self._publisher.publish(message)


def main() -> int:
    """Run the node."""
    return node.run("t265", T265Node)
