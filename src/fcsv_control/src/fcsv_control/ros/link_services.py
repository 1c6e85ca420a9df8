# SPDX-License-Identifier: Apache-2.0
"""Requests to the flight link by its services, with the reason where it refuses."""

import time
from typing import Callable, Dict, List, Tuple

import rospy
from geometry_msgs.msg import PointStamped

from fcsv_control.agent.messages import STOPPING_MODES, Ask, Kind
from fcsv_control.errors import ControlError
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import ModeAsked, Refusal
from mavros_msgs.msg import State, StatusText
from mavros_msgs.srv import CommandBool, CommandTOL, SetMode

_REASON_WAIT_S = 0.5  # the reason and the service's answer come by different ways
_SHOWS_S, _STOP_PATIENCE_S, _STOP_REPEAT_S = 2.5, 5.0, 0.2  # as the flight link has them
_POLL_S = 0.01


class _NotShown(ControlError):
    """What was asked for does not show yet."""


class LinkServices:
    """``ask`` waits until what it asks for shows; from any thread.

    Our flight link answers when it shows. MAVROS answers a mode when it is sent, and repeats nothing.
    """

    def __init__(self, timeout_s: float):
        self._timeout_s = timeout_s
        self._texts: List[Tuple[float, str]] = []
        self._refusals: List[Tuple[float, str]] = []
        self._state = State()
        self._shown: Dict[str, float] = {}  # when a mode was heard last
        self._asked_mode = 0  # the newest request for a mode: older ones are over
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
            self._ask_mode(asked_s, ask.mode)
        elif ask.kind is Kind.ARM:
            self._require(asked_s, service(ask.flag).success)
            what = "arming" if ask.flag else "disarming"
            self._wait(asked_s, lambda: self._state.armed == ask.flag, what, _SHOWS_S)
        else:
            self._require(asked_s, service(0, 0, 0, 0, ask.altitude_m - self._home_m).success)

    def _ask_mode(self, asked_s: float, mode: str) -> None:
        """A mode that stops is sent again until it shows, however it was answered."""
        self._asks.publish(ModeAsked(conversions.header(rospy.get_time(), ""), mode))
        self._asked_mode += 1
        number, stops = self._asked_mode, mode in STOPPING_MODES

        def shows() -> bool:
            if number != self._asked_mode:
                raise ControlError(f"mode {mode} was overtaken by a newer command")
            return self._state.mode == mode or self._shown.get(mode, float("-inf")) >= asked_s

        until_s = asked_s + (_STOP_PATIENCE_S if stops else _SHOWS_S)
        while True:
            self._require(asked_s, self._set_mode(0, mode).mode_sent)
            left_s = until_s - time.monotonic()
            try:
                self._wait(asked_s, shows, f"mode {mode}", min(left_s, _STOP_REPEAT_S) if stops else left_s)
                return
            except _NotShown as error:
                if time.monotonic() >= until_s:
                    raise ControlError(str(error)) from error

    def _require(self, asked_s: float, done: bool) -> None:
        if not done:
            raise ControlError(self._reason(asked_s))

    def _wait(self, asked_s: float, shows: Callable[[], bool], what: str, patience_s: float) -> None:
        """Raises _NotShown; ControlError where the autopilot refused meanwhile, and what ``shows`` raises."""
        until_s = time.monotonic() + patience_s
        while not shows():
            refused = _since(asked_s, self._refusals)
            if refused:
                raise ControlError(refused[-1])
            if time.monotonic() >= until_s:
                s = self._state
                armed = "armed" if s.armed else "not armed"
                raise _NotShown(f"{what} was sent, but the vehicle is in {s.mode or 'no mode'}, {armed}")
            time.sleep(_POLL_S)

    def _on_state(self, message: State) -> None:
        self._state = message
        self._shown = {**self._shown, message.mode: time.monotonic()}

    def _on_home(self, message: PointStamped) -> None:
        """MAVROS counts a take-off's altitude from the autopilot's home, our own flight link from the odometry's zero;
        that one does not publish this."""
        self._home_m = message.point.z

    def _on_text(self, message: StatusText) -> None:
        if message.severity <= StatusText.WARNING:
            self._texts = [*self._texts[-10:], (time.monotonic(), message.text)]

    def _on_refusal(self, message: Refusal) -> None:
        self._refusals = [*self._refusals[-10:], (time.monotonic(), message.reason)]

    def _reason(self, asked_s: float) -> str:
        """Why the flight link refused since ``asked_s``: the reason comes by another way than the answer. MAVROS gives
        none; then it is what the autopilot said last."""
        until_s = time.monotonic() + _REASON_WAIT_S
        while time.monotonic() < until_s:
            reasons = _since(asked_s, self._refusals)
            if reasons:
                return reasons[-1]
            time.sleep(0.02)
        return ["the flight link refused without a reason", *_since(asked_s, self._texts)][-1]


def _since(asked_s: float, said: List[Tuple[float, str]]) -> List[str]:
    return [text for at_s, text in said if at_s >= asked_s]
