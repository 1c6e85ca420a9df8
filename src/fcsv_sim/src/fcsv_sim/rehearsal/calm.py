# SPDX-License-Identifier: Apache-2.0
"""What must hold in a flight in which nothing befalls anybody that asks for an answer: nobody is
stopped, and no feed is late."""

from typing import Callable, Dict

from fcsv_geometry.missions.phases import FLOWN
from fcsv_geometry.vehicles import thresholds as at
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.rehearsal.control import ControlPc
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

POSES, CONTROL, OTHERS = (
    "poses at an autopilot",
    "control PC at a guardian",
    "another vehicle at a guardian",
)
SEEN, STATES = "poses at the mission", "states at the mission"
#: Longest silence (s) of each feed upon which nobody acts: an ArduCopter needs 10 poses a second;
#: rules of the guardian, and of the mission.
DEADLINES_S: Dict[str, float] = {
    POSES: 0.1,
    CONTROL: at.CONTROL_AGE_S.guardian.amber,
    OTHERS: at.OTHER_AGE_S.guardian.amber,
    SEEN: at.POSE_AGE_S.mission.red,
    STATES: at.STATE_AGE_S.mission.red,
}


class Calm:
    """``needless`` and ``late`` are called with a vehicle (or nobody), time and words of each
    violation."""

    def __init__(
        self,
        fleet: Dict[str, RehearsedVehicle],
        control: ControlPc,
        needless: Callable[[str, float, str], None],
        late: Callable[[str, float, str], None],
    ):
        self._fleet, self._control, self._needless, self._late = fleet, control, needless, late
        self._posed_s: Dict[str, float] = {}
        self._asked = dict.fromkeys(fleet, 0)  # mode commands that were looked at
        self.longest_s: Dict[str, float] = dict.fromkeys(DEADLINES_S, 0.0)

    def posed(self, now_s: float, name: str) -> None:
        """A pose left for an autopilot."""
        before_s = self._posed_s.get(name)
        self._posed_s[name] = now_s
        if before_s is not None and self._fleet[name].autopilot.armed:
            self._silent(now_s, name, POSES, now_s - before_s)

    def look(self, now_s: float) -> None:
        """Looks at everybody, every 0.05 s."""
        flown = self._control.machine.phase in FLOWN
        for name, vehicle in self._fleet.items():
            verdict, asked = vehicle.guardian.verdict, vehicle.modes_asked
            if verdict.action:
                self._needless(name, now_s, f"{name}'s guardian did: {verdict.in_words}")
            for _, mode in asked[self._asked[name] :] if flown else ():
                if mode != Mode.GUIDED:
                    self._needless(name, now_s, f"{name} was asked for {mode}")
            self._asked[name] = len(asked)
            if flown:
                self._ages(now_s, name, vehicle)
        problems = self._control.machine.problems
        if flown and problems:
            self._needless("", now_s, f"the mission paused: {'; '.join(problems)}")

    def end(self, now_s: float) -> None:
        """All must be recorded."""
        machine, wanted = self._control.machine, len(self._control.machine.mission.recorded)
        if machine.phase != "DONE" or len(machine.captures) != wanted:
            self._needless(
                "", now_s, f"{len(machine.captures)} of {wanted} recorded ({machine.detail})"
            )

    def _ages(self, now_s: float, name: str, vehicle: RehearsedVehicle) -> None:
        air = vehicle.guardian.air
        pose_age_s, state_age_s = self._control.ages_s(now_s, name)
        ages = [
            (CONTROL, air.control_s),
            *((OTHERS, other.heard_s) for other in air.others.values()),
        ]
        for feed, heard_s in ages:
            self._silent(now_s, name, feed, now_s - heard_s)
        self._silent(now_s, name, SEEN, pose_age_s)
        self._silent(now_s, name, STATES, state_age_s)
        self._silent(now_s, name, POSES, now_s - self._posed_s.get(name, now_s))

    def _silent(self, now_s: float, name: str, feed: str, silent_s: float) -> None:
        self.longest_s[feed] = max(self.longest_s[feed], silent_s)
        if silent_s > DEADLINES_S[feed]:
            self._late(name, now_s, f"{feed} ({name}): silent for {silent_s:.2f} s")
