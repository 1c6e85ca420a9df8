# SPDX-License-Identifier: Apache-2.0
"""What a Tello's link publishes, under the names and with the meaning that an ArduCopter's link
has."""

import math
import os
import time
from typing import List

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3, Vector3Stamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, Imu

from fcsv_control.tello.messages import TelloState
from fcsv_control.tello.pid import Sticks
from fcsv_control.tello.rules import GUIDED
from fcsv_control.tello.telemetry import OwnMotion
from fcsv_control.tello.tracking import Tracking
from fcsv_geometry import frames, transforms
from fcsv_geometry.ros import conversions
from fcsv_geometry.streams.flow import RateGate
from fcsv_msgs.msg import LinkHealth
from mavros_msgs.msg import RCIn, State, StatusText

_STANDBY, _ACTIVE = 3, 4  # MAV_STATE
_MIDDLE_US, _WAY_US = 1500, 500  # of an RC channel
_HEALTH_HZ, _STATE_S, _BATTERY_HZ = 5.0, 1.0, 1.0
_DRIFTS_M2, _TILT_RAD2 = 1.0, 1e-5


class TelloMessages:
    """Publishers of one vehicle."""

    def __init__(self, name: str):
        self._name, self._odom = name, frames.odom(name)
        self._health_gate, self._battery_gate = RateGate(_HEALTH_HZ), RateGate(_BATTERY_HZ)
        self._published, self._published_s, self._doubt = None, float("-inf"), ""
        self._state = rospy.Publisher("mavros/state", State, queue_size=5, latch=True)
        self._pose = rospy.Publisher(
            "mavros/local_position/pose", PoseStamped, queue_size=5, tcp_nodelay=True
        )
        self._battery = rospy.Publisher("mavros/battery", BatteryState, queue_size=2)
        self._texts = rospy.Publisher("mavros/statustext/recv", StatusText, queue_size=20)
        self._rc = rospy.Publisher("mavros/rc/in", RCIn, queue_size=5)
        self._health = rospy.Publisher("flight_link/health", LinkHealth, queue_size=5)
        self._moved = rospy.Publisher("flight_link/estimate_moved", Vector3Stamped, queue_size=20)
        self._own = rospy.Publisher("tello/odom", Odometry, queue_size=20, tcp_nodelay=True)
        self._imu = rospy.Publisher("tello/imu", Imu, queue_size=20, tcp_nodelay=True)

    def state(self, now_s: float, s: TelloState, pilot: bool) -> None:
        """Where it changed, and once a second; and the battery."""
        now = (
            s.connected,
            s.armed,
            s.mode == GUIDED,
            pilot,
            s.mode,
            _ACTIVE if s.armed else _STANDBY,
        )
        if now != self._published or now_s - self._published_s >= _STATE_S:
            self._published, self._published_s = now, now_s
            self._state.publish(State(conversions.header(rospy.get_time(), ""), *now))
        if self._battery_gate.passes(now_s):
            message = BatteryState(header=conversions.header(rospy.get_time(), ""), present=True)
            message.percentage = s.battery_share
            message.voltage = message.current = message.charge = math.nan
            message.capacity = message.design_capacity = math.nan
            message.power_supply_technology = BatteryState.POWER_SUPPLY_TECHNOLOGY_LIPO
            self._battery.publish(message)

    def health(self, now_s: float, s: TelloState, tracking: Tracking, pilot_up: float) -> None:
        """Five times a second, and at once where there is another doubt. ``pilot_up``: NaN where
        nobody is heard."""
        doubt = tracking.doubt(now_s)
        if doubt == self._doubt and not self._health_gate.passes(now_s):
            return
        self._doubt = doubt
        self._health.publish(
            header=conversions.header(rospy.get_time(), ""),
            connected=s.connected,
            ekf_flags=0,
            ekf_variance=math.nan,
            throttle=pilot_up,
            throttle_age_s=0.0,
            system_status=_ACTIVE if s.armed else _STANDBY,
            origin_set=True,
            parameters_ok=True,
            parameter="",
            feed_rate_hz=tracking.rate_hz(now_s),
            feed_age_s=tracking.age_s(now_s),
            estimate_apart_m=math.nan,
            doubt=doubt,
            pid=os.getpid(),
            in_the_air=-1 if s.in_the_air is None else int(s.in_the_air),
        )

    def pose(self, T_odom_body: np.ndarray) -> None:
        """The estimate for now."""
        self._pose.publish(conversions.pose_stamped(T_odom_body, rospy.get_time(), self._odom))

    def own(self, motion: OwnMotion) -> None:
        """Odometry and IMU of its log, stamped by its tick as if the radio took no time."""
        stamp_s, T = rospy.get_time() - (time.monotonic() - motion.stamp_s), motion.T_own_body
        q, gyro = Quaternion(*transforms.fast_quaternion_xyzw(T)), Vector3(*motion.gyro_radps)
        header = conversions.header(stamp_s, frames.tello_odom(self._name))
        odometry = Odometry(header=header, child_frame_id=frames.base_link(self._name))
        odometry.pose.pose = Pose(Point(*T[:3, 3]), q)
        odometry.pose.covariance = (
            np.diag([_DRIFTS_M2] * 3 + [_TILT_RAD2] * 2 + [_DRIFTS_M2]).ravel().tolist()
        )
        odometry.twist.twist = Twist(Vector3(*motion.v_body_mps), gyro)
        imu = Imu(header=conversions.header(stamp_s, frames.base_link(self._name)), orientation=q)
        imu.angular_velocity, imu.linear_acceleration = gyro, Vector3(*motion.accel_mps2)
        imu.orientation_covariance = (np.eye(3) * _TILT_RAD2).ravel().tolist()
        self._own.publish(odometry)
        self._imu.publish(imu)

    def moved(self, step_m: np.ndarray) -> None:
        """The estimate's frame changed: targets have to move along."""
        message = Vector3Stamped(
            header=conversions.header(rospy.get_time(), self._odom), vector=Vector3(*step_m)
        )
        rospy.loginfo("%s: the tracker's frame counts from now on", self._name)
        self._moved.publish(message)

    def rc(self, sticks: Sticks) -> None:
        """The pilot's sticks as channels: roll, pitch, throttle, yaw."""
        shares = (-sticks.left, sticks.forward, sticks.up, -sticks.turn)
        channels: List[int] = [int(round(_MIDDLE_US + _WAY_US * s)) for s in shares]
        self._rc.publish(conversions.header(rospy.get_time(), ""), 255, channels)

    def text(self, severity: int, text: str) -> None:
        """Publishes a text for people."""
        log = rospy.loginfo if severity >= StatusText.NOTICE else rospy.logwarn
        log("Tello: %s", text)
        self._texts.publish(StatusText(conversions.header(rospy.get_time(), ""), severity, text))
