# SPDX-License-Identifier: Apache-2.0
"""What comes from the autopilot, message by message: its state, estimates, words, parameters and
answers."""

import logging
import math
from dataclasses import replace
from typing import Callable, Dict, List, Optional, Tuple

from pymavlink import mavutil

from fcsv_control.flight.mavlink import conversion, firmware
from fcsv_control.flight.mavlink.identity import Identities
from fcsv_control.flight.mavlink.keeper import ConnectionKeeper
from fcsv_control.flight.mavlink.requests import Requests
from fcsv_control.flight.mavlink.texts import TextJoiner
from fcsv_control.flight.mavlink.timesync import TimeSync
from fcsv_control.flight.messages import (
    BarometerReceived,
    BatteryReceived,
    Event,
    FixReceived,
    FixStatus,
    PoseReceived,
    RcReceived,
    StateReceived,
    TextReceived,
)
from fcsv_control.flight.pose_feed.height_check import height_m
from fcsv_control.flight.settings.parameters import ParameterCheck
from fcsv_control.flight.settings.profile import Profile, Rule
from fcsv_control.flight.state import FlightState

_M = mavutil.mavlink
_LOG = logging.getLogger(__name__)
#: What is asked for, and how often (Hz; 0: as often as poses are wanted). Those that stop are asked
#: for again.
STREAMS_HZ = {
    "ATTITUDE": 0.0,
    "LOCAL_POSITION_NED": 0.0,
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 2.0,
    "EKF_STATUS_REPORT": 5.0,
    "RC_CHANNELS": 5.0,
    "HEARTBEAT": 2.0,
    "SCALED_PRESSURE": 5.0,
    "GPS_RAW_INT": 1.0,
}


