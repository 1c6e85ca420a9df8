# SPDX-License-Identifier: Apache-2.0
"""One flight controller behind MAVLink 2: connection, commands with acknowledgement, poses in, estimates out.

A thread reads; callers send. What was measured on ArduCopter 4.3.8 and is relied on here stands in docs/results.md.
"""

import os

os.environ.setdefault("MAVLINK20", "1")

import logging
import threading
import time
from dataclasses import dataclass, field
from typing import Callable, Dict, List, Optional, Tuple

import numpy as np
from pymavlink import mavutil

from fcsv_control.errors import CommandRefused, LinkError
from fcsv_control.flight import conversion
from fcsv_control.flight.texts import TextJoiner

_M = mavutil.mavlink
_LOG = logging.getLogger(__name__)
_CONNECTED_S = 3.0
_POSITION_AND_YAW = 0x9F8
MODES = {"STABILIZE": 0, "ALT_HOLD": 2, "GUIDED": 4, "LOITER": 5, "LAND": 9, "BRAKE": 17}
_MODE_NAMES = {number: name for name, number in MODES.items()}
#: What this flies on; a vehicle set up otherwise is reported, not changed.
NEEDED_PARAMETERS = {
    "VISO_TYPE": (2, 3),
    "EK3_SRC1_POSXY": (6,),
    "EK3_SRC1_POSZ": (1, 6),
    "EK3_SRC1_VELXY": (0, 6),
    "EK3_SRC1_YAW": (6,),
}


@dataclass(frozen=True)
class LinkParameters:
    """fcu_url: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or DEVICE:BAUD. Origin: any place will do indoors."""

    fcu_url: str
    position_rate_hz: float = 30.0
    command_timeout_s: float = 1.0
    command_tries: int = 3
    origin_lat_deg: float = 35.0
    origin_lon_deg: float = 135.0

    def __post_init__(self):
        if not 1.0 <= self.position_rate_hz <= 200.0:
            raise ValueError(f"position_rate_hz: {self.position_rate_hz} is not in 1..200")


@dataclass
class FlightState:
    """What the flight controller says of itself."""

    heartbeat_s: Optional[float] = None
    armed: bool = False
    mode: str = ""
    guided: bool = False
    manual_input: bool = False
    system_status: int = 0
    voltage_v: float = float("nan")
    battery_share: float = float("nan")
    prearm_ok: Optional[bool] = None
    wrong_parameters: Dict[str, float] = field(default_factory=dict)

    def connected(self, now_s: float) -> bool:
        return self.heartbeat_s is not None and now_s - self.heartbeat_s < _CONNECTED_S


