# SPDX-License-Identifier: Apache-2.0
"""An autopilot on a line, for its parameters and its key: it is asked nothing else, and gets no
origin and no poses."""

import os

os.environ.setdefault("MAVLINK20", "1")

import time
from typing import Callable, Dict, Iterable, List, Mapping, Optional, Tuple

from pymavlink import mavutil

from fcsv_control.errors import LinkError
from fcsv_control.flight.mavlink import firmware
from fcsv_control.flight.mavlink.identity import Identities
from fcsv_control.flight.mavlink.signing import ticks
from fcsv_control.flight.mavlink.transport import Transport
from fcsv_control.parameters.transfer import TRIES, NamedRead, Value, WholeRead, Write

_M = mavutil.mavlink
_AUTOPILOT, _COMPANION = _M.MAV_COMP_ID_AUTOPILOT1, _M.MAV_COMP_ID_ONBOARD_COMPUTER4
_POLL_S = 0.02
# after another firmware's heartbeat an ArduCopter's may come, which speaks once a second
_SECOND_S = 1.5
_COMPLAINS_S = 0.5  # at most, after what it does not take
_ANY = _M.MAV_PARAM_TYPE_REAL32  # ArduPilot goes by its own

Progress = Callable[[int, int], None]  # so many are there, of so many


class Vehicle:
    """Connects to the ArduCopter at ``url`` (as the flight link's ``fcu_url``), ``system`` 0: the
    first one heard; ``key``: with which the line is signed. Raises LinkError where nobody speaks,
    or another firmware does. As a context it closes its line."""

    def __init__(
        self, url: str, system: int = 0, patience_s: float = 10.0, key: Optional[bytes] = None
    ):
        self.system, self.armed, self.firmware = system, False, ""
        self._identities = Identities()
        self._line = Transport(url, key)
        self._encoder = _M.MAVLink(None)
        self._values: List[object] = []
        self.complaints: List[str] = []  # of its, about keys
        until_s = time.monotonic() + patience_s
        while self.firmware != firmware.COPTER and time.monotonic() < until_s:
            before = self.firmware
            self._poll()
            if self.firmware and not before:
                until_s = min(until_s, time.monotonic() + _SECOND_S)
        if self.firmware != firmware.COPTER:
            self.close()
            who = f" with system id {system}" if system else ""
            said = (
                f"{self.firmware} speaks; only {firmware.COPTER} is flown"
                if self.firmware
                else f"no autopilot{who}"
            )
            raise LinkError(f"at '{url}': {said}")

    def read(self, names: Iterable[str], tries: int = TRIES) -> Tuple[Dict[str, Value], List[str]]:
        """Values by name, and names that it does not answer."""
        reading = NamedRead(names, tries)
        while not reading.over(time.monotonic()):
            for name in reading.due(time.monotonic()):
                self._send("param_request_read", self.system, _AUTOPILOT, name.encode(), -1)
            for m in self._new_values():
                reading.receive(m.param_id, m.param_value, m.param_type)
        return reading.values, reading.unknown

    def read_all(self, progress: Progress) -> Dict[str, Value]:
        """All parameters. Raises LinkError where some do not come."""
        reading = WholeRead()
        while not reading.over(time.monotonic()):
            whole, indices = reading.due(time.monotonic())
            if whole:
                self._send("param_request_list", self.system, _AUTOPILOT)
            for index in indices:
                self._send("param_request_read", self.system, _AUTOPILOT, b"", index)
            for m in self._new_values():
                reading.receive(
                    time.monotonic(),
                    m.param_id,
                    m.param_value,
                    m.param_type,
                    m.param_count,
                    m.param_index,
                )
            progress(len(reading.values), reading.count)
        if not reading.complete:
            raise LinkError(
                f"only {len(reading.values)} of {reading.count} parameters came: try again"
            )
        return reading.values

    def write(self, values: Mapping[str, float]) -> List[str]:
        """Set values; a line for each that it did not take. Raises LinkError while it is armed."""
        writing = Write(values)
        while not writing.over(time.monotonic()):
            if self.armed:
                raise LinkError(
                    "it is armed: parameters are written on the ground, with motors off"
                )
            for name, value in writing.due(time.monotonic()):
                self._send("param_set", self.system, _AUTOPILOT, name.encode(), value, _ANY)
            for m in self._new_values():
                writing.receive(m.param_id, m.param_value)
        return writing.failed

    def set_up_signing(self, key: Optional[bytes]) -> None:
        """Give it a key of 32 bytes; None takes its key away. It does not say that it did: what it
        complains of is in ``complaints``, and who signs is heard. Raises LinkError while it is
        armed: it would not take it."""
        if self.armed:
            raise LinkError("it is armed: keys are set on the ground, with motors off")
        stamp = 0 if key is None else ticks(time.time())
        self._send("setup_signing", self.system, _AUTOPILOT, list(key or bytes(32)), stamp)
        until_s = time.monotonic() + _COMPLAINS_S
        while time.monotonic() < until_s:
            self._poll()

    def close(self) -> None:
        self._line.close()

    def __enter__(self) -> "Vehicle":
        return self

    def __exit__(self, *_raised) -> None:
        self.close()

    def _new_values(self) -> List[object]:
        self._poll()
        values, self._values = self._values, []
        return values

    def _poll(self) -> None:
        """What comes within a moment."""
        m = self._line.receive(_POLL_S)
        while m is not None:
            if m.get_type() != "BAD_DATA" and m.get_srcComponent() == _AUTOPILOT:
                self._receive(m)
            m = self._line.receive(0.0)

    def _receive(self, m) -> None:
        system = m.get_srcSystem()
        if (
            m.get_type() == "HEARTBEAT"
            and self.system in (0, system)
            and self._identities.is_own(time.monotonic(), m)
        ):
            self.system, self.firmware = system, firmware.name_of(m)
            self.armed = bool(m.base_mode & _M.MAV_MODE_FLAG_SAFETY_ARMED)
        elif m.get_type() == "PARAM_VALUE" and m.get_srcSystem() == self.system:
            self._values.append(m)
        elif (
            m.get_type() == "STATUSTEXT"
            and m.get_srcSystem() == self.system
            and "signing" in m.text
        ):
            self.complaints.append(m.text)

    def _send(self, kind: str, *fields) -> None:
        message = getattr(self._encoder, kind + "_encode")(*fields)
        message.get_header().srcSystem, message.get_header().srcComponent = self.system, _COMPANION
        self._line.send(message)
