# SPDX-License-Identifier: Apache-2.0
"""The flight link's decisions: MAVLink messages and monotonic time in, MAVLink messages and events
out.

No socket, no thread, no clock: the same core flies, is rehearsed faster than real time, and is
tested in milliseconds. What is relied on here was measured on ArduCopter 4.3.8 and 4.6.2.
"""

import os

os.environ.setdefault("MAVLINK20", "1")

import logging
from typing import List, Optional, Sequence, Set

import numpy as np
from pymavlink import mavutil

from fcsv_control.errors import CommandRefused
from fcsv_control.flight.mavlink import conversion, keeper
from fcsv_control.flight.mavlink.listener import STREAMS_HZ, Listener
from fcsv_control.flight.mavlink.requests import COMPANION, Outcome, Request, Requests
from fcsv_control.flight.messages import EstimateMoved, Event, PoseReceived
from fcsv_control.flight.pose_feed.estimate import EstimateWatch
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight.settings.profile import NOTHING, Profile, Rule
from fcsv_control.flight.state import MODES, FlightState
from fcsv_control.flight.take_off import TakeOff
from fcsv_geometry.streams.stream import Stream
from fcsv_geometry.vehicles.modes import LINK, Mode, ModeOwner

_M = mavutil.mavlink
__all__ = ["LinkCore", "LinkParameters"]

_LOG = logging.getLogger(__name__)
_AUTOPILOT = _M.MAV_COMP_ID_AUTOPILOT1
_POSITION_AND_YAW = 0x9F8  # position alone would turn the nose into the direction of travel
_UNKNOWN_COVARIANCE = [float("nan")] + [0.0] * 20  # the filter's own noise is used
STOP_REPEAT_S = 0.2
_STOP_PATIENCE_S = 5.0
_STOOD_STILL_S = 0.5  # between two steps, of which there are 50 a second
_READ_UP_S = 0.3  # after which what came on the line meanwhile is read


