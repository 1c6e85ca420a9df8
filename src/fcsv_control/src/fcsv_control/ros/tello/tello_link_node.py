# SPDX-License-Identifier: Apache-2.0
"""A Tello's flight link as a node, with the topics and services of an ArduCopter's: start it as
``flight_link``."""

import math
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List, Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Joy

from fcsv_control.ros.flight_link.command_services import Commands, CommandServices
from fcsv_control.ros.flight_link.posed import pose_in
from fcsv_control.ros.tello.tello_messages import TelloMessages
from fcsv_control.ros.tello.tello_video import TelloVideo, VideoParameters
from fcsv_control.tello.core import TelloCore
from fcsv_control.tello.library import Hears, RadioParameters, TelloRadio, where
from fcsv_control.tello.messages import (
    FrameMoved,
    GiveSticks,
    LandNow,
    Output,
    StayUp,
    TakeOffNow,
    TelloText,
)
from fcsv_control.tello.observer import ObserverRules
from fcsv_control.tello.pid import PidConfig, Sticks
from fcsv_control.tello.rules import TelloRules
from fcsv_control.tello.telemetry import OwnOdometry, flight_report
from fcsv_geometry import config, frames
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health

_STEP_S = 0.04
_UNREAD_S = 2.0  # flight data that cannot be read for so long: said


@dataclass(frozen=True)
class TelloLinkParameters:
    """Parameters of the node. ``gains``: config/tello/NAME.yaml.

    ``joy_axes`` of ``pilot/joy``: turn, up, left, forward, of which the positive end is left, up,
    left, forward.
    """

    vehicle: str
    gains: str
    joy_axes: List[int] = field(default_factory=lambda: [0, 1, 2, 3])
    radio: RadioParameters = field(default_factory=RadioParameters)
    video: VideoParameters = field(default_factory=VideoParameters)
    rules: TelloRules = field(default_factory=TelloRules)
    observer: ObserverRules = field(default_factory=ObserverRules)

    def __post_init__(self):
        if len(self.joy_axes) != 4 or min(self.joy_axes) < 0:
            raise ValueError(f"joy_axes: {self.joy_axes} must be four numbers of axes")


