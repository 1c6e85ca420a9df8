# SPDX-License-Identifier: Apache-2.0
"""A robot among vehicles drives in steps, and they follow in steps (thesis 4.1): before it sets out,
and where its place has become less sure or a vehicle goes out of sight, it stands; one vehicle after
the other flies to a place beside the way ahead, and the gimbals measure anew how they drift.

A robot that stands keeps its place, so that it tells where a vehicle is that moves. The drift learnt
at both ends of a step tells the filter how the vehicles moved in between.
"""

from dataclasses import dataclass
from typing import Callable, List, Mapping, Optional, Tuple

import numpy as np

from fcsv_geometry.config import require_positive
from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.place.cooperative_place import CooperativeState


@dataclass(frozen=True)
class StepRules:
    """The robot stands once its place's variance has grown by ``grown_m`` squared, or once it drove
    ``least_way_m`` and a vehicle is ``far_m`` away (level) or was not seen for ``unseen_s``. It
    drives on when no vehicle moves and the drift is known to ``drift_mps``: after ``least_s``,
    ``longest_s`` at most. A vehicle is moved by ``least_move_m`` at least, is there within
    ``near_m``, and gets ``move_s``."""

    grown_m: float = 0.03
    drift_mps: float = 0.007
    far_m: float = 3.5
    unseen_s: float = 1.5
    least_way_m: float = 0.5
    least_s: float = 2.0
    longest_s: float = 4.0
    least_move_m: float = 0.5
    near_m: float = 0.2
    move_s: float = 12.0

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class MoveVehicle:
    """A vehicle shall fly to x, y (m) in home, at its height."""

    vehicle: str
    x_m: float
    y_m: float


@dataclass(frozen=True)
class StepAdvice:
    """``hold``: why the robot shall stand now, empty where it may drive; ``move``: what a vehicle is
    told now."""

    hold: str = ""
    move: Optional[MoveVehicle] = None


#: Where vehicles should hold while the robot drives on, x and y in home (m) by name.
ChoosePlaces = Callable[[CooperativeState], Mapping[str, Tuple[float, float]]]


class DriveInSteps:
    """Says when the robot shall stand and which vehicle moves; told of every state of a
    CooperativeTracker."""

    def __init__(self, choose: ChoosePlaces, rules: StepRules = StepRules()):
        self._choose, self._rules, self._holds = choose, rules, False
        # of the last stand: sigma and place
        self._least_m, self._at = np.inf, (np.nan, np.nan)
        self._moves: List[MoveVehicle] = []
        self._sent_s, self._free_s = -np.inf, -np.inf  # the first of them; since when none moves

    def step(self, now_s: float, state: CooperativeState) -> StepAdvice:
        """What holds now."""
        place = state.robot.place
        if place is None:
            return StepAdvice()  # it stands for want of a place
        if np.isnan(self._at[0]):  # before it sets out vehicles come beside its way
            self._at, self._holds, self._free_s = _xy(place), True, np.inf
        if not self._holds:
            self._least_m = min(self._least_m, place.sigma_m)
            self._holds = self._shall_stand(place, state)
            self._free_s = np.inf
        if not self._holds:
            return StepAdvice()
        if self._free_s == np.inf and state.stood_s > 0.0 and not self._moves:
            self._moves = self._wanted(state)
            self._sent_s, self._free_s = -np.inf, now_s
        move = self._moved(now_s, state)
        stood_s, rules = min(state.stood_s, now_s - self._free_s), self._rules
        known = stood_s >= rules.least_s and state.drift_sigma_mps <= rules.drift_mps
        if not self._moves and (known or stood_s >= rules.longest_s):
            self._holds, self._least_m, self._at = False, place.sigma_m, (place.x_m, place.y_m)
            return StepAdvice()
        what = f"{self._moves[0].vehicle} follows" if self._moves else "it measures their drift"
        return StepAdvice(f"the robot stands among its vehicles: {what}", move)

    def _shall_stand(self, place: RobotPlace, state: CooperativeState) -> bool:
        rules = self._rules
        if place.sigma_m**2 - self._least_m**2 > rules.grown_m**2:
            return True
        if state.stood_s > 0.0 or np.hypot(*np.subtract(self._at, _xy(place))) < rules.least_way_m:
            return False
        away_m = [np.hypot(v.x_m - place.x_m, v.y_m - place.y_m) for v in state.vehicles.values()]
        return max(away_m, default=0.0) > rules.far_m or state.unseen_s > rules.unseen_s

    def _wanted(self, state: CooperativeState) -> List[MoveVehicle]:
        """Moves worth their time, the farthest vehicle first."""
        wanted = [MoveVehicle(n, *at) for n, at in self._choose(state).items()]
        far = [m for m in wanted if _off_m(m, state) >= self._rules.least_move_m]
        return sorted(far, key=lambda move: -_off_m(move, state))

    def _moved(self, now_s: float, state: CooperativeState) -> Optional[MoveVehicle]:
        """The move to be told now; drops those that are over."""
        rules = self._rules
        if self._moves and self._sent_s > -np.inf:
            late = now_s - self._sent_s > rules.move_s
            if not late and _off_m(self._moves[0], state) > rules.near_m:
                return None
            self._moves.pop(0)
            self._free_s, self._sent_s = now_s, -np.inf
        if not self._moves:
            return None
        self._sent_s = now_s
        return self._moves[0]


def _xy(place) -> Tuple[float, float]:
    return place.x_m, place.y_m


def _off_m(move: MoveVehicle, state: CooperativeState) -> float:
    return float(np.hypot(*np.subtract(_xy(move), _xy(state.vehicles[move.vehicle]))))
