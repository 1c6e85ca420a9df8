# SPDX-License-Identifier: Apache-2.0
"""What is flown in which order, and how the operator changes it."""

from dataclasses import dataclass, replace
from typing import Collection, List, Optional, Sequence, Set

from fcsv_geometry.missions.mission import Mission

_NO_STATIONS = "the mission has no stations"


@dataclass(frozen=True)
class Task:
    """A vehicle's place: that of a configuration, or (None) its place in the column. ``joins``: it
    moves at the same time as the task before. ``view``: at which of the mission's viewpoints;
    ``changes``: the column flies there."""

    vehicle: str
    index: Optional[int] = None
    joins: bool = False
    view: int = 0
    changes: bool = False


def tasks(
    mission: Mission,
    vehicles: Sequence[str],
    indices: Optional[Sequence[int]] = None,
    away: Collection[str] = (),
    at: Optional[int] = 0,
    gone: Collection[str] = (),
) -> List[Task]:
    """What is flown in order. A vehicle that has done its part goes back to its place in the column
    before others move and before all land, so that no vehicle comes down on another. ``away`` are
    out of the column already; who follows stays out, or all come back. The column is at viewpoint
    ``at`` (None: under way), changes over to each one's viewpoint, and ends at home; ``gone`` take
    no part."""
    found: List[Task] = []
    flying = [n for n in vehicles if n not in gone]
    away = [n for n in away if n not in gone]

    def change_over(view: int) -> List[Task]:
        back = _at_once([Task(n, view=at or 0) for n in away])
        return back + _at_once([Task(n, view=view, changes=True) for n in flying])

    for moment in mission.moments(indices):
        view = mission.configurations[moment[0]].view
        if view != at:
            found += change_over(view)
            away, at = (), view
        movers = [mission.mover(i, vehicles) for i in moment]
        found += _at_once([Task(n, view=view) for n in away if n not in movers])
        found += _at_once([Task(n, i, view=view) for n, i in zip(movers, moment)])
        away = movers
    if found and found[-1].index is not None and mission.follows(found[-1].index):
        if mission.lands_there(found[-1].index):
            return found
        away = flying
    if at != 0:
        return found + change_over(0)
    return found + _at_once([Task(n) for n in away])


def _at_once(moves: Sequence[Task]) -> List[Task]:
    return [replace(t, joins=k > 0) for k, t in enumerate(moves)]


def _without(left: Sequence[Task], vehicle: str) -> List[Task]:
    """The tasks of the others; each moment stays one."""
    kept: List[Task] = []
    orphaned = False  # the first of its moment was the vehicle's
    for task in left:
        if task.vehicle == vehicle:
            orphaned = orphaned if task.joins else True
            continue
        kept.append(replace(task, joins=task.joins and not orphaned))
        orphaned = False
    return kept


