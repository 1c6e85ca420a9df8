# SPDX-License-Identifier: Apache-2.0
"""Following a robot in steps: all hold, and go one at a time where they are asked to; nothing is
recorded."""

import logging
from typing import Collection, Dict, List, Mapping, Optional

import numpy as np

from fcsv_control.mission.activities.activity import Activity, Progress
from fcsv_control.mission.activities.stages import FOLLOWS
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.journey import Journey
from fcsv_control.mission.ways.places import FollowPlace, level_camera
from fcsv_control.mission.ways.routes import Keep, route
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.streams.stream import Since

_log = logging.getLogger(__name__)
_MOST_M = 6.0  # a vehicle is sent so far at once
# nobody sets out before all have stood for so long: a way is planned from where they stand
_STANDS_MPS, _STANDS_S = 0.3, 0.5
_NEAREST = 1.0 - 1e-6  # share of what is to be kept between two places
_LOWEST_M = 1.0  # above the take-off place; to no lower height is anybody sent


class Following(Activity):
    """It lasts ``follow_s``, pauses included, or until the operator skips it; who is on its way then
    comes to its place first. ``places``: T_home_cam by vehicle, of those that were sent to one; the
    others hold where they are. Says in `detail` and the log why a move is not flown."""

    stage = FOLLOWS

    def __init__(
        self, mission: Mission, outbox: Outbox, follow_s: float, places: Mapping[str, np.ndarray]
    ):
        super().__init__()
        self._mission, self._outbox, self._keep = mission, outbox, Keep.of(mission)
        self._follow_s, self._lasts, self._skipped = follow_s, Since(), False
        self._stand = Since()
        self._places, self._begun = dict(places), False
        self._asked: Dict[str, FollowPlace] = {}  # by whose turn it is
        self._journey: Optional[Journey] = None
        self._refused = ""

    def ask(self, vehicle: str, place: FollowPlace) -> None:
        """A vehicle shall go there, once those before it are at their places; the newest counts."""
        self._asked[vehicle] = place

    def skip(self) -> bool:
        self._skipped = True
        return True

    def stop(self, snapshot: Snapshot) -> None:
        """All hold; who was on its way goes on afterwards, and their places are where they are
        then."""
        if self._journey is not None:
            name = self._journey.name
            self._asked = {name: FollowPlace.of(self._places[name]), **self._asked}
        self._journey, self._places, self._begun = None, {}, False

    def keep(self, vehicles: Collection[str]) -> None:
        """Only these still go where they were asked to."""
        self._asked = {n: at for n, at in self._asked.items() if n in vehicles}

    def step(self, snapshot: Snapshot, guided: Collection[str]) -> Progress:
        """Raises MissionError where a vehicle does not get to its place."""
        if not self._begun:
            held = {n: level_camera(snapshot.vehicles[n].T_home_cam) for n in guided}
            self._places, self._begun = {**held, **self._places}, True
        late = self._lasts.lasts_s(snapshot.now_s) > self._follow_s
        if self._journey is not None and self._journey.step(snapshot):
            self._journey = None
        if self._journey is None and (late or self._skipped):
            return Progress.DONE
        self.keep(self._places)
        calm = all(snapshot.vehicles[n].speed_mps < _STANDS_MPS for n in self._places)
        stand = self._stand.lasts_s(snapshot.now_s, calm) >= _STANDS_S - 1e-6
        while stand and self._asked and self._journey is None:
            name = next(iter(self._asked))
            self._begin(snapshot, name, self._asked.pop(name))
        what = "all hold" if self._journey is None else f"{self._journey.name} goes to its place"
        self.detail = f"{' and '.join(self._places)} follow: {what}{self._refused}"
        return Progress.UNDER_WAY

    def _begin(self, snapshot: Snapshot, name: str, place: FollowPlace) -> None:
        """Sets out, or says why not."""
        T_home_cam = place.from_here(self._places[name])
        try:
            if place.z_m is not None:
                self._require_height(place.z_m)
            way = self._way(snapshot, name, T_home_cam[:3, 3])
        except MissionError as error:
            there = f"({place.x_m:.1f}, {place.y_m:.1f}) m in home"
            self._refused = f"; {name} stays, not to {there}: {error}"
            _log.warning("%s", self._refused[2:])
            return
        self._refused, self._places[name] = "", T_home_cam
        self._journey = Journey(
            self._outbox, name, T_home_cam, self._keep, self._mission.settle.timeout_s, way
        )

    def _require_height(self, z_m: float) -> None:
        above_m = z_m + self._mission.home_height_m
        if above_m < _LOWEST_M:
            raise MissionError(
                f"{above_m:.1f} m above the take-off place, {_LOWEST_M:g} m at least"
            )

    def _way(self, snapshot: Snapshot, name: str, goal_m: np.ndarray) -> List[np.ndarray]:
        here_m, height_m = snapshot.p_home_cam(name), self._mission.home_height_m
        away_m = float(np.hypot(*(goal_m - here_m)[:2]))
        if away_m > _MOST_M:
            raise MissionError(f"{away_m:.1f} m away, {_MOST_M:g} m at once at most")
        places_m = {n: T[:3, 3] for n, T in self._places.items() if n != name}
        for other, place_m in places_m.items():
            if self._keep.share(goal_m - place_m) < _NEAREST:
                near_m, needed = (
                    np.linalg.norm(goal_m - place_m),
                    self._keep.needed(goal_m - place_m),
                )
                raise MissionError(f"{near_m:.1f} m from {other}'s place, {needed}")
        others_m = [*places_m.values(), *(snapshot.p_home_cam(n) for n in places_m)]
        way = route(here_m, goal_m, others_m, self._keep)
        outside = next(filter(None, (self._mission.fence.outside(p, height_m) for p in way)), "")
        if outside:
            raise MissionError(outside)
        return way
