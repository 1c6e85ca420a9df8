# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello's log packets as the Tello's link publishes them: tello/odom and tello/imu, stamped on arrival."""

import time
from collections import deque
from dataclasses import dataclass
from typing import Deque

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import conversions, node
from fcsv_sim.sensors.tello_sensors import TelloErrors, TelloSample, TelloSensors
from fcsv_sim.truth import TruthReader

_LOOK_HZ = 200.0


@dataclass(frozen=True)
class TelloSensorsParameters:
    """Parameters of the node."""

    vehicle: str
    sim_dir: str
    seed: int = 1
    errors: TelloErrors = TelloErrors()


class TelloSensorsNode:
    """Reads the vehicle's truth, publishes packets when they would arrive."""

    def __init__(self):
        p = node.parameters(TelloSensorsParameters)
        self._name = p.vehicle
        self._sensors = TelloSensors(p.errors, p.seed)
        self._truth = TruthReader(p.sim_dir, p.vehicle)
        self._on_the_way: Deque[TelloSample] = deque()
        self._odom = rospy.Publisher("tello/odom", Odometry, queue_size=20, tcp_nodelay=True)
        self._imu = rospy.Publisher("tello/imu", Imu, queue_size=20, tcp_nodelay=True)

    def spin(self) -> None:
        """Until ROS shuts the node down."""
        due_s = time.time()
        while not rospy.is_shutdown():
            due_s = max(due_s + 1.0 / _LOOK_HZ, time.time() - 0.05)
            time.sleep(max(0.0, due_s - time.time()))
            try:
                self._look(due_s - 0.01)
            except PoseUnavailable:
                time.sleep(0.1)  # the vehicle is not there yet
            while self._on_the_way and self._on_the_way[0].arrival_s <= time.time():
                self._publish(self._on_the_way.popleft())

    def _look(self, stamp_s: float) -> None:
        T_world_body = self._truth.wait_for(stamp_s)
        before, after = self._truth.at(stamp_s - 0.005), T_world_body
        v_world = (after[:3, 3] - before[:3, 3]) / 0.005
        self._on_the_way.extend(self._sensors.advance(stamp_s, T_world_body, v_world))

    def _publish(self, sample: TelloSample) -> None:
        name, T, stamp_s = self._name, sample.T_O_D, sample.arrival_s  # not now: this process may be kept waiting
        q = Quaternion(*transforms.fast_quaternion_xyzw(T))
        odometry = Odometry(
            header=conversions.header(stamp_s, frames.tello_odom(name)), child_frame_id=frames.base_link(name)
        )
        odometry.pose.pose = Pose(Point(*T[:3, 3]), q)
        odometry.twist.twist = Twist(Vector3(*(T[:3, :3].T @ sample.v_O_mps)), Vector3(*sample.gyro_radps))
        imu = Imu(header=conversions.header(stamp_s, frames.base_link(name)), orientation=q)
        imu.angular_velocity, imu.linear_acceleration = Vector3(*sample.gyro_radps), Vector3(*sample.accel_mps2)
        imu.orientation_covariance = (np.eye(3) * 1e-5).ravel().tolist()
        self._odom.publish(odometry)
        self._imu.publish(imu)


def main() -> int:
    """Run the node."""
    return node.run("tello_sensors", TelloSensorsNode)
