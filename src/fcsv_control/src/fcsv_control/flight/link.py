# SPDX-License-Identifier: Apache-2.0
"""One flight controller behind MAVLink 2: connection, commands with acknowledgement, poses in, estimates out.

One thread reads and keeps the connection; any thread may send. What is relied on here was measured on
ArduCopter 4.3.8.
"""

import logging
import threading
import time
from dataclasses import dataclass
from typing import Callable, List, Set, Tuple

import numpy as np
from pymavlink import mavutil

from fcsv_control.errors import CommandRefused
from fcsv_control.flight import commands, conversion, keeper
from fcsv_control.flight.exchange import Exchange
from fcsv_control.flight.listener import Listener
from fcsv_control.flight.parameters import NEEDED
from fcsv_control.flight.state import MODES, FlightState
from fcsv_control.flight.transport import Transport

_M = mavutil.mavlink
_LOG = logging.getLogger(__name__)
_AUTOPILOT = _M.MAV_COMP_ID_AUTOPILOT1
_POSITION_AND_YAW = 0x9F8  # position alone would turn the nose into the direction of travel
_FLAG_WAIT_S = 2.5  # the heartbeat's armed flag lags up to a second
_POLL_S = 0.1


@dataclass(frozen=True)
class LinkParameters:
    """``target_system`` 0: the first autopilot heard. Origin: any place will do without GPS."""

    target_system: int = 0
    position_rate_hz: float = 30.0
    command_timeout_s: float = 1.0
    command_tries: int = 3
    origin_lat_deg: float = 35.0
    origin_lon_deg: float = 135.0
    set_parameters: bool = False

    def __post_init__(self):
        if not 0 <= self.target_system <= 255:
            raise ValueError(f"target_system: {self.target_system} is not in 0..255")
        if not 1.0 <= self.position_rate_hz <= 200.0:
            raise ValueError(f"position_rate_hz: {self.position_rate_hz} is not in 1..200")
        if not (0.1 <= self.command_timeout_s <= 5.0 and 1 <= self.command_tries <= 10):
            raise ValueError("command_timeout_s: must be in 0.1..5, command_tries in 1..10")
        if not (abs(self.origin_lat_deg) <= 89.0 and abs(self.origin_lon_deg) <= 180.0):
            raise ValueError("origin_lat_deg: must be in -89..89, origin_lon_deg in -180..180")


