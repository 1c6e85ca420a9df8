# SPDX-License-Identifier: Apache-2.0
"""What the control PC hears of one vehicle: topics into the mission's view of it, by the time at which they came."""

import threading
import time
from typing import Callable, Dict, Optional, Sequence

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from fcsv_control.guardian.messages import in_words
from fcsv_control.mission.heard import VehicleHeard
from fcsv_control.mission.snapshot import RecorderView, VehicleView
from fcsv_geometry.arrivals import Arrivals
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.ros.relay_ages import hear_ages, publisher_of
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_msgs.msg import Epoch, Epochs, GuardianState, RecorderStatus, TagDetection, TagDetections
from mavros_msgs.msg import State


class RecorderInput:
    """The control PC's own recorder, by the name under which it records."""

    def __init__(self, name: str):
        self._heard = (float("-inf"), "")
        rospy.Subscriber(f"/{name}/recorder/status", RecorderStatus, self._on_status, queue_size=5)

    def view(self, now_s: float) -> RecorderView:
        """``now_s``: monotonic."""
        heard_s, problem = self._heard
        return RecorderView(now_s - heard_s, problem)

    def _on_status(self, m: RecorderStatus) -> None:
        self._heard = (time.monotonic(), m.problem)


class VehicleInputs:
    """Subscribes to a vehicle's topics; ``front_tag_id`` is the tag that its camera should see (None: the first).
    ``arrivals``: from when what came over the radio counts."""

    def __init__(self, vehicle: VehicleGeometry, front_tag_id: Optional[int], health: Health, arrivals: Arrivals):
        self._name, self._arrivals = vehicle.name, arrivals
        since_s = lambda t, s: arrivals.since_s(f"/{vehicle.name}/{t}", s)  # noqa: E731
        self._heard = VehicleHeard(vehicle.T_body_cam, since_s, vehicle.T_body_tag)
        self._front_tag_id = front_tag_id
        self._health = health
        self._lock = threading.Lock()
        subscribe = lambda topic, kind, call: rospy.Subscriber(  # noqa: E731
            f"/{self._name}/{topic}", kind, self._noting(topic, call), queue_size=10
        )
        subscribe("mavros/local_position/pose", PoseStamped, self._on_position)
        subscribe("mavros/battery", BatteryState, self._on_battery)
        subscribe("recorder/status", RecorderStatus, self._on_recorder)
        subscribe("odometry/state", Odometry, self._on_odometry)
        subscribe("odometry/epoch", Epoch, self._on_epoch)
        subscribe("mavros/state", State, self._on_state)
        subscribe("guardian/state", GuardianState, self._on_guardian)
        for what in ("calibration", "home"):
            rospy.Subscriber(f"/{what}_epochs", Epochs, self._on_epochs, what, queue_size=1)
        if front_tag_id is not None:
            subscribe("tags/detections", TagDetections, self._on_tags)

    def _noting(self, topic: str, take: Callable) -> Callable:
        """``take``, once the message was noted as one that came from a relay, or not."""
        name = f"/{self._name}/{topic}"

        def heard_of(message) -> None:
            self._arrivals.came(name, publisher_of(message))
            take(message)

        return heard_of

    def view(self, now_s: float, T_home_odom: Optional[np.ndarray]) -> VehicleView:
        """The vehicle at monotonic time ``now_s``; its place in home where ``T_home_odom`` is known."""
        with self._lock:
            return self._heard.view(now_s, T_home_odom)

    def _on_odometry(self, message: Odometry) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", f"{self._name}: {error}")
            return
        v = message.twist.twist.linear
        with self._lock:
            self._heard.odometry(time.monotonic(), T_odom_body, (v.x, v.y, v.z))

    def _on_epoch(self, m: Epoch) -> None:
        with self._lock:
            self._heard.epochs.now, self._heard.epochs.reason = m.epoch, m.reason

    def _on_epochs(self, m: Epochs, what: str) -> None:
        with self._lock:
            setattr(self._heard.epochs, what, conversions.epochs_of(m).get(self._name))

    def _on_position(self, message: PoseStamped) -> None:
        with self._lock:
            self._heard.position(message.pose.position.z)

    def _on_state(self, m: State) -> None:
        with self._lock:
            self._heard.state(time.monotonic(), m.mode, m.armed, m.connected)

    def _on_guardian(self, m: GuardianState) -> None:
        with self._lock:
            self._heard.guardian(time.monotonic(), in_words(m.action, m.reasons), m.lost, m.lost_s)

    def _on_battery(self, message: BatteryState) -> None:
        with self._lock:
            self._heard.battery(time.monotonic(), conversions.battery_share(message))

    def _on_recorder(self, m: RecorderStatus) -> None:
        with self._lock:
            self._heard.recorder(time.monotonic(), m.problem, m.pictures)

    def _on_tags(self, message: TagDetections) -> None:
        for detection in message.detections:
            if detection.id == self._front_tag_id:
                p_odom_tag = self._in_odom(message, detection)
                with self._lock:
                    self._heard.front_tag(time.monotonic(), p_odom_tag)

    def _in_odom(self, message: TagDetections, detection: TagDetection) -> Optional[np.ndarray]:
        try:
            T_odom_cam = conversions.pose_to_transform(message.camera_in_odom)
            return (T_odom_cam @ conversions.pose_to_transform(detection.tag_in_camera))[:3, 3]
        except FcsvError as error:
            self._health.drop("tag in front", f"{self._name}: {error}")
            return None


def inputs_of(column: Sequence[VehicleGeometry], health: Health) -> Dict[str, VehicleInputs]:
    """Of every vehicle, by name; the front one is first. Each but that one sees the tag of the one in front."""
    arrivals = Arrivals()
    hear_ages(arrivals)
    fronts = [None, *(v.tag_id for v in column[:-1])]
    return {v.name: VehicleInputs(v, front, health, arrivals) for v, front in zip(column, fronts)}
