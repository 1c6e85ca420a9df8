# SPDX-License-Identifier: Apache-2.0
"""Requests to the flight link by its services, with the reason where it refuses."""

import time
from typing import Callable, List, Tuple

import rospy
from geometry_msgs.msg import PointStamped

from fcsv_control.agent.asking import Asking, Shown
from fcsv_control.agent.messages import Ask, Kind
from fcsv_control.errors import ControlError
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import ModeAsked, Refusal
from mavros_msgs.msg import State, StatusText
from mavros_msgs.srv import CommandBool, CommandTOL, SetMode

_REASON_WAIT_S = 0.5  # the reason and the service's answer come by different ways
_POLL_S = 0.01


class LinkServices:
    """``ask`` waits until what it asks for shows; from any thread.

    Our flight link answers when it shows. MAVROS answers a mode when it is sent, and repeats nothing.
    """

    def __init__(self, timeout_s: float):
        self._timeout_s = timeout_s
        self._texts: List[Tuple[float, str]] = []
        self._shown = Shown()
        self._home_m = 0.0
        self._asks = rospy.Publisher("flight_link/mode_asked", ModeAsked, queue_size=10, tcp_nodelay=True)
        self._set_mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
        self._arming = rospy.ServiceProxy("mavros/cmd/arming", CommandBool)
        self._takeoff = rospy.ServiceProxy("mavros/cmd/takeoff", CommandTOL)
        rospy.Subscriber("mavros/statustext/recv", StatusText, self._on_text, queue_size=20)
        rospy.Subscriber("mavros/state", State, self._on_state, queue_size=20, tcp_nodelay=True)
        rospy.Subscriber("flight_link/refusal", Refusal, self._on_refusal, queue_size=5)
        rospy.Subscriber("flight_link/home", PointStamped, self._on_home, queue_size=2)

    def ask(self, ask: Ask) -> None:
        """Raises ControlError with the reason of a refusal; rospy's errors where the service is not there."""
        asked_s = time.monotonic()
        service = {Kind.SET_MODE: self._set_mode, Kind.ARM: self._arming, Kind.TAKEOFF: self._takeoff}[ask.kind]
        rospy.wait_for_service(service.resolved_name, timeout=self._timeout_s)
        if ask.kind is Kind.SET_MODE:
            self._asks.publish(ModeAsked(conversions.header(rospy.get_time(), ""), ask.mode))
            self._until_shown(Asking.mode(self._shown, asked_s, ask.mode), lambda: service(0, ask.mode).mode_sent)
        elif ask.kind is Kind.ARM:
            self._until_shown(Asking.arming(self._shown, asked_s, ask.flag), lambda: service(ask.flag).success)
        elif not service(0, 0, 0, 0, ask.altitude_m - self._home_m).success:
            raise ControlError(self._reason(asked_s))

    def _until_shown(self, asking: Asking, send: Callable[[], bool]) -> None:
        while not asking.over:
            sent_s = time.monotonic()
            if asking.step(sent_s):
                if not send():
                    raise ControlError(self._reason(sent_s))
                asking.answered(time.monotonic())
            time.sleep(_POLL_S)

    def _on_state(self, message: State) -> None:
        self._shown.state(time.monotonic(), message.mode, message.armed)

    def _on_home(self, message: PointStamped) -> None:
        """MAVROS counts a take-off's altitude from the autopilot's home, our own flight link from the odometry's zero;
        that one does not publish this."""
        self._home_m = message.point.z

    def _on_text(self, message: StatusText) -> None:
        if message.severity <= StatusText.WARNING:
            self._texts = [*self._texts[-10:], (time.monotonic(), message.text)]

    def _on_refusal(self, message: Refusal) -> None:
        self._shown.refused(time.monotonic(), message.reason)

    def _reason(self, asked_s: float) -> str:
        """Why the flight link refused since ``asked_s``: the reason comes by another way than the answer. Where there
        is none, what the autopilot said last."""
        until_s = time.monotonic() + _REASON_WAIT_S
        while time.monotonic() < until_s:
            reason = self._shown.refusal(asked_s)
            if reason:
                return reason
            time.sleep(_POLL_S)
        said = [text for at_s, text in self._texts if at_s >= asked_s]
        return ["the flight link refused without a reason", *said][-1]
