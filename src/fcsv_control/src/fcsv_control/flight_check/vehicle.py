# SPDX-License-Identifier: Apache-2.0
"""What a vehicle itself knows must be true: one function a line. None of it needs the radio.

A line that cannot be judged because what it is judged by is not heard is unknown; what is silent is
red itself.
"""

import math
from dataclasses import dataclass, field
from typing import List, Optional, Sequence, Tuple

from fcsv_control import conditions
from fcsv_control.agent.messages import AgentAlive
from fcsv_control.conditions import Grade
from fcsv_control.disk import disk_words
from fcsv_control.flight.messages import LinkLives, ParametersChecked
from fcsv_control.flight_check import autopilot_line
from fcsv_control.flight_check import keys as relay_keys
from fcsv_control.flight_check.lines import Check, Found
from fcsv_control.flight_check.pre_arm_texts import PreArmTexts
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.guardian.messages import Cause, GuardianVerdict
from fcsv_control.recorder_port import RecorderReport
from fcsv_geometry.streams.stream import Stream
from fcsv_geometry.vehicles import thresholds as at

_G, _A, _R, _U = Grade.GREEN, Grade.AMBER, Grade.RED, Grade.UNKNOWN
_WINDOW_S = 3.0
_PICTURES_S = 6.0
# EKF_STATUS_FLAGS: attitude, both velocities, horizontal and vertical position; without a position
# it stands still
_EKF_NEEDED = (
    (0x01, "attitude"),
    (0x02, "horizontal velocity"),
    (0x04, "vertical velocity"),
    (0x10, "horizontal position"),
    (0x20, "height"),
)
_EKF_CONSTANT_POSITION = 0x80


@dataclass(frozen=True)
class Disk:
    """Where the recorder writes: free space, and for how long it lasts where the recorder tells
    it."""

    free_mib: float
    minutes_left: float = math.nan


@dataclass
class VehicleFacts:
    """What was heard on board."""

    link: Stream[LinkLives] = field(default_factory=Stream)
    # told once, and where they change
    parameters: Stream[ParametersChecked] = field(default_factory=Stream)
    armed: Stream[bool] = field(default_factory=Stream)
    # with the autopilot's system status
    battery_share: Stream[float] = field(default_factory=Stream)
    tracker_variance_m2: Stream[float] = field(default_factory=Stream)
    recorder: Stream[RecorderReport] = field(default_factory=Stream)
    disk: Stream[Disk] = field(default_factory=Stream)
    guardian: Stream[GuardianVerdict] = field(default_factory=Stream)
    agent: Stream[AgentAlive] = field(default_factory=Stream)
    positions: Stream = field(default_factory=lambda: Stream(_WINDOW_S))
    pictures: Stream = field(default_factory=lambda: Stream(_PICTURES_S))
    relay: str = relay_keys.RELAY  # which program stands between the machines
    keys: Stream[relay_keys.Keys] = field(default_factory=Stream)
    texts: PreArmTexts = field(default_factory=PreArmTexts)
    line: autopilot_line.AutopilotLine = field(default_factory=autopilot_line.AutopilotLine)