class Listener:
    """Hears one autopilot: ``target`` 0 is the first one heard."""

    def __init__(self, target_system: int, requests: Requests, profile: Profile):
        self.target = target_system
        self.state = FlightState()
        self.keeper = ConnectionKeeper(STREAMS_HZ)
        self.parameters = ParameterCheck(profile)
        self.strangers: Tuple[int, ...] = ()  # system ids of autopilots that are not ours
        self.foreign: Dict[int, str] = {}  # firmware that is not flown, by system id
        self.identities = Identities()
        self.version = ""
        self.timesync = TimeSync()
        self.timesync_answers: List[Tuple[int, int]] = []
        self.altitudes_mm: Dict[str, int] = {}  # of "home" and "origin", above sea level
        # its altitude is 0: the height estimate runs away until it is armed
        self.origin_at_zero = False
        self._requests = requests
        self._events: List[Event] = []
        self._wrong: List[Tuple[Rule, float, int]] = []
        self._texts = TextJoiner()
        self._rpy_ned: Optional[Tuple[float, float, float]] = None
        self._handlers: Dict[str, Optional[Callable]] = {}  # by kind of message, as they came

    @property
    def foreigner(self) -> str:
        """Which firmware speaks in place of an ArduCopter, in a sentence; empty where none does."""
        system = self.target or min(self.foreign, default=0)
        name = self.foreign.get(system)
        return (
            f"{name} with system id {system} speaks; only {firmware.COPTER} is flown"
            if name
            else ""
        )

    def events(self) -> List[Event]:
        """What was heard since the last call."""
        events, self._events = self._events, []
        return events

    def wrong_parameters(self) -> List[Tuple[Rule, float, int]]:
        """Rule, value and MAV_PARAM_TYPE of parameters that must be otherwise and were heard since
        the last call."""
        wrong, self._wrong = self._wrong, []
        return wrong

    def receive(self, now_s: float, m) -> None:
        """One message; those of other systems and components are passed over."""
        kind = m.get_type()
        if kind == "BAD_DATA" or m.get_srcComponent() != _M.MAV_COMP_ID_AUTOPILOT1:
            return
        if kind == "HEARTBEAT":
            if not self.identities.is_own(now_s, m):
                return
            if self._is_flown(m):
                self._meet(m.get_srcSystem())
        if m.get_srcSystem() != self.target or self.target in self.foreign:
            return
        if self.keeper.stream(now_s, kind, getattr(m, "time_boot_ms", None)):
            _LOG.warning("flight controller was restarted: connecting again")
            self._forget()
        if kind not in self._handlers:
            self._handlers[kind] = getattr(self, "_on_" + kind.lower(), None)
        handler = self._handlers[kind]
        if handler is not None:
            handler(now_s, m)

    def overdue(self, now_s: float) -> None:
        """Time passed: texts whose end got lost are passed on, and what was known of an autopilot
        that has fallen silent counts no more."""
        for text in self._texts.overdue(now_s):
            self._status_text(now_s, *text)
        if self.keeper.fell_silent(now_s):
            self._forget()

    def _forget(self) -> None:
        """What the autopilot said before it was silent, or restarted, counts no more: parameters,
        whether it may be armed, and whether its filter runs. (The origin is the keeper's.) Mode and
        motors stay as they showed last."""
        self.parameters.begin()
        self.timesync.begin()
        self.state = replace(self.state, ekf_flags=0, prearm_ok=None)

    def _is_flown(self, heartbeat) -> bool:
        """Whether it is an ArduCopter: others mean something else by the same modes and
        commands."""
        system, name = heartbeat.get_srcSystem(), firmware.name_of(heartbeat)
        if name == firmware.COPTER:
            self.foreign.pop(system, None)
            return True
        if system not in self.foreign:
            _LOG.error(
                "%s with system id %d speaks; only %s is flown", name, system, firmware.COPTER
            )
        self.foreign[system] = name
        return False

    def _meet(self, system: int) -> None:
        if self.target == 0:
            self.target = system
        elif system != self.target and system not in self.strangers:
            self.strangers = (*self.strangers, system)
            _LOG.error(
                "a second autopilot, system id %d, is on the line; ours is %d", system, self.target
            )

    def _on_heartbeat(self, now_s: float, m) -> None:
        # before "connected" is true: nobody sees it without a mode
        self.state = self.state.with_heartbeat(m)
        if self.keeper.heartbeat(now_s, self.state.booting):
            _LOG.info("flight controller %d is there", self.target)
            self._forget()
        self._events.append(StateReceived())

    def _on_extended_sys_state(self, _now_s: float, m) -> None:
        self.state = self.state.with_extended(m)

    def _on_sys_status(self, _now_s: float, m) -> None:
        self.state = self.state.with_sys_status(m)
        self._events.append(BatteryReceived())

    def _on_ekf_status_report(self, now_s: float, m) -> None:
        self.state = self.state.with_ekf(now_s, m)

    def _on_rc_channels(self, now_s: float, m) -> None:
        self.state = self.state.with_rc(now_s, m)
        self._events.append(RcReceived())

    def _on_command_ack(self, now_s: float, m) -> None:
        if m.target_system in (0, self.target):
            self._requests.acknowledged(now_s, m.command, m.result, m.target_component)

    def _on_statustext(self, now_s: float, m) -> None:
        whole = self._texts.add(now_s, m.severity, m.text, m.id, m.chunk_seq)
        if whole is not None:
            self._status_text(now_s, *whole)

    def _status_text(self, now_s: float, severity: int, text: str) -> None:
        self._requests.status_text(now_s, severity, text)
        self._events.append(TextReceived(severity, text))

    def _on_attitude(self, _now_s: float, m) -> None:
        self._rpy_ned = (m.roll, m.pitch, m.yaw)

    def _on_local_position_ned(self, _now_s: float, m) -> None:
        numbers = (m.x, m.y, m.z, m.vx, m.vy, m.vz, *(self._rpy_ned or ()))
        if self._rpy_ned is not None and math.isfinite(sum(numbers)):
            T_odom_body = conversion.pose_from_ned((m.x, m.y, m.z), self._rpy_ned)
            self._events.append(PoseReceived(T_odom_body, (m.vy, m.vx, -m.vz)))

    def _on_gps_raw_int(self, _now_s: float, m) -> None:
        """Poses come without it; a map may say by it where on the earth it lies."""
        if m.fix_type < _M.GPS_FIX_TYPE_3D_FIX:
            return  # an autopilot without a receiver says so again and again
        augmented = (
            FixStatus.GROUND
            if m.fix_type >= _M.GPS_FIX_TYPE_RTK_FLOAT
            else FixStatus.SATELLITES
            if m.fix_type == _M.GPS_FIX_TYPE_DGPS
            else FixStatus.ALONE
        )
        told = (m.alt_ellipsoid, m.h_acc, m.v_acc)  # mm, 0: not known
        height_m, sigma_m, height_sigma_m = (1e-3 * v if v else math.nan for v in told)
        place_deg = 1e-7 * m.lat, 1e-7 * m.lon
        self._events.append(FixReceived(augmented, *place_deg, height_m, sigma_m, height_sigma_m))

    def _on_scaled_pressure(self, _now_s: float, m) -> None:
        if math.isfinite(m.press_abs) and m.press_abs > 0.0:
            self._events.append(BarometerReceived(height_m(m.press_abs)))

    def _on_gps_global_origin(self, now_s: float, m) -> None:
        self.altitudes_mm["origin"] = m.altitude
        self.origin_at_zero = m.altitude == 0
        lasts = self.state.filter_runs and not self.origin_at_zero
        if lasts and not self.keeper.origin_set(now_s):
            _LOG.info(
                "the autopilot's origin is %.7f, %.7f deg", m.latitude / 1e7, m.longitude / 1e7
            )
        self.keeper.origin(now_s, lasts)

    def _on_autopilot_version(self, _now_s: float, m) -> None:
        self.version, self.keeper.version_known = firmware.version_of(m), True

    def _on_timesync(self, now_s: float, m) -> None:
        answer = self.timesync.receive(now_s, m.tc1, m.ts1)
        if answer is not None:
            self.timesync_answers.append(answer)

    def _on_home_position(self, _now_s: float, m) -> None:
        self.altitudes_mm["home"] = m.altitude

    def _on_param_value(self, _now_s: float, m) -> None:
        rule = self.parameters.answer(m.param_id, m.param_value)
        if rule is not None:
            _LOG.warning("parameter %s", rule.complaint(m.param_value))
            self._wrong.append((rule, m.param_value, m.param_type))