class TaskList:
    """The tasks that are left, the running ones first. Changes answer "" or why they cannot be
    made. ``away``: who is out of the column; ``at``: the viewpoint where that is, None where it is
    under way."""

    def __init__(
        self,
        mission: Mission,
        vehicles: Sequence[str],
        left: Sequence[Task],
        flown: Sequence[int] = (),
        away: Collection[str] = (),
        at: Optional[int] = 0,
    ):
        self._mission, self._vehicles = mission, list(vehicles)
        self.left = list(left)
        self.flown = list(flown)  # configurations that are behind, recorded or left out
        self.away, self.at = list(away), at
        self._gone: Set[str] = set()  # take no part any more
        self._last = next((t.index for t in self.left if t.index is not None), 0)

    @property
    def moment(self) -> List[Task]:
        """The running tasks: they are flown at the same time."""
        first = self.left[:1]
        for task in self.left[1:]:
            if not task.joins:
                break
            first.append(task)
        return first

    @property
    def index(self) -> int:
        """Gives the index of the running configuration, also on the way back from the last."""
        running = self.running
        self._last = self._last if running is None else running
        return self._last

    @property
    def running(self) -> Optional[int]:
        """Index of the (first) configuration that is flown, or that comes next; None on the last
        way back."""
        return next((t.index for t in self.left if t.index is not None), None)

    @property
    def coming(self) -> List[int]:
        """Indices of the configurations that are flown, or that come next; none on the last way
        back."""
        indices = self._indices()
        return self._mission.moments(indices)[0] if indices else []

    def depart(self) -> None:
        """The column leaves for another viewpoint."""
        self.at = None

    def done(self) -> None:
        """The running tasks are done."""
        moment = self.moment
        self.left = self.left[len(moment) :]
        if moment[0].changes:
            self.at = moment[0].view
        for task in moment:
            self.away = [n for n in self.away if n != task.vehicle]
            if task.index is not None:
                self._last = task.index
                self.flown.append(task.index)
                self.away.append(task.vehicle)

    def go_back(self) -> None:
        """Nothing more is flown but the way back."""
        index = self.moment[0].index
        returns = index is not None and self._mission.configurations[index].returns
        self.left = self._tasks([], self._vehicles if returns else self._out())

    @property
    def working(self) -> List[str]:
        """Vehicles that have a configuration left."""
        return [t.vehicle for t in self.left if t.index is not None]

    def leave(self, vehicle: str) -> List[int]:
        """A vehicle takes no part any more; which configurations are left out with it."""
        self._gone.add(vehicle)
        away = [n for n in self._out() if n != vehicle]
        lost = [t.index for t in self.left if t.index is not None and t.vehicle == vehicle]
        self.flown += lost
        self.away = [n for n in self.away if n != vehicle]
        if any(t.index is not None for t in self.left):
            self.left = self._tasks([i for i in self._indices() if i not in lost], away)
        else:
            self.left = _without(self.left, vehicle)
        return lost

    def skip(self) -> str:
        """Leave the running configurations out."""
        if self.running is None:
            return "no configuration is left that could be skipped"
        first = self.coming
        self._order(self._others())
        self.flown += first
        return ""

    def skip_station(self) -> str:
        """Leave out what is left at the running station, at all its headings."""
        if not self._mission.stations:
            return _NO_STATIONS
        if self.running is None:
            return "no station is left that could be skipped"
        left = self._indices()
        here = self._here(left)
        self._order([i for i in left if i not in here])
        self.flown += here
        return ""

    def station_again(self) -> str:
        """Fly the running station from its beginning, at all its headings; on the last way back the
        one before."""
        if not self._mission.stations:
            return _NO_STATIONS
        left = self._indices()
        possible = [i for i in range(len(self._mission.configurations)) if self._may_fly(i)]
        here = [i for i in self._here(possible) if i in self.flown or i in left]
        if not here:
            return "no station was flown before"
        self.flown = [i for i in self.flown if i not in here]
        self._order([*here, *(i for i in left if i not in here)])
        return ""

    def _here(self, indices: Sequence[int]) -> List[int]:
        """Those of the running station, or of the last one."""
        station = self._mission.viewpoint(self.index).station
        return [i for i in indices if self._mission.viewpoint(i).station == station]

    def _may_fly(self, index: int) -> bool:
        return self._mission.mover(index, self._vehicles) not in self._gone

    def put_off(self) -> str:
        """Fly the next configurations first, the running ones after all others."""
        first, others = self.coming, self._others()
        if all(self._mission.follows(i) for i in others):
            return "no other configuration is left that could come first"
        self._order([*others, *first])
        return ""

    def before(self) -> str:
        """Fly the configurations before again, then the running ones."""
        possible = [i for i in self.flown if self._may_fly(i)]
        if not possible:
            return "no configuration was flown before"
        again = [i for i in self._mission.moment_of(possible[-1]) if i in possible]
        self.flown = [i for i in self.flown if i not in again]
        self._order([*again, *self._indices()])
        return ""

    def again(self) -> str:
        """Fly the running configurations from their start; on the last way back those before."""
        return self.before() if self.running is None else ""

    def _out(self) -> List[str]:
        """Who is out of the column, or on its way."""
        moving = [t.vehicle for t in self.moment if not t.changes]
        return list(dict.fromkeys([*self.away, *moving]))

    def _indices(self) -> List[int]:
        return [t.index for t in self.left if t.index is not None]

    def _others(self) -> List[int]:
        return self._indices()[len(self.coming) :]

    def _order(self, indices: Sequence[int]) -> None:
        self.left = self._tasks(indices, self._out())

    def _tasks(self, indices: Sequence[int], away: Collection[str]) -> List[Task]:
        return tasks(self._mission, self._vehicles, indices, away, self.at, self._gone)