class FlightLink:
    """Callbacks: on_state(), on_pose(T_odom_body), on_battery(), on_text(severity, text)."""

    def __init__(self, parameters: LinkParameters, **callbacks: Callable):
        self._parameters = parameters
        self._callbacks = callbacks
        self.state = FlightState()
        self.origin_set = False
        self._texts = TextJoiner()
        self._recent_texts: List[Tuple[float, str]] = []
        self._acks: Dict[int, int] = {}
        self._changed = threading.Condition()
        self._sending = threading.Lock()
        self._attitude: Optional[Tuple[float, float, float]] = None
        self._reset_counter = 0
        self._target_system = 0
        self._next_s = {"heartbeat": 0.0, "origin": 0.0, "setup": 0.0}
        self._setup_due = False
        self._running = True
        try:
            self._link = _connect(parameters.fcu_url)
        except (OSError, ValueError) as error:
            raise LinkError(f"flight controller at '{parameters.fcu_url}' cannot be opened: {error}") from error
        self._thread = threading.Thread(target=self._read, name="mavlink", daemon=True)
        self._thread.start()

    # ---- what a caller may ask -----------------------------------------------------------------------------

    def send_pose(self, stamp_s: float, T_odom_body: np.ndarray) -> None:
        """External navigation: body pose in the odometry frame (ENU/FLU)."""
        (n, e, d), (roll, pitch, yaw) = conversion.ned_from_pose(T_odom_body)
        covariance = [float("nan")] + [0.0] * 20  # unknown: the filter's own noise is used
        self._send(
            "vision_position_estimate_send",
            int(stamp_s * 1e6),
            n,
            e,
            d,
            roll,
            pitch,
            yaw,
            covariance,
            self._reset_counter,
        )

    def note_reset(self) -> None:
        """The odometry was reset: the next poses are adopted at once instead of being gated."""
        self._reset_counter = (self._reset_counter + 1) % 256

    def send_set_point(self, T_odom_body: np.ndarray) -> None:
        """Position and yaw target of the body in the odometry frame; heard only in GUIDED."""
        (n, e, d), (_, _, yaw) = conversion.ned_from_pose(T_odom_body)
        self._send(
            "set_position_target_local_ned_send", 0, self._target_system, 1, _M.MAV_FRAME_LOCAL_NED,
            _POSITION_AND_YAW, n, e, d, 0, 0, 0, 0, 0, 0, yaw, 0,
        )  # fmt: skip

    def set_mode(self, name: str) -> None:
        """Raises CommandRefused with the autopilot's reason, LinkError where it does not answer."""
        if name not in MODES:
            raise CommandRefused(f"mode '{name}' is not known; known: {', '.join(MODES)}")
        self.command(_M.MAV_CMD_DO_SET_MODE, 1, MODES[name], what=f"mode {name}")
        if not self._wait(lambda: self.state.mode == name, 2.0):
            raise CommandRefused(f"mode {name} was acknowledged but the vehicle is in {self.state.mode}")

    def arm(self, value: bool) -> None:
        """Arm or disarm; the armed flag lags by up to a second and is waited for. Raises like set_mode."""
        self.command(_M.MAV_CMD_COMPONENT_ARM_DISARM, 1.0 if value else 0.0, what="arming" if value else "disarming")
        self._wait(lambda: self.state.armed == value, 2.0)

    def take_off(self, altitude_m: float) -> None:
        """To an altitude above the zero of the odometry frame. Raises like set_mode."""
        self.command(_M.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, altitude_m, what="take-off")

    def command(self, number: int, *values: float, what: str = "") -> None:
        """A COMMAND_LONG, repeated until acknowledged. Raises CommandRefused or LinkError."""
        values = [*values, *[0.0] * (7 - len(values))]
        asked_s = time.monotonic()
        for attempt in range(self._parameters.command_tries):
            with self._changed:
                self._acks.pop(number, None)
            self._send("command_long_send", self._target_system, 1, number, attempt, *values)
            if self._wait(lambda: number in self._acks, self._parameters.command_timeout_s):
                break
        else:
            raise LinkError(f"{what or number}: the flight controller does not answer")
        if self._acks[number] != 0:
            time.sleep(0.15)  # the reason follows the acknowledgement
            reasons = [text for at, text in self._recent_texts if at >= asked_s - 0.05]
            raise CommandRefused(f"{what or number} refused: {'; '.join(reasons) or f'result {self._acks[number]}'}")

    def close(self) -> None:
        self._running = False
        self._thread.join(1.0)
        self._link.close()

    # ---- the reading thread --------------------------------------------------------------------------------

    def _read(self) -> None:
        while self._running:
            try:
                message = self._link.recv_match(blocking=True, timeout=0.1)
                if message is not None:
                    self._handle(message)
                self._housekeeping(time.monotonic())
            except OSError as error:  # a device that was pulled out, a peer that is not there yet
                _LOG.debug("mavlink: %s", error)
                time.sleep(0.1)

    def _handle(self, message) -> None:
        handler = getattr(self, "_on_" + message.get_type().lower(), None)
        if handler is not None and message.get_srcComponent() == _M.MAV_COMP_ID_AUTOPILOT1:
            handler(message)

    def _on_heartbeat(self, m) -> None:
        now_s = time.monotonic()
        if not self.state.connected(now_s):
            _LOG.info("flight controller %d is there", m.get_srcSystem())
            self._target_system, self._setup_due, self.origin_set = m.get_srcSystem(), True, False
        with self._changed:
            self.state.heartbeat_s = now_s
            self.state.armed = bool(m.base_mode & _M.MAV_MODE_FLAG_SAFETY_ARMED)
            self.state.guided = bool(m.base_mode & _M.MAV_MODE_FLAG_GUIDED_ENABLED)
            self.state.manual_input = bool(m.base_mode & _M.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED)
            self.state.mode = _MODE_NAMES.get(m.custom_mode, f"MODE{m.custom_mode}")
            self.state.system_status = m.system_status
            self._changed.notify_all()
        self._call("on_state")

    def _on_command_ack(self, m) -> None:
        with self._changed:
            self._acks[m.command] = m.result
            self._changed.notify_all()

    def _on_statustext(self, m) -> None:
        whole = self._texts.add(m.severity, m.text, getattr(m, "id", 0), getattr(m, "chunk_seq", 0))
        if whole is not None:
            self._recent_texts = [*self._recent_texts[-20:], (time.monotonic(), whole[1])]
            self._call("on_text", *whole)

    def _on_attitude(self, m) -> None:
        self._attitude = (m.roll, m.pitch, m.yaw)

    def _on_local_position_ned(self, m) -> None:
        if self._attitude is not None:
            self._call("on_pose", conversion.pose_from_ned((m.x, m.y, m.z), self._attitude))

    def _on_sys_status(self, m) -> None:
        self.state.prearm_ok = bool(m.onboard_control_sensors_health & 0x10000000)
        self.state.voltage_v = m.voltage_battery / 1000.0
        self.state.battery_share = m.battery_remaining / 100.0 if m.battery_remaining >= 0 else float("nan")
        self._call("on_battery")

    def _on_gps_global_origin(self, _m) -> None:
        self.origin_set = True

    def _on_param_value(self, m) -> None:
        allowed = NEEDED_PARAMETERS.get(m.param_id)
        if allowed is not None and m.param_value not in allowed:
            self.state.wrong_parameters[m.param_id] = m.param_value
            _LOG.warning("parameter %s is %g; external navigation needs %s", m.param_id, m.param_value, allowed)

    def _housekeeping(self, now_s: float) -> None:
        """Heartbeat of the companion; streams, parameters and origin after every (re)connection."""
        if now_s >= self._next_s["heartbeat"] and self.state.heartbeat_s is not None:
            self._next_s["heartbeat"] = now_s + 1.0
            self._send("heartbeat_send", _M.MAV_TYPE_ONBOARD_CONTROLLER, _M.MAV_AUTOPILOT_INVALID, 0, 0, 4)
        if self._setup_due and now_s >= self._next_s["setup"]:
            self._setup_due = False
            self._next_s["setup"] = now_s + 1.0
            self._request_streams()
        if self.state.connected(now_s) and not self.origin_set and now_s >= self._next_s["origin"]:
            self._next_s["origin"] = now_s + 1.0  # no ack, and dropped before the filter runs: again until it is there
            origin = (int(self._parameters.origin_lat_deg * 1e7), int(self._parameters.origin_lon_deg * 1e7), 0)
            self._send("set_gps_global_origin_send", self._target_system, *origin)
            self._long(_M.MAV_CMD_REQUEST_MESSAGE, _M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)

    def _request_streams(self) -> None:
        rate_hz = self._parameters.position_rate_hz
        for message_id, hz in (
            (_M.MAVLINK_MSG_ID_LOCAL_POSITION_NED, rate_hz),
            (_M.MAVLINK_MSG_ID_ATTITUDE, rate_hz),
            (_M.MAVLINK_MSG_ID_SYS_STATUS, 1.0),
            (_M.MAVLINK_MSG_ID_HEARTBEAT, 2.0),
        ):
            self._long(_M.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / hz)
        for name in NEEDED_PARAMETERS:
            self._send("param_request_read_send", self._target_system, 1, name.encode(), -1)

    def _long(self, number: int, *values: float) -> None:
        """A command whose acknowledgement promises nothing."""
        self._send("command_long_send", self._target_system, 1, number, 0, *values, *[0.0] * (7 - len(values)))

    def _send(self, name: str, *args) -> None:
        with self._sending:
            try:
                getattr(self._link.mav, name)(*args)
            except (OSError, AttributeError) as error:
                _LOG.debug("mavlink send: %s", error)  # the link is down: the heartbeat's age tells

    def _wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        with self._changed:
            return self._changed.wait_for(condition, timeout_s)

    def _call(self, name: str, *args) -> None:
        callback = self._callbacks.get(name)
        if callback is not None:
            callback(*args)


def _connect(url: str):
    device, _, baud = url.rpartition(":")
    if device.startswith("/"):
        return mavutil.mavlink_connection(device, baud=int(baud), source_system=1, source_component=191)
    return mavutil.mavlink_connection(url, source_system=1, source_component=191, dialect="ardupilotmega")
