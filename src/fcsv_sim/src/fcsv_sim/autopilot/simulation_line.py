# SPDX-License-Identifier: Apache-2.0
"""A line to ArduCopter's own simulation, beside that of the flight link: who is there, and its true
pose."""

import contextlib
import math
import os
import socket
import time
from typing import Optional

os.environ.setdefault("MAVLINK20", "1")

from pymavlink import mavutil

from fcsv_control.flight.mavlink import firmware
from fcsv_control.flight.mavlink.transport import Transport
from fcsv_sim.autopilot.elsewhere import TRUTH_HZ, ElsewhereError

_M = mavutil.mavlink
_TRUTH_PORT = 2  # SERIAL1 of ArduCopter's simulation is two ports beyond SERIAL0
_COMPANION = 195  # the component in whose name the rate is asked for
_ASK_S = 2.0
_SPEED = "SIM_SPEEDUP"
_BEGINS_S, _TELLS_S = 40.0, 40.0  # until its second port is open; until it tells its true pose
_RESTARTS_S = 1.0  # after which it has let go of its ports


class SimulationLine:
    """``autopilot``: tcp:HOST:PORT of the vehicle's line; this one is two ports further on. Raises
    LinkError."""

    def __init__(self, autopilot: str):
        kind, host, port = autopilot.split(":")
        self.address = f"{kind}:{host}:{int(port) + _TRUTH_PORT}"
        self._line = Transport(self.address)
        self._asked_s = -math.inf
        self.system = 0

    def receive(self, timeout_s: float):
        """The next message, or None after about ``timeout_s``; the true pose is asked for again and
        again."""
        now_s = time.monotonic()
        if self.system and now_s > self._asked_s + _ASK_S:
            self._asked_s = now_s
            self._ask()
        message = self._line.receive(timeout_s)
        if (
            message is not None
            and message.get_type() == "HEARTBEAT"
            and firmware.is_vehicles(message)
        ):
            self.system = message.get_srcSystem()
        return message

    def ask_speed(self) -> None:
        """Asks at which share of real time it simulates; a PARAM_VALUE answers."""
        self._send(_M.MAVLink(None).param_request_read_encode(self.system, 1, _SPEED.encode(), -1))

    def restart(self) -> None:
        """Restarts the simulation: its vehicle stands at its home again, and it waits for the
        vehicle's line."""
        reboot = (_M.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 0, 1, 0, 0, 0, 0, 0, 0)
        self._send(_M.MAVLink(None).command_long_encode(self.system, 1, *reboot))

    def close(self) -> None:
        """Ends the line."""
        self._line.close()

    def _ask(self) -> None:
        interval = (
            _M.MAV_CMD_SET_MESSAGE_INTERVAL,
            0,
            _M.MAVLINK_MSG_ID_SIM_STATE,
            1e6 / TRUTH_HZ,
            0,
            0,
            0,
            0,
            0,
        )
        self._send(_M.MAVLink(None).command_long_encode(self.system, 1, *interval))

    def _send(self, message) -> None:
        message.get_header().srcSystem, message.get_header().srcComponent = self.system, _COMPANION
        self._line.send(message)


def require_simulation(
    autopilot: str, vehicle: str, system: int, speed: Optional[float] = None
) -> None:
    """Raises ElsewhereError unless a disarmed ArduCopter of that system id is there and tells its
    true pose.

    ``speed``: before a flight, the share of real time at which it must simulate. Then it is also
    restarted, so that it stands at its home as the next flight expects. The vehicle's own line is
    held meanwhile: a simulation that was just started waits for it.
    """
    _, host, port = autopilot.split(":")
    with contextlib.nullcontext() if speed is None else _reached(host, int(port), 0.0, vehicle):
        _reached(host, int(port) + _TRUTH_PORT, _BEGINS_S, vehicle).close()
        line = SimulationLine(autopilot)
        try:
            _require(line, vehicle, system, time.monotonic() + _TELLS_S, speed)
            if speed is not None:
                line.restart()
                time.sleep(_RESTARTS_S)
        finally:
            line.close()


def _reached(host: str, port: int, patience_s: float, vehicle: str) -> socket.socket:
    """A connection. Raises ElsewhereError where nobody listens, for so long."""
    until_s = time.monotonic() + patience_s
    while True:
        try:
            return socket.create_connection((host, port), 3.0)
        except OSError as error:
            if time.monotonic() > until_s:
                raise ElsewhereError(
                    f"{vehicle}: nobody listens at tcp:{host}:{port} ({error.strerror or error}): "
                    "start ArduCopter's simulation for it (docs/user/simulation.md)"
                ) from error
            time.sleep(0.2)


def _require(
    line: SimulationLine, vehicle: str, system: int, until_s: float, speed: Optional[float]
) -> None:
    heard, told = False, speed is None
    while time.monotonic() < until_s:
        message = line.receive(0.1)
        if message is None:
            continue
        if message.get_type() == "HEARTBEAT" and firmware.is_vehicles(message):
            _check(message, line.address, vehicle, system)
            heard = True
            if not told:
                line.ask_speed()
        elif (
            message.get_type() == "PARAM_VALUE" and message.param_id == _SPEED and speed is not None
        ):
            _check_speed(message.param_value, line.address, vehicle, speed)
            told = True
        elif heard and told and message.get_type() == "SIM_STATE":
            return
    what = "it tells no true pose (SIM_STATE) or no SIM_SPEEDUP: is that a simulation?"
    raise ElsewhereError(
        f"{vehicle}: at {line.address} {what if heard else 'no autopilot is heard'}"
    )


def _check_speed(found: float, address: str, vehicle: str, speed: float) -> None:
    """Raises ElsewhereError."""
    if abs(found - speed) > 0.01:
        raise ElsewhereError(
            f"{vehicle}: the simulation at {address} runs at {found:g} of real time, the demo at {speed:g}: "
            f"start it with --speedup {speed:g}, or the demo with SPEED={found:g}"
        )


def _check(heartbeat, address: str, vehicle: str, system: int) -> None:
    """Raises ElsewhereError where another vehicle answers than the one that is meant, or one that
    flies."""
    name = firmware.name_of(heartbeat)
    if name != firmware.COPTER:
        raise ElsewhereError(
            f"{vehicle}: {name} answers at {address}; give the address of an ArduCopter"
        )
    if heartbeat.get_srcSystem() != system:
        raise ElsewhereError(
            f"{vehicle}: the ArduCopter at {address} has system id {heartbeat.get_srcSystem()}, "
            f"{vehicle}.yaml says {system}: start it with --sysid {system}"
        )
    if heartbeat.base_mode & _M.MAV_MODE_FLAG_SAFETY_ARMED:
        raise ElsewhereError(
            f"{vehicle}: the ArduCopter at {address} is armed: land it, or start it anew"
        )
