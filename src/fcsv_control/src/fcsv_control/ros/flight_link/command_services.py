# SPDX-License-Identifier: Apache-2.0
"""The services by which a flight link is commanded, as MAVROS names them, whatever kind of vehicle
is behind it."""

from dataclasses import dataclass
from typing import Callable

import rospy

from fcsv_control.errors import CommandRefused, ControlError
from fcsv_control.flight.mavlink.commands import ACCEPTED, FAILED
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import Refusal
from mavros_msgs.msg import StatusText
from mavros_msgs.srv import (
    CommandBool,
    CommandBoolResponse,
    CommandTOL,
    CommandTOLResponse,
    SetMode,
    SetModeResponse,
)


@dataclass(frozen=True)
class Commands:
    """What the vehicle does when asked; each raises CommandRefused or ControlError with the
    reason."""

    set_mode: Callable[[Mode], None]
    arm: Callable[[bool], None]
    take_off: Callable[[float], None]  # to an altitude in metres


class CommandServices:
    """Answers once the vehicle did it or refused. ``say`` tells people: severity, text."""

    def __init__(self, commands: Commands, say: Callable[[int, str], None]):
        self._commands, self._say = commands, say
        self._refusals = rospy.Publisher("flight_link/refusal", Refusal, queue_size=5)
        rospy.Service("mavros/set_mode", SetMode, self._set_mode)
        rospy.Service("mavros/cmd/arming", CommandBool, self._arm)
        rospy.Service("mavros/cmd/takeoff", CommandTOL, self._take_off)
        rospy.Service("mavros/cmd/land", CommandTOL, self._land)

    def _set_mode(self, request) -> SetModeResponse:
        return SetModeResponse(
            self._attempt(lambda: self._commands.set_mode(Mode(request.custom_mode))) == ACCEPTED
        )

    def _arm(self, request) -> CommandBoolResponse:
        result = self._attempt(lambda: self._commands.arm(request.value))
        return CommandBoolResponse(result == ACCEPTED, result)

    def _take_off(self, request) -> CommandTOLResponse:
        result = self._attempt(lambda: self._commands.take_off(request.altitude))
        return CommandTOLResponse(result == ACCEPTED, result)

    def _land(self, _request) -> CommandTOLResponse:
        result = self._attempt(lambda: self._commands.set_mode(Mode.LAND))
        return CommandTOLResponse(result == ACCEPTED, result)

    def _attempt(self, action: Callable[[], None]) -> int:
        """MAV_RESULT: 0 accepted, 4 failed. Before the service answers, the reason goes to the
        agent (refusal) and to people (status text)."""
        try:
            action()
            return ACCEPTED
        except CommandRefused as error:
            severity, reason = StatusText.ERROR, str(error)
        except ControlError as error:
            severity, reason = StatusText.CRITICAL, str(error)
        self._refusals.publish(Refusal(conversions.header(rospy.get_time(), ""), reason))
        self._say(severity, reason)
        return FAILED
