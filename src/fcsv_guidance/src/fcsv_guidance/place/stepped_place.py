# SPDX-License-Identifier: Apache-2.0
"""A robot's place by the gimbals on it, while it drives and its vehicles follow in steps (thesis
4.1): what the tracker knows, when the robot stands, and which vehicle flies where.

A port: messages and monotonic time in, a SteppedPlace out.
"""

from dataclasses import dataclass, replace
from typing import Dict, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from fcsv_guidance.place import cooperative_place
from fcsv_guidance.place.cooperative_place import (
    CooperativeRules,
    CooperativeState,
    CooperativeTracker,
)
from fcsv_guidance.place.hold_places import hold_places
from fcsv_guidance.place.steps import DriveInSteps, MoveVehicle
from fcsv_guidance.place.tracker import LevelPlace, PlaceState
from fcsv_guidance.route.following import Polyline, RouteToFollow
from fcsv_tracking.gimbal.config import Gimbal

_RULES = CooperativeRules()
_AHEAD_M = 2.5  # of the way, beside which vehicles that follow hold

Message = Union[cooperative_place.Message, RouteToFollow]


@dataclass(frozen=True)
class SteppedPlace:
    """``robot``: its place, and why it shall stand now; ``vehicles``: their bodies, by name;
    ``move``: what one of them is told now."""

    robot: PlaceState
    vehicles: Mapping[str, LevelPlace]
    move: Optional[MoveVehicle] = None


class PlaceInSteps:
    """``gimbals``: those on the robot, whose vehicles follow it along the last route that came, or
    (not ``follow``) hold while it stands and measures how they drift."""

    def __init__(
        self, gimbals: Sequence[Gimbal], rules: CooperativeRules = _RULES, follow: bool = True
    ):
        self._gimbals, self._tracker = gimbals, CooperativeTracker(rules)
        self._steps = DriveInSteps(self._choose if follow else lambda _state: {})
        self._line: Optional[Polyline] = None

    def receive(self, now_s: float, message: Message) -> None:
        """A message came. Raises TypeError where its type is not known, RouteError where a route is
        none; a reading that is not finite is refused."""
        if isinstance(message, RouteToFollow):
            self._line = message.polyline()
        else:
            self._tracker.receive(now_s, message)

    def step(self, now_s: float) -> SteppedPlace:
        """What holds now; without a route nobody stands or moves for it."""
        state = self._tracker.step(now_s)
        if self._line is None:
            return SteppedPlace(state.robot, state.vehicles)
        advice = self._steps.step(now_s, state)
        return SteppedPlace(replace(state.robot, hold=advice.hold), state.vehicles, advice.move)

    def _choose(self, state: CooperativeState) -> Dict[str, Tuple[float, float]]:
        """The places beside the next part of the way; none where there are none."""
        place, names = state.robot.place, [gimbal.vehicle for gimbal in self._gimbals]
        if not all(name in state.vehicles for name in names):
            return {}
        along = np.arange(0.0, self._line.length_m, 0.1)
        off_m = np.hypot(*(self._line.at(along) - [place.x_m, place.y_m]).T)
        at_m = along[int(np.argmin(off_m))]
        ahead = self._line.at(np.linspace(at_m, at_m + _AHEAD_M, 12))
        way_m = np.vstack([[place.x_m, place.y_m], ahead])
        now_m = [(state.vehicles[n].x_m, state.vehicles[n].y_m) for n in names]
        found = hold_places(way_m, self._gimbals, place.yaw_rad, now_m)
        return {} if found is None else dict(zip(names, found.places_m))
