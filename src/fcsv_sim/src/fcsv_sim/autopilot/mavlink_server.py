# SPDX-License-Identifier: Apache-2.0
"""The MAVLink 2 side of the simulated autopilot: messages and time in, messages out (NED and FRD
live only here)."""

import os

os.environ.setdefault("MAVLINK20", "1")

import math
from typing import Callable, Dict, List, Optional, Tuple

from pymavlink import mavutil

from fcsv_geometry import rotations
from fcsv_sim.autopilot import gps, modes, parameters
from fcsv_sim.autopilot.core import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Autopilot
from fcsv_sim.autopilot.fields import heading, ned, usable, whole

_M = mavutil.mavlink
_PREARM_BIT = 0x10000000
_FLAGS_OK, _UNINITIALISED = 0x33F, 0x400
_GEOID_M = 46.0  # above the ellipsoid, where the simulated worlds lie
_LOCAL, _IGNORE_XYZ, _IGNORE_V, _IGNORE_A, _IGNORE_YAW = 1, 0x007, 0x038, 0x1C0, 0x400


class MavlinkServer:
    """Speaks for one Autopilot: ``receive`` what came, ``step`` often, send what ``outgoing``
    gives."""

    def __init__(self, autopilot: Autopilot, system_id: int):
        self._pilot = autopilot
        self._system = system_id
        self._encoder = _M.MAVLink(None)
        self._out: List[object] = []
        self._parameters = dict(parameters.DEFAULTS, SYSID_THISMAV=(system_id, parameters.INT16))
        if autopilot.gps is not None:
            self._parameters["GPS_TYPE"] = (1, parameters.INT8)
        self._boots = autopilot.boots
        # key, and the time (10 us) from which it counts; it is kept
        self.signing: Optional[Tuple[bytes, int]] = None
        self._start()
        self._fly_by_parameters()
        self._attitude = (0.0, 0.0, 0.0)
        self._handlers: Dict[str, Optional[Callable]] = {}  # by kind of message, as they came
        self._streams: Dict[int, Callable] = {
            _M.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            _M.MAVLINK_MSG_ID_ATTITUDE: self._attitude_message,
            _M.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            _M.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery,
            _M.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._ekf_status,
            _M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self._origin,
            _M.MAVLINK_MSG_ID_HOME_POSITION: self._home,
            _M.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
            _M.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._version,
            _M.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_state,
            _M.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            _M.MAVLINK_MSG_ID_SCALED_PRESSURE: self._pressure,
            _M.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps_raw,
        }

    def _start(self) -> None:
        """Begins as after power-on: nobody has asked for anything."""
        self._intervals_s: Dict[int, float] = {_M.MAVLINK_MSG_ID_HEARTBEAT: 1.0}
        self._due_s: Dict[int, float] = {_M.MAVLINK_MSG_ID_HEARTBEAT: 0.0}
        self._mode_told = self._pilot.mode
        self._client_seen = False
        self._boot_s: Optional[float] = None
        self._next_timesync_s = 0.0

    def receive(self, now_s: float, message) -> None:
        """One message from a companion or a ground station."""
        self._begin(now_s)
        self._client_seen = True
        kind = message.get_type()
        if kind not in self._handlers:
            self._handlers[kind] = getattr(self, "_on_" + kind.lower(), None)
        handler = self._handlers[kind]
        if handler is not None:
            handler(message)

    def step(self, now_s: float, attitude_rpy_rad) -> None:
        """Heartbeats, streams and texts that are due. ENU attitude of the body."""
        self._begin(now_s)
        self._attitude = attitude_rpy_rad
        self._send_due()

    def outgoing(self) -> List[object]:
        """Messages to send now, each given once; their header names their source."""
        out, self._out = self._out, []
        return out

    def _begin(self, now_s: float) -> None:
        if self._boots != self._pilot.boots:
            self._boots = self._pilot.boots
            self._start()
        self._boot_s = now_s if self._boot_s is None else self._boot_s
        self._now_s = now_s

    def _send(self, kind: str, *fields) -> None:
        message = getattr(self._encoder, kind + "_encode")(*fields)
        header = message.get_header()
        header.srcSystem, header.srcComponent = self._system, 1
        self._out.append(message)

    # ---- incoming --------------------------------------------------------------------------------

    def _on_vision_position_estimate(self, m) -> None:
        if usable(m.x, m.y, m.z, m.yaw):
            self._pilot.estimator.vision(
                self._now_s, (m.y, m.x, -m.z), heading(m.yaw), m.reset_counter
            )

    def _on_odometry(self, m) -> None:
        if (
            (m.frame_id, m.child_frame_id) != (20, 12)
            or not usable(m.x, m.y, m.z, *m.q)
            or not any(m.q)
        ):
            return  # other frames are dropped without a word
        w, x, y, z = m.q
        yaw = rotations.yaw((x, y, z, w))
        self._pilot.estimator.vision(self._now_s, (m.y, m.x, -m.z), heading(yaw), m.reset_counter)

    def _on_set_gps_global_origin(self, m) -> None:
        if self._pilot.set_origin(self._now_s, (m.latitude, m.longitude, m.altitude)):
            self._origin()
            self._home()

    def _on_set_mode(self, m) -> None:
        self._pilot.set_mode(self._now_s, m.custom_mode)

    def _on_set_position_target_local_ned(self, m) -> None:
        mask = m.type_mask
        yaw = None if mask & _IGNORE_YAW else m.yaw
        position = None if mask & _IGNORE_XYZ else (m.y, m.x, -m.z)
        velocity = None if mask & _IGNORE_V else (m.vy, m.vx, -m.vz)
        if m.coordinate_frame != _LOCAL or not usable(
            yaw or 0.0, *(position or ()), *(velocity or ())
        ):
            return
        yaw = None if yaw is None else heading(yaw)
        if position is not None and velocity is None and not mask & _IGNORE_A:
            # position with acceleration, no velocity: it stops
            position = self._pilot.estimator.p_ext_m.copy()
        self._pilot.set_point(self._now_s, position, velocity, yaw)

    def _on_param_request_read(self, m) -> None:
        names = list(self._parameters)
        name = (
            m.param_id
            if m.param_index < 0
            else names[m.param_index]
            if m.param_index < len(names)
            else ""
        )
        if name in self._parameters:  # an unknown name gets no answer
            self._send_parameter(name)

    def _on_param_request_list(self, _m) -> None:
        for name in self._parameters:
            self._send_parameter(name)

    def _on_param_set(self, m) -> None:
        if m.param_id in self._parameters and math.isfinite(m.param_value):
            self._parameters[m.param_id] = (m.param_value, self._parameters[m.param_id][1])
            self._fly_by_parameters()
            self._send_parameter(m.param_id)

    def _on_setup_signing(self, m) -> None:
        if m.target_system not in (0, self._system):
            return
        if self._pilot.armed:
            self._pilot.say(_M.MAV_SEVERITY_WARNING, "ERROR: Won't setup signing when armed")
            return
        none = not any(m.secret_key) and not m.initial_timestamp
        self.signing = None if none else (bytes(m.secret_key), m.initial_timestamp)

    def _fly_by_parameters(self) -> None:
        self._pilot.fly_by(self._parameters)

    def _send_parameter(self, name: str) -> None:
        value, kind = self._parameters[name]
        index = list(self._parameters).index(name)
        self._send("param_value", name.encode(), value, kind, len(self._parameters), index)

    def _on_timesync(self, m) -> None:
        if m.tc1 == 0:
            self._send("timesync", int(self._now_s * 1e9), m.ts1)

    def _on_request_data_stream(self, m) -> None:
        groups = {
            1: (24, 27),
            2: (1, 36),
            6: (32, 33),
            10: (30,),
            11: (74,),
            12: (193,),
            0: (1, 30, 32, 193),
        }
        for message_id in groups.get(m.req_stream_id, ()):
            if message_id in self._streams:
                self._set_interval(
                    message_id,
                    1e6 / m.req_message_rate if m.start_stop and m.req_message_rate else -1,
                )

    def _on_command_long(self, m) -> None:
        self._send(
            "command_ack",
            m.command,
            self._command(m),
            0,
            0,
            m.get_srcSystem(),
            m.get_srcComponent(),
        )

    def _command(self, m) -> int:
        pilot, now_s = self._pilot, self._now_s
        if m.command == _M.MAV_CMD_DO_SET_MODE:
            return pilot.set_mode(now_s, whole(m.param2)) if whole(m.param1) & 1 else DENIED
        if m.command == _M.MAV_CMD_COMPONENT_ARM_DISARM:
            force = m.param2 in (2989.0, 21196.0)
            return (
                pilot.arm(now_s, force)
                if m.param1 == 1
                else pilot.disarm(now_s, m.param2 == 21196.0)
            )
        if m.command == _M.MAV_CMD_NAV_TAKEOFF:
            return pilot.takeoff(m.param7) if usable(m.param7) else FAILED
        if m.command == _M.MAV_CMD_NAV_LAND:
            return pilot.set_mode(now_s, modes.LAND)
        if m.command == _M.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_interval(whole(m.param1), m.param2)
        if m.command == _M.MAV_CMD_REQUEST_MESSAGE:
            if whole(m.param1) not in self._streams:
                return FAILED
            # of a missing origin nothing comes, and the answer is the same
            self._streams[whole(m.param1)]()
            return ACCEPTED
        return UNSUPPORTED

    def _set_interval(self, message_id: int, interval_us: float) -> int:
        if message_id in (_M.MAVLINK_MSG_ID_ODOMETRY, _M.MAVLINK_MSG_ID_ESTIMATOR_STATUS):
            return FAILED
        if message_id not in self._streams:
            return ACCEPTED if interval_us <= 0 else FAILED
        self._due_s.pop(message_id, None)
        if interval_us > 0:
            self._intervals_s[message_id] = max(interval_us / 1e6, 1 / 200.0)
            self._due_s[message_id] = self._now_s
        return ACCEPTED

    # ---- outgoing --------------------------------------------------------------------------------

    def _send_due(self) -> None:
        now_s = self._now_s
        if self._pilot.mode != self._mode_told:
            self._heartbeat()  # a new mode is told at once
        if now_s >= self._next_timesync_s:
            self._next_timesync_s = now_s + 10.0
            self._send("timesync", 0, int(now_s * 1e9))
        for message_id, due_s in self._due_s.items():
            if now_s >= due_s:
                interval_s = self._intervals_s[message_id]
                self._due_s[message_id] = max(due_s + interval_s, now_s - interval_s)
                self._streams[message_id]()
        if self._client_seen:
            for severity, text in self._pilot.texts:
                self._send("statustext", severity, text[:50].encode())
            self._pilot.texts.clear()

    def _milliseconds(self) -> int:
        return int((self._now_s - self._boot_s) * 1000) & 0xFFFFFFFF

    def _heartbeat(self) -> None:
        pilot = self._pilot
        self._mode_told = pilot.mode
        base = _M.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | _M.MAV_MODE_FLAG_STABILIZE_ENABLED
        base |= _M.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | (
            _M.MAV_MODE_FLAG_SAFETY_ARMED if pilot.armed else 0
        )
        # "guided" says that the position controller runs
        base |= (
            _M.MAV_MODE_FLAG_GUIDED_ENABLED
            if pilot.armed and pilot.mode in modes.POSITION_CONTROL
            else 0
        )
        if pilot.failsafe:
            status = _M.MAV_STATE_CRITICAL
        elif pilot.estimator.booting(self._now_s):
            status = _M.MAV_STATE_BOOT
        else:
            status = _M.MAV_STATE_ACTIVE if pilot.flying else _M.MAV_STATE_STANDBY
        self._send(
            "heartbeat",
            _M.MAV_TYPE_QUADROTOR,
            _M.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base,
            pilot.mode,
            status,
        )

    def _local_position(self) -> None:
        if self._pilot.origin is None or not self._pilot.estimator.position_ok(self._now_s):
            return  # ack 0 does not promise data
        estimate = self._pilot.estimator
        self._send(
            "local_position_ned",
            self._milliseconds(),
            *ned(estimate.p_ext_m),
            *ned(estimate.v_ext_mps),
        )

    def _attitude_message(self) -> None:
        roll, pitch, _ = self._attitude
        yaw = heading(self._pilot.estimator.yaw_ext_rad)
        self._send("attitude", self._milliseconds(), roll, -pitch, yaw, 0.0, 0.0, 0.0)

    def _sys_status(self) -> None:
        ready = self._pilot.armed or not self._pilot.prearm_failures(self._now_s)
        health = 0x0FFFFFFF | (_PREARM_BIT if ready else 0)
        share = int(self._pilot.battery_share * 100)
        self._send(
            "sys_status",
            0x1FFFFFFF,
            0x1FFFFFFF,
            health,
            200,
            int(self._pilot.battery_v * 1000),
            1500,
            share,
            0,
            0,
            0,
            0,
            0,
            0,
        )

    def _battery(self) -> None:
        cell_mv = int(self._pilot.battery_v * 250)
        voltages = [cell_mv] * 4 + [65535] * 6
        share = int(self._pilot.battery_share * 100)
        self._send("battery_status", 0, 0, 1, 32767, voltages, 1500, 0, 0, share)

    def _ekf_status(self) -> None:
        estimator = self._pilot.estimator
        if not estimator.started(self._now_s):
            self._send("ekf_status_report", _UNINITIALISED, 0.0, 0.0, 0.0, 0.0, 0.0)
            return
        good, ratio = estimator.position_ok(self._now_s), estimator.innovation_ratio
        self._send(
            "ekf_status_report", _FLAGS_OK if good else 0x0A7, 0.6 * ratio, ratio, 0.05, 0.0, 0.0
        )

    def _pressure(self) -> None:
        hpa = self._pilot.barometer.pressure_hpa(self._now_s, self._pilot.armed)
        self._send("scaled_pressure", self._milliseconds(), hpa, 0.0, 2500)

    def _gps_raw(self) -> None:
        """The receiver's fix; an autopilot without one says so, as ArduCopter does."""
        time_us, nothing = int(self._now_s * 1e6), 65535
        if self._pilot.gps is None:
            self._send("gps_raw_int", time_us, 0, 0, 0, 0, nothing, nothing, nothing, nothing, 0)
            return
        latitude_deg, longitude_deg, height_m = self._pilot.gps.fix(self._now_s)
        place = round(1e7 * latitude_deg), round(1e7 * longitude_deg)
        sea_mm, ellipsoid_mm = round(1e3 * (height_m - _GEOID_M)), round(1e3 * height_m)
        accuracy_mm = int(1e3 * gps.SIGMA_M), int(1e3 * gps.HEIGHT_SIGMA_M)
        self._send(
            "gps_raw_int",
            time_us,
            _M.GPS_FIX_TYPE_3D_FIX,
            *place,
            sea_mm,
            80,
            120,
            0,
            nothing,
            gps.SATELLITES,
            ellipsoid_mm,
            *accuracy_mm,
        )

    def _origin(self) -> None:
        if self._pilot.origin is not None:
            self._send("gps_global_origin", *self._pilot.origin, int(self._now_s * 1e6))

    def _home(self) -> None:
        if self._pilot.origin is not None:
            self._send("home_position", *self._pilot.origin, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)

    def _rc_channels(self) -> None:
        heard = self._pilot.rc_alive(self._now_s)
        channels = list(self._pilot.rc_pwm if heard else ())
        self._send(
            "rc_channels",
            self._milliseconds(),
            len(channels),
            *channels,
            *[0] * (18 - len(channels)),
            255,
        )

    def _version(self) -> None:
        self._send("autopilot_version", 0, 0x040308FF, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)

    def _extended_state(self) -> None:
        self._send("extended_sys_state", 0, 2 if self._pilot.flying else 1)
