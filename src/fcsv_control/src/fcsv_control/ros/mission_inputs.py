# SPDX-License-Identifier: Apache-2.0
"""What the control PC hears of one vehicle, as the mission's view of it."""

import threading
from typing import Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from fcsv_control.mission.snapshot import VehicleView
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.home import camera_in_home
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_msgs.msg import RecorderStatus, State, TagDetections

_TAG_GAP_S = 2.5  # a camera on a slow computer takes a picture a second
_NEVER_S = float("-inf")


class VehicleInputs:
    """Subscribes to a vehicle's topics; ``front_tag_id`` is the tag that its camera should see (None: the first)."""

    def __init__(self, vehicle: VehicleGeometry, front_tag_id: Optional[int], health: Health):
        self._name, self._T_body_cam = vehicle.name, vehicle.T_body_cam
        self._front_tag_id = front_tag_id
        self._health = health
        self._lock = threading.Lock()
        self._T_odom_body: Optional[np.ndarray] = None
        self._odometry_s = self._state_s = self._recorder_s = _NEVER_S
        self._tag_s = self._tag_since_s = _NEVER_S
        self._speed_mps = float("inf")
        self._z_m = self._ground_z_m = 0.0
        self._state = State()
        self._battery_share = float("nan")
        self._recorder = RecorderStatus()
        subscribe = lambda topic, kind, call: rospy.Subscriber(f"/{self._name}/{topic}", kind, call, queue_size=10)  # noqa: E731
        subscribe("mavros/local_position/pose", PoseStamped, self._on_position)
        subscribe("mavros/battery", BatteryState, self._on_battery)
        subscribe("recorder/status", RecorderStatus, self._on_recorder)
        subscribe("odometry/state", Odometry, self._on_odometry)
        subscribe("mavros/state", State, self._on_state)
        if front_tag_id is not None:
            subscribe("tags/detections", TagDetections, self._on_tags)

    def view(self, now_s: float, T_home_odom: Optional[np.ndarray]) -> VehicleView:
        """The vehicle now; its place in home where ``T_home_odom`` is known."""
        with self._lock:
            known = self._T_odom_body is not None and T_home_odom is not None
            seen = now_s - self._tag_s < _TAG_GAP_S
            return VehicleView(
                pose_age_s=now_s - self._odometry_s,
                speed_mps=self._speed_mps,
                height_m=self._z_m - self._ground_z_m,
                state_age_s=now_s - self._state_s,
                connected=self._state.connected,
                armed=self._state.armed,
                mode=self._state.mode,
                sees_front_s=self._tag_s - self._tag_since_s if seen else 0.0,
                T_home_cam=camera_in_home(T_home_odom, self._T_odom_body, self._T_body_cam) if known else None,
                battery_share=self._battery_share,
                recorder_age_s=now_s - self._recorder_s,
                recorder_problem=self._recorder.problem,
                pictures=None if self._recorder_s == _NEVER_S else self._recorder.pictures,
            )

    def _on_odometry(self, message: Odometry) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", f"{self._name}: {error}")
            return
        v = message.twist.twist.linear
        with self._lock:
            self._T_odom_body, self._odometry_s = T_odom_body, message.header.stamp.to_sec()
            self._speed_mps = float(np.linalg.norm((v.x, v.y, v.z)))

    def _on_position(self, message: PoseStamped) -> None:
        with self._lock:
            self._z_m = message.pose.position.z
            if not self._state.armed:
                self._ground_z_m = self._z_m

    def _on_state(self, message: State) -> None:
        with self._lock:
            self._state, self._state_s = message, message.header.stamp.to_sec()

    def _on_battery(self, message: BatteryState) -> None:
        with self._lock:
            self._battery_share = message.percentage

    def _on_recorder(self, message: RecorderStatus) -> None:
        with self._lock:
            self._recorder, self._recorder_s = message, message.header.stamp.to_sec()

    def _on_tags(self, message: TagDetections) -> None:
        if self._front_tag_id not in [d.id for d in message.detections]:
            return
        with self._lock:
            stamp_s = message.header.stamp.to_sec()
            if stamp_s - self._tag_s > _TAG_GAP_S:
                self._tag_since_s = stamp_s
            self._tag_s = stamp_s