def link_now(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Optional[LinkLives]:
    """The flight link's health where it is heard and its autopilot too."""
    fresh = f.link.fresh(now_s, r.silent_s)
    return f.link.value if fresh and f.link.value.connected else None


def _link(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if not f.link.fresh(now_s, r.silent_s):
        return _R, "the flight link is not heard"
    if not f.link.value.connected:
        return _R, "no heartbeat of the autopilot"
    return _G, "the autopilot is connected"


def _streams(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if link_now(now_s, f, r) is None:
        return _U, "no autopilot"
    if not f.battery_share.fresh(now_s, r.slow_silent_s):
        return _R, "no system status of the autopilot"
    if not f.link.value.ekf_age_s <= r.slow_silent_s:
        return _R, "no report of the autopilot's filter"
    hz = f.positions.rate_hz(now_s)
    found = conditions.rate(hz, r.red_position_hz, r.amber_position_hz)
    return found.measured(f"{hz:.0f} positions a second")


def _pre_arm(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if not f.armed.fresh(now_s, r.slow_silent_s) or link_now(now_s, f, r) is None:
        return _U, "no autopilot"
    if f.armed.value:
        return _G, "armed"
    told = f.link.value.prearm_ok if f.battery_share.fresh(now_s, r.slow_silent_s) else None
    if told is False:
        return _R, "; ".join(f.texts.now(now_s)) or "not ready to arm; it says why every 30 s"
    return (_G, "ready to arm") if told else (_U, "it has not said whether it is ready to arm")


def _origin(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    link = link_now(now_s, f, r)
    if link is None:
        return _U, "no autopilot"
    return (_G, "set") if link.origin_set else (_R, "the autopilot has no origin")


def _parameters(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    link = link_now(now_s, f, r)
    if link is None:
        return _U, "no autopilot"
    report = f.parameters.value
    if report is None:
        return _U, "they were not read yet"
    if report.blocks:
        return _R, _some(report.blocks)
    if not report.complete:
        return _U, "they are being read"
    return (_A, _some(report.advises)) if report.advises else (_G, f"they fit {report.profile}")


def _some(texts: Sequence[str]) -> str:
    """The first of them, and how many more there are.

    >>> _some(["A is 1", "B is 2", "C is 3"])
    'A is 1, and 2 more'
    """
    return texts[0] + (f", and {len(texts) - 1} more" if len(texts) > 1 else "")


def _ekf(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    link = link_now(now_s, f, r)
    if link is None or not link.ekf_age_s <= r.slow_silent_s:
        return _U, "no report of the filter"
    missing = [words for bit, words in _EKF_NEEDED if not link.ekf_flags & bit]
    if link.ekf_flags & _EKF_CONSTANT_POSITION:
        missing.append("any movement: it assumes a constant position")
    if missing:
        return _R, f"it has no {', no '.join(missing)}"
    found = conditions.ekf(link.ekf_variance, r.red_ekf_variance, r.amber_ekf_variance)
    return found.measured(f"variance {link.ekf_variance:.1f}")


def _estimate(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    link = link_now(now_s, f, r)
    apart_m = math.nan if link is None else link.estimate_apart_m
    bounds_m = r.red_apart_m, r.amber_apart_m
    if link is not None and link.in_the_air:
        bounds_m = r.red_apart_in_flight_m, r.red_apart_m
    found = conditions.estimate_apart(apart_m, *bounds_m)
    return found.measured(f"{apart_m:.1f} m from the tracker's pose")


def _poses(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if not f.link.fresh(now_s, r.silent_s):
        return _U, "the flight link is not heard"
    link = f.link.value
    if link.doubt:
        return _R, link.doubt
    if not conditions.feed_age(link.feed_age_s, r.red_feed_age_s).green:
        return _R, "no pose goes to the autopilot"
    found = conditions.feed_rate(link.feed_rate_hz, r.red_feed_hz, r.amber_feed_hz)
    return found.measured(f"{link.feed_rate_hz:.0f} poses a second")


def _tracker(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if not f.tracker_variance_m2.fresh(now_s, r.silent_s):
        return _R, "no pose comes from it"
    level = conditions.confidence_level(f.tracker_variance_m2.value)
    found = conditions.confidence(level, at.CONFIDENCE.check.red)
    return found.grade, found.words or f"{'high' if level > 2.5 else 'medium'} confidence"


def _transmitter(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    link = link_now(now_s, f, r)
    if link is None:
        return _U, "no autopilot"
    found = conditions.transmitter(link.throttle, link.throttle_age_s, r.silent_s)
    return found.grade, found.words or "heard"


def _battery(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if not f.battery_share.fresh(now_s, r.slow_silent_s):
        return _U, "not heard"
    found = conditions.battery(f.battery_share.value, r.red_battery, r.amber_battery)
    return (_R, found.words) if found.grade is _U else found.measured(f"{found.value:.0%}")


def _camera(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    hz = f.pictures.rate_hz(now_s)
    if hz == 0.0:
        return _R, "no picture comes from it"
    return conditions.rate(hz, 0.0, r.amber_picture_hz).measured(f"{hz:.1f} pictures a second")


def recorder(now_s: float, f, r) -> Found:
    """The line of a recorder: a vehicle's, and with the control PC's facts and rules its own."""
    told, age_s = f.recorder.value, f.recorder.age_s(now_s)
    problem, dropped = ("", 0) if told is None else (told.problem, told.dropped)
    found = conditions.recorder(age_s, problem, r.slow_silent_s, dropped)
    return found.grade, found.words or "it records"


def disk(now_s: float, f, r) -> Found:
    """The line of its disk, likewise."""
    if not f.disk.fresh(now_s, r.slow_silent_s):
        return _U, "the recorder's disk is not known"
    free_mib, left = f.disk.value.free_mib, f.disk.value.minutes_left
    lasts = f", enough for {disk_words(left)}" if math.isfinite(left) else ""
    found = conditions.disk(free_mib, r.red_disk_mib, r.amber_disk_mib)
    return found.measured(f"{free_mib / 1024:.1f} GiB free{lasts}")


def guardian(
    now_s: float, f: VehicleFacts, r: VehicleCheckRules, excused: Tuple[Cause, ...] = (Cause.STICK,)
) -> Found:
    """``excused``: what it may forbid GUIDED for. On the ground the stick is down; it is judged in
    flight."""
    if not f.guardian.fresh(now_s, r.silent_s):
        return _R, "not heard"
    g = f.guardian.value
    if g.lost:
        return _R, "it lost the vehicle's position in flight"
    if g.action:
        return _R, f"{g.action}: {'; '.join(g.reasons)}"
    forbids = [text for text, cause in zip(g.forbids, g.causes) if cause not in excused]
    return (
        (_R, f"forbids GUIDED: {'; '.join(forbids)}") if forbids else (_G, "nothing against flying")
    )


def _agent(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if not f.agent.fresh(now_s, r.silent_s):
        return _R, "not heard"
    return (_R, f.agent.value.problem) if f.agent.value.problem else (_G, "it obeys")


def _keys(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    return relay_keys.grade(now_s, f.keys, f.relay, r.slow_silent_s)


def _signing(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    if not f.link.fresh(now_s, r.silent_s):
        return _U, "the flight link is not heard"
    return autopilot_line.grade(f.line)


VEHICLE_CHECKS: Tuple[Check, ...] = (
    Check(
        "link",
        "the flight link hears its autopilot",
        "check cable and fcu_url; is the autopilot on?",
        _link,
    ),
    Check(
        "streams",
        "the autopilot sends position, system status and filter report at their rates",
        "free the serial line: its baud rate, other programs on it",
        _streams,
    ),
    Check(
        "pre-arm", "the autopilot is ready to arm, or armed", "do what the autopilot says", _pre_arm
    ),
    Check(
        "origin",
        "the autopilot goes on reporting an origin",
        "wait for its filter; else restart the autopilot",
        _origin,
    ),
    Check(
        "parameters",
        "the autopilot's parameters are as its profile says",
        "rosrun fcsv_control parameters compare, then write; restart the autopilot",
        _parameters,
    ),
    Check(
        "ekf",
        "the autopilot's filter has attitude, velocity and position, and agrees with its sensors",
        "keep still until it has settled; else restart the autopilot",
        _ekf,
    ),
    Check(
        "estimate",
        "the autopilot believes the tracker's pose",
        "keep still; else restart the autopilot",
        _estimate,
    ),
    Check(
        "feed",
        "poses go to the autopilot at 30 Hz",
        "check the tracking camera and its USB port",
        _poses,
    ),
    Check(
        "tracker",
        "the tracking camera trusts its poses",
        "better light, more texture; move it a little by hand",
        _tracker,
    ),
    Check(
        "transmitter",
        "the pilot's transmitter is heard",
        "switch it on; check the receiver",
        _transmitter,
    ),
    Check(
        "battery",
        "the battery is known and full enough",
        "change it; unknown: set BATT_MONITOR",
        _battery,
    ),
    Check("camera", "pictures come", "check the camera, its USB port and the node tags", _camera),
    Check("recorder", "the recorder writes", "start it again; see its log", recorder),
    Check(
        "disk",
        "there is room for the flight's pictures",
        "remove sessions that were gathered",
        disk,
    ),
    Check(
        "guardian",
        "the guardian lives and forbids nothing",
        "do away with what it names; see its log",
        guardian,
    ),
    Check(
        "agent",
        "the agent lives and obeys",
        "end the other agent, or start uav.launch again",
        _agent,
    ),
    relay_keys.check(_keys),
    autopilot_line.check(_signing),
)
NAMES: List[str] = [check.name for check in VEHICLE_CHECKS]
