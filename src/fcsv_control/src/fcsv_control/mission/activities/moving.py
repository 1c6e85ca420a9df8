# SPDX-License-Identifier: Apache-2.0
"""Activities on the way: all hold, the reference goes home, movers travel to their places, or back
to the column."""

from typing import Mapping, Optional, Sequence

import numpy as np

from fcsv_control.mission.activities.activity import Activity, Progress
from fcsv_control.mission.activities.holding import Holding
from fcsv_control.mission.activities.stages import GOES_BACK, MOVES
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.convoy import Convoy
from fcsv_control.mission.ways.journey import Journey
from fcsv_control.mission.ways.places import level_camera
from fcsv_control.mission.ways.routes import Keep
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.mission import Mission

_RISES_M = 2.0  # so far below its place a vehicle goes up first


class Hold(Activity):
    """All hold, until they have stood for a second after the last pause. ``restarted``: see
    Holding."""

    def __init__(self, outbox: Outbox, separation_m: float, restarted: bool = False):
        super().__init__()
        self._holding = Holding(outbox, separation_m, restarted)

    def pause(self, snapshot: Snapshot, guided: Sequence[str]) -> None:
        """Something is wrong: these hold on, whoever stands."""
        self._holding.step(snapshot, guided)

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        self.detail = self._holding.why
        return Progress.DONE if self._holding.over(snapshot, guided) else Progress.UNDER_WAY


class Travel(Activity):
    """Movers go to their ``places`` (T_home_cam by vehicle), which ``where`` names; ``others``
    stand."""

    stage = MOVES

    def __init__(
        self,
        mission: Mission,
        outbox: Outbox,
        places: Mapping[str, np.ndarray],
        where: str,
        others: Sequence[str],
    ):
        super().__init__()
        self._convoy, self._others = Convoy(outbox, mission, places), others
        way = "their way" if len(places) > 1 else "its way"
        self._said = f"{' and '.join(places)} on {way} to {where}"

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        there = self._convoy.step(snapshot, self._others)
        self.detail = self._said + (f" ({self._convoy.said})" if self._convoy.said else "")
        return Progress.DONE if there else Progress.UNDER_WAY


class Return(Travel):
    """Movers go back to their places in the column."""

    stage = GOES_BACK


class Rise(Activity):
    """Who is far below its place, having followed something, goes straight up to its height before
    anybody goes back: nobody knows what stands on the slanting way. One after the other."""

    stage = GOES_BACK

    def __init__(
        self,
        mission: Mission,
        outbox: Outbox,
        places: Mapping[str, np.ndarray],
        vehicles: Sequence[str],
    ):
        super().__init__()
        self._mission, self._outbox = mission, outbox
        self._places, self._vehicles = dict(places), list(vehicles)
        self._journey: Optional[Journey] = None

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        """Raises MissionError where a vehicle does not get up."""
        if self._journey is not None:
            others = [n for n in self._vehicles if n != self._journey.name]
            if self._journey.step(snapshot, others):
                self._journey = None
        if self._journey is None:
            self._journey = next(filter(None, (self._way(snapshot, n) for n in self._places)), None)
        if self._journey is None:
            return Progress.DONE
        self.detail = f"{self._journey.name} goes up before it goes back"
        return Progress.UNDER_WAY

    def _way(self, snapshot: Snapshot, name: str) -> Optional[Journey]:
        T_home_cam, z_m = snapshot.vehicles[name].T_home_cam, float(self._places[name][2, 3])
        if z_m - T_home_cam[2, 3] < _RISES_M:
            return None
        above = level_camera(T_home_cam)
        above[2, 3] = z_m
        timeout_s = self._mission.settle.timeout_s
        return Journey(self._outbox, name, above, Keep.of(self._mission), timeout_s)


class BringHome(Activity):
    """The reference goes to ``T_home_cam``, home or its place at a station, and stays; nobody else
    moves before, unless one is where it must go: blown there, or put there by a pilot. Then
    ``travel`` comes first."""

    def __init__(
        self,
        mission: Mission,
        outbox: Outbox,
        others: Sequence[str],
        travel: Travel,
        T_home_cam: np.ndarray,
    ):
        super().__init__()
        self._name, self._others = mission.reference, others
        self._home = Journey(
            outbox, self._name, T_home_cam, Keep.of(mission), mission.settle.timeout_s
        )
        self._travel, self._makes_room = travel, False
        self.travelled: Optional[Travel] = None  # the others are on their way already

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        if self._makes_room and self._travel.step(snapshot, guided) is Progress.UNDER_WAY:
            self.detail = self._travel.detail
            return Progress.UNDER_WAY
        self._makes_room, self.detail = False, f"{self._name} goes home"
        try:
            there = self._home.step(snapshot, self._others)
        except MissionError:
            if self._home.planned:
                raise
            self._makes_room, self.travelled = True, self._travel
            self.detail = f"{self._name} goes home once there is room"
            return Progress.UNDER_WAY
        return Progress.DONE if there else Progress.UNDER_WAY
