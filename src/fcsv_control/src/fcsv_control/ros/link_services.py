# SPDX-License-Identifier: Apache-2.0
"""Requests to the flight link by its services, with the reason where it refuses."""

import time
from typing import List, Tuple

import rospy

from fcsv_control.agent.messages import Ask, Kind
from fcsv_control.errors import ControlError
from fcsv_msgs.msg import Refusal
from mavros_msgs.msg import StatusText
from mavros_msgs.srv import CommandBool, CommandTOL, SetMode

_REASON_WAIT_S = 0.5  # the reason and the service's answer come by different ways


class LinkServices:
    """``ask`` waits for the answer; from any thread."""

    def __init__(self, timeout_s: float):
        self._timeout_s = timeout_s
        self._texts: List[Tuple[float, str]] = []
        self._refusals: List[Tuple[float, str]] = []
        self._set_mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
        self._arming = rospy.ServiceProxy("mavros/cmd/arming", CommandBool)
        self._takeoff = rospy.ServiceProxy("mavros/cmd/takeoff", CommandTOL)
        rospy.Subscriber("mavros/statustext/recv", StatusText, self._on_text, queue_size=20)
        rospy.Subscriber("flight_link/refusal", Refusal, self._on_refusal, queue_size=5)

    def ask(self, ask: Ask) -> None:
        """Raises ControlError with the reason of a refusal; rospy's errors where the service is not there."""
        asked_s = time.monotonic()
        service = {Kind.SET_MODE: self._set_mode, Kind.ARM: self._arming, Kind.TAKEOFF: self._takeoff}[ask.kind]
        rospy.wait_for_service(service.resolved_name, timeout=self._timeout_s)
        if ask.kind is Kind.SET_MODE:
            done = service(0, ask.mode).mode_sent
        elif ask.kind is Kind.ARM:
            done = service(ask.flag).success
        else:
            done = service(0, 0, 0, 0, ask.altitude_m).success
        if not done:
            raise ControlError(self._reason(asked_s))

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
