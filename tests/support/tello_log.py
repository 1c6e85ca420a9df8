# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello's log as its link publishes it: tello/odom and tello/imu of a body whose truth
somebody writes."""

import threading
import time
from collections import deque
from typing import Deque

import numpy as np

from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_sim.sensors.tello_sensors import TelloErrors, TelloSample, TelloSensors
from fcsv_sim.truth import TruthReader

_LOOK_S = 0.005


class TelloLog(threading.Thread):
    """Publishes each record when it would arrive, until closed."""

    def __init__(self, name: str, folder, seed: int):
        import rospy
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import Imu

        super().__init__(name=f"log of {name}", daemon=True)
        self._name, self._over = name, threading.Event()
        self._sensors, self._truth = TelloSensors(TelloErrors(), seed), TruthReader(folder, name)
        self._on_the_way: Deque[TelloSample] = deque()
        self._odom = rospy.Publisher(
            f"/{name}/tello/odom", Odometry, queue_size=20, tcp_nodelay=True
        )
        self._imu = rospy.Publisher(f"/{name}/tello/imu", Imu, queue_size=20, tcp_nodelay=True)
        self.start()

    def run(self) -> None:
        due_s = time.time()
        while not self._over.is_set():
            due_s = max(due_s + _LOOK_S, time.time() - 0.05)
            time.sleep(max(0.0, due_s - time.time()))
            try:
                self._look(due_s - 0.01)
            except PoseUnavailable:
                time.sleep(0.1)  # the vehicle is not there yet
            while self._on_the_way and self._on_the_way[0].arrival_s <= time.time():
                self._publish(self._on_the_way.popleft())

    def close(self) -> None:
        self._over.set()
        self.join()
        self._odom.unregister()
        self._imu.unregister()

    def _look(self, stamp_s: float) -> None:
        T_world_body = self._truth.wait_for(stamp_s)
        v_world = (T_world_body[:3, 3] - self._truth.at(stamp_s - _LOOK_S)[:3, 3]) / _LOOK_S
        self._on_the_way.extend(self._sensors.advance(stamp_s, T_world_body, v_world))

    def _publish(self, sample: TelloSample) -> None:
        from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import Imu

        from fcsv_geometry.ros import conversions

        # not now: this process may be kept waiting
        name, T, stamp_s = self._name, sample.T_O_D, sample.arrival_s
        q, gyro = Quaternion(*transforms.fast_quaternion_xyzw(T)), Vector3(*sample.gyro_radps)
        header = conversions.header(stamp_s, frames.tello_odom(name))
        odometry = Odometry(header=header, child_frame_id=frames.base_link(name))
        odometry.pose.pose = Pose(Point(*T[:3, 3]), q)
        odometry.twist.twist = Twist(Vector3(*(T[:3, :3].T @ sample.v_O_mps)), gyro)
        imu = Imu(header=conversions.header(stamp_s, frames.base_link(name)), orientation=q)
        imu.angular_velocity, imu.linear_acceleration = gyro, Vector3(*sample.accel_mps2)
        imu.orientation_covariance = (np.eye(3) * 1e-5).ravel().tolist()
        self._odom.publish(odometry)
        self._imu.publish(imu)
