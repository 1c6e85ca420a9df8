# SPDX-License-Identifier: Apache-2.0
"""Brings several vehicles to their places: at once where their ways are clear of each other in
time."""

from typing import Dict, List, Mapping, Optional, Sequence

import numpy as np

from fcsv_control.mission.activities.holding import Holding
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways import traffic
from fcsv_control.mission.ways.journey import Journey
from fcsv_control.mission.ways.routes import Keep
from fcsv_geometry.missions.mission import Mission

_OFF_M = 0.8  # from where a vehicle may be at a time: it is not on its timed way
SLICES = 3  # of a plan in one step


class Convoy:
    """Planned in the first steps, from where everybody is at the first. All watch the clock: a
    vehicle that leaves the band of its timed way stops everybody of the convoy, and they go on one
    after the other."""

    def __init__(self, outbox: Outbox, mission: Mission, places: Mapping[str, np.ndarray]):
        self._outbox, self._mission = outbox, mission
        self._keep = Keep.of(mission)
        self._places = dict(places)  # T_home_cam by vehicle
        self._planning: Optional[traffic.Planning] = None
        self._plan: Optional[traffic.Traffic] = None
        self._journeys: Dict[str, Journey] = {}
        self._began_s = 0.0
        self._stopping: Optional[Holding] = None
        self._single_file = False
        self.said = ""  # why they go on one after the other

    def step(self, snapshot: Snapshot, others: Sequence[str]) -> bool:
        """Whether all are there. ``others`` stand. Raises MissionError where there is no way, or it
        is not flown."""
        if self._stopping is not None and not self._stand_still(snapshot):
            return False
        if not self._journeys and not self._begin(snapshot, others):
            return False
        if self._single_file:
            return self._one_after_the_other(snapshot, others)
        now_s = snapshot.now_s - self._began_s
        late = [n for n in self._journeys if self._off(snapshot, n, now_s)]
        if late:
            self.said = f"{', '.join(late)} not on its way in time: one after the other"
            self._stopping, self._single_file, self._journeys = self._holding(), True, {}
            return self._stand_still(snapshot)
        # each moves on in each step
        there = [self._on_time(snapshot, n, now_s) for n in self._journeys]
        return all(there)

    # ---- how -------------------------------------------------------------------------------------

    def _begin(self, snapshot: Snapshot, others: Sequence[str]) -> bool:
        """Whether it is planned. A vehicle alone needs no times, and neither do those who go one
        after the other."""
        names, departures = tuple(self._places), {}
        self._single_file |= len(names) == 1
        if len(names) > 1:
            self._planning = self._planning or self._plan_from(snapshot, others)
            self._plan = self._planning.step(SLICES)
            if self._plan is None:
                return False
            self._planning, names, departures = None, self._plan.order, self._plan.departures or {}
            self._single_file |= not departures
        self._began_s = snapshot.now_s
        self._journeys = {
            n: self._journey(n, departures[n].way if departures else None) for n in names
        }
        return True

    def _plan_from(self, snapshot: Snapshot, others: Sequence[str]) -> traffic.Planning:
        """All stand where they hold until it is made."""
        starts = {n: snapshot.p_home_cam(n) for n in self._places}
        goals = {n: T[:3, 3] for n, T in self._places.items()}
        standing = [snapshot.p_home_cam(n) for n in others]
        how = traffic.one_after_the_other if self._single_file else traffic.plan
        return how(starts, goals, standing, self._keep, self._mission.flight)

    def _journey(self, name: str, way: Optional[List[np.ndarray]]) -> Journey:
        return Journey(
            self._outbox, name, self._places[name], self._keep, self._mission.settle.timeout_s, way
        )

    def _one_after_the_other(self, snapshot: Snapshot, others: Sequence[str]) -> bool:
        names = list(self._journeys)
        return all(
            self._journeys[n].step(snapshot, [*others, *(o for o in names if o != n)])
            for n in names
        )

    def _on_time(self, snapshot: Snapshot, name: str, now_s: float) -> bool:
        """Says whether it is on time: at way-points it waits for its time."""
        journey, timed = self._journeys[name], self._plan.departures[name].timed
        if (
            journey.between
            and journey.behind < len(timed.begins_s)
            and now_s < timed.begins_s[journey.behind]
        ):
            return False
        return journey.step(snapshot)

    # ---- a vehicle that is not on time -----------------------------------------------------------

    def _off(self, snapshot: Snapshot, name: str, now_s: float) -> bool:
        return self._plan.departures[name].timed.off_m(snapshot.p_home_cam(name), now_s) > _OFF_M

    def _holding(self) -> Holding:
        return Holding(self._outbox, self._mission.min_separation_m)

    def _stand_still(self, snapshot: Snapshot) -> bool:
        """All of the convoy hold; whether they stand."""
        self._stopping.step(snapshot, list(self._places))
        if self._stopping.stood(snapshot, list(self._places)) and self._stopping.done:
            self._stopping = None
            return True
        return False