class LinkCore:
    """One flight controller. ``take`` what came, ``step`` often, send what ``outgoing`` gives, mind
    ``events``.

    Outgoing messages carry their source system and component in their header. ``profile`` says what
    the autopilot's parameters must be; without one nothing is relied on.
    """

    def __init__(self, parameters: LinkParameters, profile: Profile = NOTHING):
        self._parameters = parameters
        self._reset_counter = 0
        self._set_before: Set[str] = set()
        self._watch = EstimateWatch()
        self._fed: Stream[int] = Stream(2.0)  # stamps (us) of poses, which only rise
        self._begun_anew = False
        # until the first step nothing stood still
        self._stepped_s, self._woke_s = float("inf"), float("-inf")
        self._owner = ModeOwner(LINK)
        self._mode_request: Optional[Request] = None
        self._events: List[Event] = []
        self._requests = Requests(parameters.command_timeout_s, parameters.command_tries)
        self._listener = Listener(parameters.target_system, self._requests, profile)
        self._encoder = _M.MAVLink(None)
        self._out: List[object] = []
        self._take_off: List[TakeOff] = []

    # ---- what is known ---------------------------------------------------------------------------

    @property
    def state(self) -> FlightState:
        """What the autopilot says of itself."""
        return self._listener.state

    @property
    def listener(self) -> Listener:
        """Origin, parameters, strangers."""
        return self._listener

    def connected(self, now_s: float) -> bool:
        """Whether a heartbeat came within the last 3 s."""
        return self._listener.keeper.connected(now_s)

    @property
    def mode_is_ours(self) -> bool:
        """Whether the mode that shows is the last one that was commanded here, and no other has
        shown since. A stop that somebody else had chosen before stays his."""
        return self._owner.ours

    def origin_set(self, now_s: float) -> bool:
        """Whether the autopilot goes on reporting an origin since its filter began, and it is not
        at altitude 0."""
        return self._listener.keeper.origin_set(now_s)

    def pose_rate_hz(self, now_s: float) -> float:
        """Poses per second that go to the autopilot, over the last two seconds."""
        return self._fed.rate_hz(now_s)

    def pose_age_s(self, now_s: float) -> float:
        """Since the last pose went to the autopilot; infinite before the first."""
        return self._fed.age_s(now_s)

    def estimate_apart_m(self, now_s: float) -> float:
        """Distance of the autopilot's estimate and the feed; NaN where one of them is not known."""
        return self._watch.apart_m(now_s)

    # ---- messages and time -----------------------------------------------------------------------

    def receive(self, now_s: float, message) -> None:
        """One message from the line."""
        self._listener.receive(now_s, message)
        state, before = self._listener.state, self._owner.mode
        # what was asked before he took it counts no more
        if state.mode is not before and self._owner.shows(state.mode) and before:
            self._requests.withdraw(
                _M.MAV_CMD_DO_SET_MODE, f"{state.mode} showed, which was not asked here"
            )
        for event in self._listener.events():
            self._events.append(event)
            if isinstance(event, PoseReceived):
                step_m = self._watch.estimate(now_s, event.T_odom_body[:3, 3], state.armed)
                if step_m is not None:
                    self._events.append(EstimateMoved(step_m))

    def step(self, now_s: float) -> None:
        """Time passes: whatever is due is sent."""
        self._woke_s = now_s if now_s - self._stepped_s > _STOOD_STILL_S else self._woke_s
        self._stepped_s = now_s
        self._listener.overdue(now_s)
        for wanted in self._listener.keeper.due(now_s):
            self._ask(now_s, wanted)
        while self._listener.timesync_answers:
            self._send("timesync", *self._listener.timesync_answers.pop(0))
        for wrong in self._listener.wrong_parameters():
            self._correct(*wrong)
        for take_off in self._take_off:
            take_off.step(now_s)
        self._take_off = [t for t in self._take_off if not t.over]
        for request, confirmation in self._requests.step(now_s, self.state):
            self._long(request.number, request.values, confirmation, request.component)
        self._mind_mode()

    def outgoing(self) -> List[object]:
        """Messages to send now, each given once."""
        out, self._out = self._out, []
        return out

    def events(self) -> List[Event]:
        """What was heard since the last call."""
        events, self._events = [*self._events, *self._listener.events()], []
        return events

    # ---- what a caller may ask -------------------------------------------------------------------

    def send_pose(
        self, stamp_s: float, T_odom_body: np.ndarray, now_s: Optional[float] = None
    ) -> None:
        """External navigation: body pose in the odometry frame (ENU/FLU). ``stamp_s`` on any clock
        that only rises; ``now_s`` where that is not the core's own."""
        now_s = stamp_s if now_s is None else now_s
        self._watch.pose_sent(now_s, stamp_s, T_odom_body[:3, 3], self._begun_anew)
        self._begun_anew = False
        ned, rpy = conversion.ned_from_pose(T_odom_body)
        usec = int(stamp_s * 1e6) if self._fed.value is None else self._fed.value + 1
        usec = max(usec, int(stamp_s * 1e6))
        self._fed.tell(now_s, usec)
        self._send(
            "vision_position_estimate", usec, *ned, *rpy, _UNKNOWN_COVARIANCE, self._reset_counter
        )

    def note_reset(self) -> None:
        """The odometry frame was begun anew: the next pose is adopted at once instead of being
        followed or gated.

        The autopilot's target does not move with it: EstimateMoved says when the estimate is in the
        new frame.
        """
        self._reset_counter = (self._reset_counter + 1) % 256
        self._begun_anew = True

    def mode_asked(self, mode: Mode) -> None:
        """A process on board asks for a mode. Here nothing follows: the request itself comes by
        this link."""

    def send_set_point(self, T_odom_body: np.ndarray) -> None:
        """Position and yaw target of the body in the odometry frame; heard only in GUIDED."""
        ned, (_, _, yaw) = conversion.ned_from_pose(T_odom_body)
        self._send(
            "set_position_target_local_ned",
            0,
            self._listener.target,
            _AUTOPILOT,
            _M.MAV_FRAME_LOCAL_NED,
            _POSITION_AND_YAW,
            *ned,
            0,
            0,
            0,
            0,
            0,
            0,
            yaw,
            0,
        )

    def command(self, now_s: float, number: int, *values: float, what: str = "") -> Request:
        """A COMMAND_LONG, repeated until acknowledged."""
        return self._requests.ask(now_s, number, values, what)

    def _mind_mode(self) -> None:
        """A mode is waited for while it is asked for. One that showed before is ours once it is
        acknowledged; a stop is not even sent then."""
        request = self._mode_request
        if request is None or not request.over:
            return
        if request.outcome is Outcome.DONE and not request.insists:
            self._owner.done()
        self._owner.refused()
        self._mode_request = None

    def set_mode(self, now_s: float, name: Mode) -> Request:
        """Change mode and see it in the heartbeat. A mode that stops overtakes any other and is
        repeated until it shows. Raises CommandRefused for a mode that ArduCopter does not have."""
        if name not in MODES:
            raise CommandRefused(
                f"mode '{name}' is not known; ArduCopter has {', '.join(sorted(MODES))}"
            )
        if self._listener.foreigner:  # its modes have other numbers: not even LAND is one
            raise CommandRefused(f"mode {name} refused: {self._listener.foreigner}")
        if not name.stops:
            self._require_ready(now_s, f"mode {name}")
        if name == Mode.GUIDED:
            self._require_parameters()
        ask = (
            now_s,
            _M.MAV_CMD_DO_SET_MODE,
            (1, MODES[name]),
            f"mode {name}",
            lambda s: s.mode == name,
        )
        if name.stops:
            request = self._requests.insist(*ask, STOP_REPEAT_S, _STOP_PATIENCE_S)
        else:
            request = self._requests.ask(*ask)
        self._owner.asked(name)
        self._mode_request = request
        return request

    def arm(self, now_s: float, value: bool) -> Request:
        """Arm or disarm and see it in the heartbeat."""
        what = "arming" if value else "disarming"
        if self._listener.foreigner:
            raise CommandRefused(f"{what} refused: {self._listener.foreigner}")
        if value:
            self._require_ready(now_s, what)
        number = _M.MAV_CMD_COMPONENT_ARM_DISARM
        return self._requests.ask(now_s, number, (float(value),), what, lambda s: s.armed == value)

    def take_off(self, now_s: float, altitude_m: float) -> TakeOff:
        """Climb to an altitude (m) above the zero of the odometry frame. Raises CommandRefused
        where it is not armed in GUIDED."""
        if self.state.mode != Mode.GUIDED or not self.state.armed:
            armed = "armed" if self.state.armed else "not armed"
            where = self.state.mode or "no mode"
            raise CommandRefused(
                f"take-off refused: it must be armed in GUIDED, and is {armed} in {where}"
            )
        for message in (_M.MAVLINK_MSG_ID_HOME_POSITION, _M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN):
            self._long(_M.MAV_CMD_REQUEST_MESSAGE, [message])
        take_off = TakeOff(
            now_s, altitude_m, self._listener, self._requests, self._parameters.command_timeout_s
        )
        self._take_off.append(take_off)
        return take_off

    def _require_ready(self, now_s: float, what: str) -> None:
        """Raises CommandRefused where it is not said which of several autopilots is ours, where
        this process stood still, or where the autopilot is still starting."""
        self._require_one_autopilot(what)
        self._require_awake(now_s, what)
        if self.state.booting:
            raise CommandRefused(f"{what} refused: the autopilot is still starting")

    def _require_one_autopilot(self, what: str) -> None:
        """Raises CommandRefused where it is not said which of several autopilots is ours."""
        others = self._listener.strangers
        if others and not self._parameters.target_system:
            ids = ", ".join(map(str, (self._listener.target, *others)))
            raise CommandRefused(
                f"{what} refused: autopilots {ids} are on one line; set target_system"
            )

    def _require_awake(self, now_s: float, what: str) -> None:
        """Raises CommandRefused where this process stood still until just now: who asked may have
        waited meanwhile, and what came on the line is not all read."""
        if now_s - self._stepped_s > _STOOD_STILL_S or now_s - self._woke_s < _READ_UP_S:
            raise CommandRefused(
                f"{what} refused: the flight link stood still until just now; ask again"
            )

    def _require_parameters(self) -> None:
        """Raises CommandRefused where a parameter is known not to be what it must."""
        wrong = self._listener.parameters.wrong()
        if wrong:
            raise CommandRefused(f"mode GUIDED refused: parameter {'; '.join(wrong)}")

    # ---- what goes out ---------------------------------------------------------------------------

    def _ask(self, now_s: float, wanted: str) -> None:
        """Send what the keeper wants sent."""
        if wanted == keeper.HEARTBEAT:
            kind, status = _M.MAV_TYPE_ONBOARD_CONTROLLER, _M.MAV_STATE_ACTIVE
            self._send("heartbeat", kind, _M.MAV_AUTOPILOT_INVALID, 0, 0, status)
        elif wanted == keeper.STREAMS:
            self._request_streams(now_s)
        elif wanted == keeper.ASK_ORIGIN:
            self._long(_M.MAV_CMD_REQUEST_MESSAGE, [_M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN])
        elif wanted == keeper.SET_ORIGIN:
            place = (
                int(self._parameters.origin_lat_deg * 1e7),
                int(self._parameters.origin_lon_deg * 1e7),
            )
            altitude_mm = int(self._parameters.origin_alt_m * 1000)
            self._send("set_gps_global_origin", self._listener.target, *place, altitude_mm)
        elif wanted == keeper.PARAMETER:
            name = self._listener.parameters.next()
            self._listener.keeper.parameters_read = name is None
            if name is not None:
                self._send(
                    "param_request_read", self._listener.target, _AUTOPILOT, name.encode(), -1
                )

        elif wanted == keeper.VERSION:
            self._long(_M.MAV_CMD_REQUEST_MESSAGE, [_M.MAVLINK_MSG_ID_AUTOPILOT_VERSION])
        elif wanted == keeper.TIMESYNC:
            self._send("timesync", *self._listener.timesync.ask(now_s))

    def _request_streams(self, now_s: float) -> None:
        # in one order in every process
        for name in sorted({*self._listener.keeper.streams_to_ask(now_s), "HEARTBEAT"}):
            message = getattr(_M, f"MAVLINK_MSG_ID_{name}")
            hz = STREAMS_HZ[name] or self._parameters.position_rate_hz
            self._long(_M.MAV_CMD_SET_MESSAGE_INTERVAL, [message, 1e6 / hz])

    def _correct(self, rule: Rule, value: float, kind: int) -> None:
        name, needed = rule.name, rule.value
        if (
            self._parameters.set_parameters
            and not self.state.armed
            and name not in self._set_before
        ):
            # once: an autopilot that keeps its value would be asked for ever
            self._set_before.add(name)
            _LOG.warning(
                "setting %s from %g to %g, as asked; VISO_TYPE needs a restart", name, value, needed
            )
            self._send("param_set", self._listener.target, _AUTOPILOT, name.encode(), needed, kind)

    def _long(
        self,
        number: int,
        values: Sequence[float],
        confirmation: int = 0,
        component: int = COMPANION,
    ) -> None:
        padded = [*values, *[0.0] * (7 - len(values))]
        self._send(
            "command_long",
            self._listener.target,
            _AUTOPILOT,
            number,
            confirmation,
            *padded,
            component=component,
        )

    def _send(self, kind: str, *fields, component: int = COMPANION) -> None:
        if self._listener.foreigner and kind != "heartbeat":
            return
        message = getattr(self._encoder, kind + "_encode")(*fields)
        header = message.get_header()
        # a companion has its vehicle's id
        header.srcSystem, header.srcComponent = self._listener.target or 1, component
        self._out.append(message)