class TelloLinkNode:
    """The tracker's poses and set-points in, sticks out; whatever arrives goes to the core under
    one lock."""

    def __init__(self):
        p = self._parameters = node.parameters(TelloLinkParameters)
        self._name, self._odom = p.vehicle, frames.odom(p.vehicle)
        self._core = TelloCore(p.vehicle, config.load(p.gains, PidConfig), p.rules, p.observer)
        self._own, self._lock = OwnOdometry(), threading.RLock()
        self._unread_since_s: Optional[float] = None
        self._pilot_s = -math.inf
        self._health = Health(p.vehicle, {"pose feed": 4.0, "flight data": 5.0})
        self._out = TelloMessages(p.vehicle)
        self._radio: Optional[TelloRadio] = None
        self._send: Dict[type, Callable[[Output], None]] = {
            GiveSticks: lambda o: self._radio.sticks(o.sticks),
            TakeOffNow: lambda _o: self._radio.take_off(),
            LandNow: lambda _o: self._radio.land(),
            StayUp: lambda _o: self._radio.stay_up(),
            TelloText: lambda o: self._out.text(o.severity, o.text),
            FrameMoved: lambda o: self._out.moved(o.step_m),
        }
        self._video = (
            TelloVideo(p.vehicle, p.video, self._health, self._key_picture)
            if p.video.calibration
            else None
        )
        on_video = self._video.datagram if self._video else lambda _now_s, _data: None
        hears = Hears(self._on_flight, self._on_imu, self._on_packet, on_video)
        self._radio = TelloRadio(p.vehicle, p.radio, hears)
        rospy.on_shutdown(self._radio.close)
        rospy.loginfo("%s: looks for a Tello at %s %s", p.vehicle, *where(p.radio))
        self._services = CommandServices(self._commands(), self._out.text)
        self._timers = node.every(_STEP_S, self._step), node.every(1.0, self._slowly)
        rospy.Subscriber(
            "mavros/vision_pose/pose", PoseStamped, self._on_pose, queue_size=5, tcp_nodelay=True
        )
        rospy.Subscriber("pilot/joy", Joy, self._on_joy, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber(
            "mavros/setpoint_position/local",
            PoseStamped,
            self._on_set_point,
            queue_size=1,
            tcp_nodelay=True,
        )

    # ---- from the Tello, in tellopy's threads ----------------------------------------------------

    def _on_packet(self, now_s: float) -> None:
        with self._lock:
            self._core.tello_lives(now_s)

    def _on_flight(self, now_s: float, data: Any) -> None:
        report = flight_report(data)
        with self._lock:
            if report is None:
                self._core.tello_lives(now_s)
                self._unread_since_s = self._unread_since_s or now_s
                return
            self._unread_since_s = None
            self._own.height(report.height_m)
            self._core.flight(now_s, report)
        self._health.tick("flight data")

    def _on_imu(self, now_s: float, record: Any) -> None:
        with self._lock:
            motion = self._own.imu(now_s, record)
            if motion is None:
                self._core.tello_lives(now_s)
            else:
                self._core.log(now_s, motion.report)
        if motion is None:
            self._health.drop("log that cannot be")
        else:
            self._out.own(motion)

    def _key_picture(self) -> None:
        if self._radio is not None:  # pictures of one that flew before may come as it is made
            self._radio.key_picture()

    # ---- from ROS --------------------------------------------------------------------------------

    def _on_pose(self, message: PoseStamped) -> None:
        T_odom_body = pose_in(self._odom, message, "pose feed", self._health)
        if T_odom_body is not None:
            now_s = time.monotonic()
            stamp_s = now_s - (rospy.get_time() - message.header.stamp.to_sec())
            with self._lock:
                self._core.pose(now_s, stamp_s, T_odom_body)
            self._health.tick("pose feed")

    def _on_set_point(self, message: PoseStamped) -> None:
        T_odom_body = pose_in(self._odom, message, "set-point", self._health)
        if T_odom_body is not None:
            with self._lock:
                self._core.set_point(T_odom_body)

    def _on_joy(self, message: Joy) -> None:
        axes = self._parameters.joy_axes
        if len(message.axes) <= max(axes) or not np.isfinite(message.axes).all():
            self._health.drop(
                "pilot's sticks", f"{len(message.axes)} axes, where {max(axes) + 1} are expected"
            )
            return
        turn, up, left, forward = (float(np.clip(message.axes[k], -1.0, 1.0)) for k in axes)
        sticks = Sticks(forward, left, up, turn)
        with self._lock:
            self._pilot_s = time.monotonic()
            self._core.pilot(self._pilot_s, sticks)
        self._out.rc(sticks)

    # ---- time ------------------------------------------------------------------------------------

    def _step(self, _event) -> None:
        with self._lock:
            now_s = time.monotonic()
            self._core.step(now_s)
            self._do()
            state, tracking = self._core.state(now_s), self._core.tracking
            pilot = now_s - self._pilot_s <= self._parameters.rules.pilot_old_s
            up = self._core.pilot_stick(now_s).up if pilot else math.nan
            T_odom_body = tracking.T_odom_body
            self._out.health(now_s, state, tracking, up)
        self._out.state(now_s, state, pilot)
        if T_odom_body is not None:
            self._out.pose(T_odom_body)

    def _do(self) -> None:
        for output in self._core.outgoing():
            self._send[type(output)](output)

    def _slowly(self, _event) -> None:
        now_s, name, radio = time.monotonic(), self._name, self._radio
        radio.mind(now_s, video=self._video is not None)
        with self._lock:
            state, unread_s = self._core.state(now_s), self._unread_since_s
            refused = self._core.tracking.observer.refused
        unread = unread_s is not None and now_s - unread_s > _UNREAD_S
        self._health.problem(
            "link", "" if state.connected else f"{name}: no packet of its Tello; look at its Wi-Fi"
        )
        self._health.problem(
            "firmware", f"{name}: flight data of another firmware cannot be read" if unread else ""
        )
        for key, value in (
            ("mode", state.mode),
            ("in the air", state.in_the_air),
            ("Wi-Fi (%)", radio.wifi_percent),
            ("tellopy is connected", radio.connected),
            ("poses refused", refused),
        ):
            self._health.value(key, value)
        if self._video:
            self._video.report(now_s)

    # ---- what the services ask for ---------------------------------------------------------------

    def _commands(self) -> Commands:
        core, at_once = self._core, self._at_once
        return Commands(
            set_mode=lambda mode: at_once(lambda now_s: core.set_mode(now_s, mode)),
            arm=lambda flag: at_once(lambda _now_s: core.arm(flag)),
            take_off=lambda altitude_m: at_once(lambda now_s: core.take_off(now_s, altitude_m)),
        )

    def _at_once(self, action: Callable[[float], None]) -> None:
        with self._lock:
            action(time.monotonic())
            self._do()


def main() -> int:
    """Run the node."""
    return node.run("flight_link", TelloLinkNode)