class FlightLink:
    """Callbacks, from the reading thread: on_state(), on_pose(T_odom_body), on_battery(), on_text(severity, text).

    ``fcu_url`` as Transport has it. Raises LinkError where it cannot be opened.
    """

    def __init__(self, fcu_url: str, parameters: LinkParameters, **callbacks: Callable):
        self._parameters = parameters
        self._reset_counter = 0
        self._set_before: Set[str] = set()
        self._exchange = Exchange(self._long, parameters.command_timeout_s, parameters.command_tries)
        callbacks["on_wrong_parameter"] = self._on_wrong_parameter
        self._heard = Listener(parameters.target_system, self._exchange, callbacks)
        self._transport = Transport(fcu_url, parameters.target_system or 1)
        self._running = True
        self._thread = threading.Thread(target=self._read, name="mavlink", daemon=True)
        self._thread.start()

    # ---- what a caller may ask -----------------------------------------------------------------------------

    @property
    def state(self) -> FlightState:
        """What the autopilot says of itself, as of now."""
        return self._heard.state

    @property
    def connected(self) -> bool:
        """Whether a heartbeat came within the last 3 s."""
        return self._heard.keeper.connected(time.monotonic())

    @property
    def origin_set(self) -> bool:
        """Whether the autopilot has confirmed an origin since it was connected."""
        return self._heard.keeper.origin_set

    @property
    def parameter_problems(self) -> List[str]:
        """A line for each of the autopilot's parameters that does not fit."""
        return self._heard.parameters.problems()

    @property
    def strangers(self) -> Tuple[int, ...]:
        """System ids of other autopilots on this line."""
        return self._heard.strangers

    def send_pose(self, stamp_s: float, T_odom_body: np.ndarray) -> None:
        """External navigation: body pose in the odometry frame (ENU/FLU)."""
        ned, rpy = conversion.ned_from_pose(T_odom_body)
        covariance = [float("nan")] + [0.0] * 20  # unknown: the filter's own noise is used
        counter = self._reset_counter
        self._transport.send("vision_position_estimate", int(stamp_s * 1e6), *ned, *rpy, covariance, counter)

    def note_reset(self) -> None:
        """The odometry frame was begun anew: the next pose is adopted at once instead of being followed or gated.

        The autopilot's target does not move with it: re-issue the set-point in the new frame.
        """
        self._reset_counter = (self._reset_counter + 1) % 256

    def send_set_point(self, T_odom_body: np.ndarray) -> None:
        """Position and yaw target of the body in the odometry frame; heard only in GUIDED."""
        ned, (_, _, yaw) = conversion.ned_from_pose(T_odom_body)
        self._transport.send(
            "set_position_target_local_ned", 0, self._heard.target, _AUTOPILOT, _M.MAV_FRAME_LOCAL_NED,
            _POSITION_AND_YAW, *ned, 0, 0, 0, 0, 0, 0, yaw, 0,
        )  # fmt: skip

    def command(self, number: int, *values: float, what: str = "") -> None:
        """A COMMAND_LONG, repeated until acknowledged. Raises CommandRefused with the reason, or LinkError."""
        self._exchange.require_accepted(self._exchange.run(number, values), what or f"command {number}")

    def set_mode(self, name: str) -> None:
        """Change mode and see it in the heartbeat. Raises like command."""
        if name not in MODES:
            raise CommandRefused(f"mode '{name}' is not known; ArduCopter has {', '.join(sorted(MODES))}")
        self.command(_M.MAV_CMD_DO_SET_MODE, 1, MODES[name], what=f"mode {name}")
        if not self._exchange.wait(lambda: self.state.mode == name, _FLAG_WAIT_S):
            raise CommandRefused(f"mode {name} was acknowledged, but the vehicle is in {self.state.mode or 'none'}")

    def arm(self, value: bool) -> None:
        """Arm or disarm and see it in the heartbeat. Raises like command."""
        what = "arming" if value else "disarming"
        self.command(_M.MAV_CMD_COMPONENT_ARM_DISARM, float(value), what=what)
        if not self._exchange.wait(lambda: self.state.armed == value, _FLAG_WAIT_S):
            raise CommandRefused(f"{what} was acknowledged, but the vehicle does not say so")

    def take_off(self, altitude_m: float) -> None:
        """Climb to an altitude above the zero of the odometry frame. Raises like command.

        The autopilot counts from its home, which it may have set where it was armed.
        """
        if self.state.mode != "GUIDED" or not self.state.armed:
            armed = "armed" if self.state.armed else "not armed"
            where = self.state.mode or "no mode"
            raise CommandRefused(f"take-off refused: it must be armed in GUIDED, and is {armed} in {where}")
        above_home_m = altitude_m - self._home_above_origin_m()
        pending = self._exchange.run(_M.MAV_CMD_NAV_TAKEOFF, [0, 0, 0, 0, 0, 0, above_home_m])
        if pending.result == commands.FAILED and pending.sent > 1:  # an acknowledgement was lost: does it climb?
            if self._exchange.wait(lambda: self.state.landed is False, 1.0):
                return
        self._exchange.require_accepted(pending, "take-off")

    def close(self) -> None:
        """End the thread, close the connection."""
        self._running = False
        self._thread.join(3.0)
        self._transport.close()

    def _home_above_origin_m(self) -> float:
        """From the autopilot's own words; 0 where it does not tell."""
        told = self._heard.altitudes_mm
        told.clear()
        for message in (_M.MAVLINK_MSG_ID_HOME_POSITION, _M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN):
            self._long(_M.MAV_CMD_REQUEST_MESSAGE, [message])
        if not self._exchange.wait(lambda: len(told) == 2, self._parameters.command_timeout_s):
            _LOG.warning("the autopilot does not tell its home: taken to be at the height of the origin")
            return 0.0
        return (told["home"] - told["origin"]) / 1000.0

    # ---- the reading thread --------------------------------------------------------------------------------

    def _read(self) -> None:
        while self._running:
            message = self._transport.receive(_POLL_S)
            try:
                now_s = time.monotonic()
                if message is not None:
                    self._heard.take(now_s, message)
                    self._transport.speak_as(self._heard.target or 1)
                self._heard.overdue(now_s)
                for wanted in self._heard.keeper.due(now_s):
                    self._ask(wanted)
            except Exception:  # one odd message, or a node shutting down, must not end the link of a flying vehicle
                if self._running:
                    _LOG.exception("while handling %s", message)

    def _ask(self, wanted: str) -> None:
        """Send what the keeper wants sent."""
        if wanted == keeper.HEARTBEAT:
            kind, status = _M.MAV_TYPE_ONBOARD_CONTROLLER, _M.MAV_STATE_ACTIVE
            self._transport.send("heartbeat", kind, _M.MAV_AUTOPILOT_INVALID, 0, 0, status)
        elif wanted == keeper.STREAMS:
            self._request_streams()
        elif wanted == keeper.ASK_ORIGIN:
            self._long(_M.MAV_CMD_REQUEST_MESSAGE, [_M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN])
        elif wanted == keeper.SET_ORIGIN:
            place = int(self._parameters.origin_lat_deg * 1e7), int(self._parameters.origin_lon_deg * 1e7)
            self._transport.send("set_gps_global_origin", self._heard.target, *place, 0)
        elif wanted == keeper.PARAMETER:
            name = self._heard.parameters.next()
            self._heard.keeper.parameters_read = name is None
            if name is not None:
                self._transport.send("param_request_read", self._heard.target, _AUTOPILOT, name.encode(), -1)

    def _request_streams(self) -> None:
        rate_hz = self._parameters.position_rate_hz
        for message, hz in (
            (_M.MAVLINK_MSG_ID_ATTITUDE, rate_hz),
            (_M.MAVLINK_MSG_ID_LOCAL_POSITION_NED, rate_hz),
            (_M.MAVLINK_MSG_ID_SYS_STATUS, 1.0),
            (_M.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 2.0),
            (_M.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 1.0),
            (_M.MAVLINK_MSG_ID_HEARTBEAT, 2.0),
        ):
            self._long(_M.MAV_CMD_SET_MESSAGE_INTERVAL, [message, 1e6 / hz])

    def _on_wrong_parameter(self, name: str, value: float, kind: int) -> None:
        if self._parameters.set_parameters and not self.state.armed and name not in self._set_before:
            self._set_before.add(name)  # once: an autopilot that keeps its value would be asked for ever
            needed = NEEDED[name][0]
            _LOG.warning("setting %s from %g to %g, as asked; VISO_TYPE needs a restart", name, value, needed)
            self._transport.send("param_set", self._heard.target, _AUTOPILOT, name.encode(), needed, kind)

    def _long(self, number: int, values, confirmation: int = 0) -> None:
        padded = [*values, *[0.0] * (7 - len(values))]
        self._transport.send("command_long", self._heard.target, _AUTOPILOT, number, confirmation, *padded)
