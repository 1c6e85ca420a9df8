# SPDX-License-Identifier: Apache-2.0
"""What the control PC adds to the vehicles' own lines: the radio, clocks, who sees whose tag, and
its own programs."""

from dataclasses import dataclass, field, replace
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from fcsv_control import conditions
from fcsv_control.conditions import Grade
from fcsv_control.flight.messages import ParametersChecked
from fcsv_control.flight_check import keys as relay_keys
from fcsv_control.flight_check import speeds
from fcsv_control.flight_check.lines import Check, Found, Judged, Line
from fcsv_control.flight_check.sightings import Sightings
from fcsv_control.flight_check.vehicle import Disk, disk, recorder
from fcsv_control.recorder_port import RecorderReport
from fcsv_geometry.config import require_graded, require_positive
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.streams.stream import Stream
from fcsv_geometry.vehicles import thresholds as at
from fcsv_tracking.devices.clocks import ClockOffset

CONTROL = "control"
_G, _A, _R, _U = Grade.GREEN, Grade.AMBER, Grade.RED, Grade.UNKNOWN
_WINDOW_S = 3.0


@dataclass(frozen=True)
class FleetCheckRules:
    """``red_*`` and ``amber_*`` are bounds; what is worse than the red one is red."""

    silent_s: float = at.OFTEN_AGE_S.fleet.red  # of what comes at least twice a second
    slow_silent_s: float = at.SLOW_AGE_S.fleet.red  # of what comes once a second
    clock_silent_s: float = at.CLOCK_AGE_S.fleet.red
    red_radio_hz: float = at.RADIO_HZ.fleet.red  # poses that arrive, of 30 that are sent
    amber_radio_hz: float = at.RADIO_HZ.fleet.amber
    red_clock_s: float = at.CLOCK_S.fleet.red  # offset between a vehicle's clock and ours
    amber_clock_s: float = at.CLOCK_S.fleet.amber  # at 1 m/s of sway 2 cm of calibration
    red_disk_mib: float = at.DISK_MIB.fleet.red
    amber_disk_mib: float = at.DISK_MIB.fleet.amber  # the control PC records no pictures

    def __post_init__(self):
        require_positive(self)
        require_graded(self)


@dataclass
class FromAfar:
    """One vehicle as the control PC hears it; ``front`` is whose tag it should see, None for the
    first."""

    name: str
    front: Optional[str] = None
    report: Stream[Sequence[Line]] = field(default_factory=Stream)
    patience_s: float = 0.0  # of its report
    parameters: Optional[ParametersChecked] = None  # the newest: it comes where it changes
    poses: Stream = field(default_factory=lambda: Stream(_WINDOW_S))
    clock: Stream[ClockOffset] = field(default_factory=Stream)
    epoch: Optional[int] = None
    calibrated: Optional[int] = None  # the epoch for which the calibration holds
    sightings: Sightings = field(default_factory=lambda: Sightings({}))

    def silent(self, now_s: float) -> bool:
        """Whether its own flight check is not heard."""
        return not self.report.fresh(now_s, self.patience_s)

    def reported_lines(self, now_s: float) -> Sequence[Line]:
        """Its own lines, older by as long as its report has been here; none where it is not heard
        any more."""
        if self.silent(now_s):
            return ()
        return [
            replace(li, since_s=li.since_s + now_s - self.report.at_s) for li in self.report.value
        ]


@dataclass
class ControlFacts:
    """The control PC's own programs; ``mission`` holds the mission's phase."""

    link: str = relay_keys.RELAY
    mission: Stream[str] = field(default_factory=Stream)
    stop_all: Stream[bool] = field(default_factory=Stream)
    recorder: Stream[RecorderReport] = field(default_factory=Stream)
    disk: Stream[Disk] = field(default_factory=Stream)
    keys: Stream[relay_keys.Keys] = field(default_factory=Stream)


# ---- of every vehicle ----------------------------------------------------------------------------


def _report(now_s: float, v: FromAfar, _r: FleetCheckRules) -> Found:
    if v.report.value is None:
        return _R, "its own flight check was never heard"
    if v.silent(now_s):
        return _R, "its own flight check is not heard any more"
    return _G, "heard"


def _radio(now_s: float, v: FromAfar, r: FleetCheckRules) -> Found:
    hz = v.poses.rate_hz(now_s)
    found = conditions.rate(hz, r.red_radio_hz, r.amber_radio_hz)
    return found.measured(f"{hz:.0f} poses a second arrive" if hz else "no pose arrives")


