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
from fcsv_sim.sensors.t265 import T265, T265Errors
from fcsv_sim.truth import TruthReader

_LATENCY_S = 0.015  # from the middle of its sensing to the sample, as the real one has it
_BURST_S = 0.01  # samples of this long leave together: waking up costs more than a sample, here and in who listens


@dataclass(frozen=True)
class T265Parameters:
    """Parameters of the node. ``takeoff_jump_m``: how far the altitude jumps at take-off."""

    vehicle: str
    vehicles_dir: str
    sim_dir: str
    seed: int = 1
    takeoff_jump_m: float = 0.0
    rate_hz: float = 200.0

    def __post_init__(self):
        if not 1.0 <= self.rate_hz <= 400.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..400")


class T265Node:
    """Publishes t265/odom/sample at 200 Hz while the vehicle's truth is there."""

    def __init__(self):
        parameters = node.parameters(T265Parameters)
        self._name = parameters.vehicle
        geometry = node.vehicles(parameters.vehicles_dir, [self._name])[self._name]
        errors = T265Errors(takeoff_jump_m=parameters.takeoff_jump_m)
        seed = parameters.seed * 1000 + geometry.system_id
        self._t265 = T265(errors, geometry.T_body_t265, seed)
        self._truth = TruthReader(parameters.sim_dir, self._name)
        self._period_s = 1.0 / parameters.rate_hz
        self._burst = max(1, round(_BURST_S * parameters.rate_hz))
        # the driver's "high" confidence
        self._pose_covariance = (np.diag([1e-3] * 3 + [1e-4] * 3)).ravel().tolist()
        with warnings.catch_warnings():  # no queue: its thread would cost more than all else here
            warnings.simplefilter("ignore", SyntaxWarning)
            self._publisher = rospy.Publisher("t265/odom/sample", Odometry, queue_size=None)

    def spin(self) -> None:
        """One sample per period; after a hiccup periods are skipped, as a camera would drop frames."""
        due_s = time.time()
        while not rospy.is_shutdown():
            due_s = max(due_s + self._burst * self._period_s, time.time() - 0.1)
            time.sleep(max(0.0, due_s - time.time()))
            try:
                for before in reversed(range(self._burst)):
                    self._publish(due_s - before * self._period_s - _LATENCY_S)
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


def main() -> int:
    """Run the node."""
    return node.run("t265", T265Node)
