# SPDX-License-Identifier: Apache-2.0
"""What the flight link adds where MAVROS stands in its place: MAVLink messages and time in,
messages and events out.

MAVROS sends modes, arming, take-offs and targets. It answers a mode at once, whatever becomes of
it, gives no reason for a refusal, asks for no streams and sets no origin. What the autopilot
answers to MAVROS's component is heard here; to the message SET_MODE, which MAVROS sends, ArduCopter
4.6 answers nothing but a text where it refuses.
"""

from typing import List, Optional, Tuple

from pymavlink import mavutil

from fcsv_control.errors import LinkError
from fcsv_control.flight.core import LinkCore
from fcsv_control.flight.mavlink import commands
from fcsv_control.flight.mavlink.texts import WARNING, Reasons
from fcsv_control.flight.messages import HomeReceived, Refused, TextReceived
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight.settings.profile import NOTHING, Profile
from fcsv_geometry.vehicles.modes import Mode

_M = mavutil.mavlink
COMPONENT = 240  # MAV_COMP_ID_UDP_BRIDGE, with which MAVROS speaks by default
_ASKED = {  # by what a COMMAND_ACK names
    _M.MAV_CMD_DO_SET_MODE: "the mode",
    _M.MAV_CMD_COMPONENT_ARM_DISARM: "arming or disarming",
    _M.MAV_CMD_NAV_TAKEOFF: "take-off",
    _M.MAV_CMD_NAV_LAND: "landing",
}
_MODE_REFUSED = "Mode change to "  # how ArduCopter begins the text in which it refuses one
# the reason comes before its acknowledgement, or a little later
_REASON_BEFORE_S, _REASON_AFTER_S = 0.5, 0.3
_HOME_S = 1.0


class MavrosCore(LinkCore):
    """A link's core that hears what MAVROS is answered, and says where home is: MAVROS counts
    take-offs from there."""

    def __init__(
        self, parameters: LinkParameters, profile: Profile = NOTHING, component: int = COMPONENT
    ):
        super().__init__(parameters, profile)
        self._component = component
        self._reasons = Reasons()
        self._refused: List[Tuple[float, int, int]] = []  # when, what was asked, MAV_RESULT
        self._home_asked_s = float("-inf")

    def receive(self, now_s: float, message) -> None:
        """One message that MAVROS heard."""
        heard = len(self._events)
        super().receive(now_s, message)
        for event in self._events[heard:]:
            if isinstance(event, TextReceived):
                self._status_text(now_s, event)
        if (message.get_srcSystem(), message.get_srcComponent()) != (
            self._listener.target,
            _M.MAV_COMP_ID_AUTOPILOT1,
        ):
            return
        if message.get_type() == "COMMAND_ACK" and message.target_component == self._component:
            self._answered(now_s, message.command, message.result)
        elif message.get_type() == "HOME_POSITION" and len(self._listener.altitudes_mm) == 2:
            told = self._listener.altitudes_mm
            self._events.append(HomeReceived((told["home"] - told["origin"]) / 1000.0))

    def step(self, now_s: float) -> None:
        """Time passes."""
        super().step(now_s)
        self._refused = [r for r in self._refused if not self._explain(now_s, *r)]
        if (
            self.connected(now_s)
            and not self.state.in_the_air
            and now_s - self._home_asked_s >= _HOME_S
        ):
            self._home_asked_s = now_s
            self._long(_M.MAV_CMD_REQUEST_MESSAGE, [_M.MAVLINK_MSG_ID_HOME_POSITION])

    def mode_asked(self, mode: Mode) -> None:
        """Agent or guardian ask MAVROS for this mode: it is the companion's once it shows. One that
        shows already stays whose it was."""
        self._mode_request = None
        if mode == self._owner.mode:
            self._owner.refused()
        else:
            self._owner.asked(mode)

    def _status_text(self, now_s: float, text: TextReceived) -> None:
        if text.severity <= WARNING and text.text.startswith(_MODE_REFUSED):
            self._events.append(Refused(text.text))
            self._owner.refused()
            self._mode_request = None
        else:
            self._reasons.add(now_s, text.severity, text.text)

    def _answered(self, now_s: float, command: int, result: int) -> None:
        """The autopilot answered MAVROS."""
        if command in _ASKED and result not in (commands.ACCEPTED, commands.IN_PROGRESS):
            self._refused.append((now_s, command, result))

    def _explain(self, now_s: float, at_s: float, command: int, result: int) -> bool:
        reason = self._reasons.since(at_s - _REASON_BEFORE_S)
        if not reason and now_s - at_s < _REASON_AFTER_S:
            return False
        self._events.append(
            Refused(f"{_ASKED[command]} refused: {reason or commands.result_name(result)}")
        )
        return True


def mavros_url(fcu_url: str) -> str:
    """MAVROS's way to write an address that the flight link knows; MAVROS's own way is left as it
    is.

    >>> mavros_url("udpin:127.0.0.1:14550"), mavros_url("tcp:127.0.0.1:5760"), mavros_url("/dev/ttyACM0:115200")
    ('udp://127.0.0.1:14550@', 'tcp://127.0.0.1:5760', '/dev/ttyACM0:115200')

    Raises LinkError on another form.
    """
    if fcu_url.startswith("/") or "://" in fcu_url:
        return fcu_url
    kind, _, address = fcu_url.partition(":")
    form: Optional[str] = {"udpin": "udp://{}@", "udpout": "udp://:0@{}", "tcp": "tcp://{}"}.get(
        kind
    )
    if form is None or not address.rpartition(":")[2].isdigit():
        raise LinkError(
            f"fcu_url: '{fcu_url}' is none that MAVROS understands; give udpin:, udpout:, tcp:HOST:PORT, "
            "/dev/DEVICE:BAUD or MAVROS's own form"
        )
    return form.format(address)
