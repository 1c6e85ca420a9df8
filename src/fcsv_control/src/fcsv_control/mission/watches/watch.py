# SPDX-License-Identifier: Apache-2.0
"""What must be well for the mission to go on. Texts hold no numbers that change: they are shown
until they change."""

import math
from functools import lru_cache
from itertools import combinations
from typing import Iterator, List, Optional, Tuple

from fcsv_control import conditions
from fcsv_control.mission.snapshot import RecorderView, Snapshot, VehicleView
from fcsv_control.mission.watches.pause_timers import Pause
from fcsv_control.mission.ways.routes import Keep
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions import separation
from fcsv_geometry.missions.mission import AIR_M, GROUND, Mission
from fcsv_geometry.missions.phases import FLOWN
from fcsv_geometry.missions.separation import SeparationRules
from fcsv_geometry.vehicles import thresholds as at

_TOO_NEAR = 0.6  # of the minimum separation: nearer than any noise of the poses explains
# of the air that the mission keeps, guardians keep so much
_GUARDED = SeparationRules().horizontal_m / AIR_M
_IN_THE_AIR = ("COLUMN", "CALIBRATE", "MOVE_HOME", "SET_HOME", *FLOWN)
_RECORDED = ("WAIT_VEHICLES", *FLOWN)
# people fly: a tracker on the ground sees nobody there yet
_BEFORE_SIGHT = ("WAIT_VEHICLES", "TAKE_OFF", "COLUMN")
_CALIBRATED = ("MOVE_HOME", "SET_HOME", *FLOWN)
_BATTERY_KNOWN = ("WAIT_VEHICLES", *FLOWN)


#: What is said of a vehicle that flies without a position: in LOITER and GUIDED it would follow a
#: wrong one.
LOST_POSITION = "lost its position: land it by hand in ALT_HOLD, keep away from it"


def lost(snapshot: Optional[Snapshot]) -> str:
    """Why nobody is calibrated or handed over now: who lost its position, and what to do; "" where
    nobody did."""
    views = {} if snapshot is None else snapshot.vehicles
    names = [n for n, v in views.items() if v.lost]
    if not names:
        return ""
    flies = any(views[n].armed for n in names)
    then = (
        "land it by hand in ALT_HOLD, or abort"
        if flies
        else "abort; it is known again after its next take-off"
    )
    return f"{' and '.join(names)} lost its position: {then}"


def problems(mission: Mission, phase: str, snapshot: Snapshot) -> List[str]:
    """Why the mission does not go on in this phase, one line each."""
    return [text for _, text in found(mission, phase, snapshot)]


def found(mission: Mission, phase: str, snapshot: Snapshot) -> List[Tuple[Pause, str]]:
    """The same with the kind of pause that each makes."""
    told: List[Tuple[Pause, str]] = []
    for name, view in snapshot.vehicles.items():
        told += [(kind, f"{name}: {text}") for kind, text in _of_vehicle(mission, phase, view)]
    if phase in _RECORDED and snapshot.recorder is not None:
        told += _of_recorder(snapshot.recorder, "control PC: ")
    if phase in FLOWN:
        told += [(Pause.LOST, text) for text in _too_near(mission, snapshot)]
    return told


def require_flyable(mission: Mission, phase: str, snapshot: Snapshot) -> None:
    """Raises MissionError where all must land: an empty battery, or a vehicle that is down
    already."""
    for name, view in snapshot.vehicles.items():
        empty = conditions.battery(view.battery_share, mission.empty_battery_share)
        if phase in _IN_THE_AIR and empty.red:
            raise MissionError(f"{name}: {empty.words}: landing everybody")
        if phase == "CONFIGURATIONS" and view.down:
            raise MissionError(f"{name}: motors are off: landing everybody")
        if phase in _IN_THE_AIR and view.down and view.lost:
            raise MissionError(f"{name}: lost its position and is down: landing everybody")
        if phase in FLOWN and view.sighted_off:
            raise MissionError(f"{name}: {view.sighted_off}: landing everybody")


def _of_vehicle(mission: Mission, phase: str, view: VehicleView) -> Iterator[Tuple[Pause, str]]:  # noqa: C901
    ages = [conditions.state_age(view.state_age_s, at.STATE_AGE_S.mission.red)]
    if mission.tracker != GROUND or phase not in _BEFORE_SIGHT:
        ages.append(conditions.pose_age(view.pose_age_s, at.POSE_AGE_S.mission.red))
    silent = " and ".join(age.words for age in ages if age.red)
    if silent:
        yield Pause.LOST, f"{silent}; check the radio link"
        return
    if not view.connected:
        yield Pause.LOST, "no flight controller"
    if view.lost and (view.armed or phase in _IN_THE_AIR):
        yield (
            Pause.LOST,
            LOST_POSITION
            if view.armed
            else "lost its position, and lies where nobody knows: abort",
        )
    if phase in FLOWN and view.guarded:
        yield Pause.LOST, f"its guardian: {view.guarded}"
    if phase == "WAIT_VEHICLES" and math.isnan(view.height_m):
        yield Pause.LOST, "its height is not heard"  # nor where the ground is
    if phase in _RECORDED:
        yield from _of_recorder(RecorderView(view.recorder_age_s, view.recorder_problem))
    if phase in _IN_THE_AIR and not view.armed:
        yield Pause.LOST, "motors are off"
    battery = conditions.battery(view.battery_share, mission.low_battery_share)
    if battery.red:
        yield Pause.BATTERY, f"{battery.words}; abort to land"
    elif phase in _BATTERY_KNOWN and not battery.green:
        told = "no GUIDED before its flight controller tells it"
        yield Pause.BATTERY, f"{battery.words}; {told}"
    if phase in _CALIBRATED and view.frame_problem:
        yield Pause.LOST, view.frame_problem
    if phase in _CALIBRATED and view.sighted_off:
        yield Pause.LOST, f"{view.sighted_off}; land by hand, or calibrate anew"
    if phase in FLOWN and view.T_home_cam is None:
        yield Pause.LOST, "its place in home is not known; calibrate and set home again"


def _of_recorder(r: RecorderView, who: str = "") -> Iterator[Tuple[Pause, str]]:
    found = conditions.recorder(r.age_s, r.problem, at.RECORDER_AGE_S.mission.red)
    if found.red:
        yield Pause.RECORDER, f"{who}recorder: {found.words}"


@lru_cache(maxsize=None)
def _kept(separation_m: float, air: SeparationRules) -> Keep:
    """What vehicles in flight must keep of what a mission's ways keep."""
    guarded = SeparationRules(_GUARDED * air.horizontal_m, air.vertical_factor)
    return Keep(_TOO_NEAR * separation_m, guarded)


def _too_near(mission: Mission, snapshot: Snapshot) -> Iterator[str]:
    keep = _kept(mission.min_separation_m, mission.air)
    known = {n: v for n, v in snapshot.vehicles.items() if v.T_home_cam is not None}
    for a, b in combinations(known, 2):
        offset_m = snapshot.p_home_cam(a) - snapshot.p_home_cam(b)
        age_s = max(known[n].pose_age_s for n in (a, b))
        doubt_m = separation.doubt_m(age_s=age_s, speed_mps=known[a].speed_mps + known[b].speed_mps)
        if keep.share(offset_m, doubt_m) < 1.0:
            yield f"{a} and {b} are too near to each other; move them apart by hand"
