# SPDX-License-Identifier: Apache-2.0
"""When a mission's plan is checked: before take-off, and once more from where the vehicles hang
when home is set."""

from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from fcsv_control.mission.plans import plan_check
from fcsv_control.mission.snapshot import Snapshot
from fcsv_geometry.missions.mission import Mission


class PlanGate:
    """``radius_m`` by vehicle. Raises MissionError where a leg cannot be flown whatever the
    batteries hold."""

    def __init__(
        self, mission: Mission, vehicles: Sequence[str], radius_m: Optional[Mapping[str, float]]
    ):
        self._from_ground = plan_check.require_flyable(mission, vehicles, radius_m)
        self._mission, self._vehicles, self._radius_m = mission, list(vehicles), radius_m

    def before_take_off(self, snapshot: Snapshot) -> List[str]:
        """Why nobody may take off."""
        situation = plan_check.on_the_ground(self._mission, self._vehicles, _shares(snapshot))
        return plan_check.wrong_with(self._mission, situation, self._from_ground)

    def from_here(self, snapshot: Snapshot, indices: Optional[Sequence[int]], as_many: bool) -> str:
        """Why the list cannot be flown from where the vehicles hang now, "" where it can or places
        are not known. ``as_many``: of stations as many as the batteries allow, at least one."""
        situation = self._here(snapshot)
        if situation is None:
            return ""  # GUIDED waits for it
        wrong = plan_check.check_plan(self._mission, situation, self._radius_m, indices, as_many)
        return "; ".join(wrong)

    def within_batteries(
        self, snapshot: Snapshot, indices: Optional[Sequence[int]]
    ) -> Tuple[Optional[List[int]], str]:
        """Chooses of ``indices`` (None: all) the configurations of the stations that the batteries
        allow, and says in words after which one to come back; None and "" where they allow all, or places are not
        known."""
        situation = self._here(snapshot)
        if situation is None or not self._mission.stations:
            return None, ""
        flight = plan_check.fly_on_paper(self._mission, situation, self._radius_m, indices)
        reached = plan_check.reached(self._mission, situation, flight)
        if len(reached) == len(flight.views):
            return None, ""
        last = self._mission.viewpoints[reached[-1].view].title
        missing = [self._mission.viewpoints[v.view].title for v in flight.views[len(reached) :]]
        words = f"the batteries reach to {last} and back, left out: {', '.join(missing)}"
        return [i for view in reached for i in view.configurations], words

    def _here(self, snapshot: Snapshot) -> Optional[plan_check.Situation]:
        """Situation as the vehicles hang now; None where a place is not known."""
        views = snapshot.vehicles
        if any(v.T_home_cam is None for v in views.values()):
            return None
        places = {n: snapshot.p_home_cam(n) for n in self._vehicles}
        height_m = views[self._mission.reference].height_m
        return plan_check.Situation(height_m, places, _shares(snapshot), before_s=0.0)


def _shares(snapshot: Snapshot) -> Dict[str, float]:
    """Gives the charges of the batteries that are known, in whole percent."""
    return {
        n: round(v.battery_share, 2)
        for n, v in snapshot.vehicles.items()
        if v.battery_share == v.battery_share
    }
