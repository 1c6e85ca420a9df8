# SPDX-License-Identifier: Apache-2.0
"""Changing over: the whole column flies to another viewpoint as one rigid body, and turns there to
its heading.

Set-points of all vehicles glide in step, so that their figure stays as it is. Who is behind is
waited for; a figure that is out of shape stops everybody, and begins again from where they are.
"""

from itertools import combinations
from typing import Dict, List, Mapping, Sequence

import numpy as np

from fcsv_control.mission.activities.activity import Activity, Progress
from fcsv_control.mission.activities.moving import Travel
from fcsv_control.mission.activities.stages import GOES_BACK, MOVES
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.formation import FormationLeg, frame_of, legs_to
from fcsv_control.mission.ways.journey import go_to
from fcsv_control.mission.ways.places import heading_error_rad
from fcsv_control.mission.ways.routes import Keep
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.mission import Mission

_ORDER_EVERY_S = 0.2  # set-points: one that is lost on the radio is followed by the next
_LONGEST_STEP_S = 0.5  # after a pause of the mission's own process the set-points do not jump
# an autopilot follows a set-point at 1/s: so far behind its own a vehicle may be
_LAG_M, _LAG_S = 0.5, 2.0
# by so much two vehicles' lags may differ: then all wait; then all stop
_SHAPE_M, _BROKEN_M = 0.5, 1.0
_NEAREST = 0.8  # share of what is to be kept, of two that are out of shape
_THERE_M, _THERE_RAD = 0.3, 0.1


class ChangeOver(Activity):
    """One flight of the column to viewpoint ``view``. ``figure``: T_view_cam by vehicle that flies,
    the one that leads first. AGAIN: the column lost its shape."""

    def __init__(
        self, mission: Mission, outbox: Outbox, figure: Mapping[str, np.ndarray], view: int
    ):
        super().__init__()
        self.stage = MOVES if view else GOES_BACK
        self._mission, self._outbox, self._figure, self._view = mission, outbox, dict(figure), view
        self._leader = next(iter(self._figure))
        self._where = mission.viewpoints[view].title
        self._keep = Keep.of(mission)
        self._gathering: List[Travel] = []
        self._legs: List[FormationLeg] = []
        self._targets: Dict[str, np.ndarray] = {}  # T_home_cam
        self._share = self._rate = 0.0
        self._now_s = self._moved_s = 0.0
        self._ordered_s = float("-inf")

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        """Takes the figure where the leader is, then flies the legs. Raises MissionError where a
        vehicle does not follow."""
        if not self._targets:
            self._begin(snapshot)
        if self._gathering:
            if self._gathering[0].step(snapshot, guided) is Progress.UNDER_WAY:
                self.detail = self._gathering[0].detail
                return Progress.UNDER_WAY
            self._gathering = []
            self._now_s = self._moved_s = snapshot.now_s
        return self._glide(snapshot)

    def _begin(self, snapshot: Snapshot) -> None:
        """Plans from where the leader is now."""
        here = snapshot.vehicles[self._leader].T_home_cam
        T_from = frame_of(here, self._figure[self._leader])
        viewpoint = self._mission.viewpoints[self._view]
        self._legs = legs_to(T_from, viewpoint, self._figure, self._mission.flight)
        self._targets = {n: T_from @ T for n, T in self._figure.items()}
        others = {n: T for n, T in self._targets.items() if n != self._leader}
        go_to(self._outbox, snapshot, self._leader, self._targets[self._leader])
        if others:
            place = "their places in the column" if len(others) > 1 else "its place in the column"
            self._gathering = [Travel(self._mission, self._outbox, others, place, [self._leader])]
        self._now_s = self._moved_s = snapshot.now_s

    # ---- along the legs --------------------------------------------------------------------------

    def _glide(self, snapshot: Snapshot) -> Progress:
        now_s = snapshot.now_s
        dt_s, self._now_s = min(now_s - self._now_s, _LONGEST_STEP_S), now_s
        if self._broken(snapshot):
            self._notes.append(f"the column lost its shape on its way to {self._where}: all stood")
            return Progress.AGAIN
        behind = self._behind(snapshot)
        if self._legs:
            self._advance(dt_s, bool(behind))
        waits = f" (waiting for {' and '.join(behind)})" if behind else ""
        self.detail = f"the column changes over to {self._where}{waits}"
        if now_s - self._ordered_s >= _ORDER_EVERY_S - 1e-6:
            self._ordered_s = now_s
            for name, T_home_cam in self._targets.items():
                go_to(self._outbox, snapshot, name, T_home_cam)
        if not self._legs and self._there(snapshot):
            return Progress.DONE
        if now_s - self._moved_s > self._mission.settle.timeout_s:
            name = max(self._figure, key=lambda n: self._lag_m(snapshot, n))
            raise MissionError(
                f"{name} does not change over to {self._where}: {self._lag_m(snapshot, name):.1f} m behind"
            )
        return Progress.UNDER_WAY

    def _advance(self, dt_s: float, wait: bool) -> None:
        leg, before = self._legs[0], self._share
        self._share, self._rate = leg.rate.advanced(self._share, self._rate, dt_s, wait)
        self._moved_s = self._now_s if self._share > before else self._moved_s
        self._targets = leg.places(self._figure, self._share)
        if self._share >= 1.0:
            self._legs.pop(0)
            self._share = self._rate = 0.0

    # ---- the figure ------------------------------------------------------------------------------

    def _lags_m(self, snapshot: Snapshot) -> Dict[str, np.ndarray]:
        return {n: snapshot.p_home_cam(n) - T[:3, 3] for n, T in self._targets.items()}

    def _lag_m(self, snapshot: Snapshot, name: str) -> float:
        return float(np.linalg.norm(self._lags_m(snapshot)[name]))

    def _behind(self, snapshot: Snapshot) -> List[str]:
        """Who is further from its set-point than one that follows, or than the others are."""
        lags = self._lags_m(snapshot)
        most_m = _LAG_M + _LAG_S * self._mission.flight.speed_mps
        far = {n for n, lag in lags.items() if float(np.linalg.norm(lag)) > most_m}
        for a, b in combinations(lags, 2):
            if float(np.linalg.norm(lags[a] - lags[b])) > _SHAPE_M:
                far.add(max((a, b), key=lambda n: float(np.linalg.norm(lags[n]))))
        return [n for n in self._figure if n in far]

    def _broken(self, snapshot: Snapshot) -> bool:
        lags = self._lags_m(snapshot)
        for a, b in combinations(lags, 2):
            apart = snapshot.p_home_cam(a) - snapshot.p_home_cam(b)
            off_m = float(np.linalg.norm(lags[a] - lags[b]))
            if off_m > _BROKEN_M or (off_m > _SHAPE_M and self._keep.share(apart) < _NEAREST):
                return True
        return False

    def _there(self, snapshot: Snapshot) -> bool:
        return all(
            self._lag_m(snapshot, n) < _THERE_M
            and heading_error_rad(snapshot.vehicles[n].T_home_cam, T) < _THERE_RAD
            for n, T in self._targets.items()
        )