def _clock(now_s: float, v: FromAfar, r: FleetCheckRules) -> Found:
    if not v.clock.fresh(now_s, r.clock_silent_s):
        return _U, "it does not answer about its clock"
    ahead_s = v.clock.value.offset_s
    found = conditions.clock(v.clock.value.least_s, r.red_clock_s, r.amber_clock_s)
    direction = "ahead of" if ahead_s > 0 else "behind"
    return found.measured(f"{abs(ahead_s):.3f} s {direction} the control PC's")


def _tags(now_s: float, v: FromAfar, _r: FleetCheckRules) -> Found:
    by = v.sightings.seen_by(now_s, v.name)
    seen = f"seen by {' and '.join(by)}" if by else "seen by nobody"
    if v.front is None:
        return _G, f"flies in front; {seen}"
    sees, for_s = v.sightings.sees(now_s, v.name, v.front)
    if sees:
        return _G, f"sees {v.front}, for {for_s:.0f} s; {seen}"
    lacks = f"does not see {v.front}" + (
        ", and never did" if for_s is None else f", for {for_s:.0f} s"
    )
    if v.calibrated is not None and v.calibrated == v.epoch:
        return _G, f"calibrated; {lacks}; {seen}"
    return _A, f"{lacks}; {seen}"


FLEET_CHECKS: Tuple[Check, ...] = (
    Check(
        "check",
        "its own flight check is heard",
        "start uav.launch; rosrun fcsv_multimaster link_status",
        _report,
    ),
    Check(
        "radio",
        "its poses arrive",
        "go nearer, turn the antenna; rosrun fcsv_multimaster link_status",
        _radio,
    ),
    Check("clock", "its clock and the control PC's agree", "start chrony on it", _clock),
    Check(
        "tags",
        "it sees the tag of the vehicle in front, or is calibrated",
        "line it up behind the other; light on the tag; its camera",
        _tags,
    ),
)


GROUND_CHECKS: Tuple[Check, ...] = (replace(FLEET_CHECKS[0], remedy="start tello.launch for it"),)


# ---- of the control PC ---------------------------------------------------------------------------


def _mission(now_s: float, f: ControlFacts, r: FleetCheckRules) -> Found:
    return (_G, f.mission.value) if f.mission.fresh(now_s, r.silent_s) else (_R, "not heard")


def _stop_all(now_s: float, f: ControlFacts, r: FleetCheckRules) -> Found:
    return (_G, "it stands by") if f.stop_all.fresh(now_s, r.silent_s) else (_R, "not heard")


def _keys(now_s: float, f: ControlFacts, r: FleetCheckRules) -> Found:
    return relay_keys.grade(now_s, f.keys, f.link, r.slow_silent_s)


CONTROL_CHECKS: Tuple[Check, ...] = (
    Check(
        "mission",
        "the mission node lives: its file can be flown",
        "mend the mission file; see its log",
        _mission,
    ),
    Check(
        "stop-all", "the node that stops everybody lives", "start control.launch again", _stop_all
    ),
    Check("recorder", "the recorder writes", "start it again; see its log", recorder),
    Check("disk", "there is room for the session", "remove sessions that were gathered", disk),
    relay_keys.check(_keys),
)


class FleetTable:
    """The whole table: the control PC's lines, then each vehicle's: what is heard of it, then what
    it says itself.

    ``ground``: a tracker on the ground tells where all are, and all links run on the control PC
    (tello.launch): nothing crosses a radio of ours, there is one clock, and no vehicle looks for
    another's tag. ``planned``: how fast the mission plans; without, or for vehicles before a
    tracker on the ground, nothing is compared with it.
    """

    def __init__(
        self,
        vehicles: Sequence[str],
        tags: Mapping[str, int],
        rules: FleetCheckRules,
        link: str,
        ground: bool = False,
        planned: Optional[FlightBounds] = None,
    ):
        self.sightings, self.control, self._rules = Sightings(tags), ControlFacts(link), rules
        fronts = [None, *vehicles[:-1]]
        self.vehicles: Dict[str, FromAfar] = {
            n: FromAfar(n, front, sightings=self.sightings) for n, front in zip(vehicles, fronts)
        }
        checks = GROUND_CHECKS if ground else FLEET_CHECKS
        checks += () if ground or planned is None else (speeds.check(planned),)
        self._judged = {n: Judged(n, checks) for n in vehicles}
        control = [check for check in CONTROL_CHECKS if not (ground and check.name == "keys")]
        self._judged_control = Judged(CONTROL, control)

    def lines(self, now_s: float) -> List[Line]:
        """Gives the lines at monotonic time ``now_s``."""
        lines = self._judged_control.lines(now_s, self.control, self._rules)
        for name, vehicle in self.vehicles.items():
            lines += self._judged[name].lines(now_s, vehicle, self._rules)
            lines += vehicle.reported_lines(now_s)
        return lines
