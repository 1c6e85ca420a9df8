# SPDX-License-Identifier: Apache-2.0
"""The list of configurations, one after the other or at once: go there, settle, record, go on; at
the end back to the column."""

from typing import Collection, Dict, List, Optional, Sequence, Union

import numpy as np

from fcsv_control.mission.activities.holding import Holding
from fcsv_control.mission.activities.looking_round import LookingRound
from fcsv_control.mission.activities.stages import GOES_BACK, MOVES, TURNS
from fcsv_control.mission.activities.standing import CaptureWindow, Progress, Standing
from fcsv_control.mission.activities.sweeping import Sweeping
from fcsv_control.mission.memory import RememberedList
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.plans.task_list import Task, TaskList, tasks
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.convoy import Convoy
from fcsv_control.mission.ways.destinations import Destinations
from fcsv_control.mission.ways.journey import Journey
from fcsv_control.mission.ways.places import level_camera
from fcsv_control.mission.ways.routes import Keep
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.streams.stream import Since
from fcsv_geometry.vehicles.modes import Mode

_LONGEST = 4  # times the wanted recording: what one attempt records at most


class FlightList:
    """Flies a mission's configurations in GUIDED. ``step`` raises MissionError where it cannot go
    on.

    ``parked`` is each vehicle's T_home_cam in the column, level.
    """

    def __init__(
        self, mission: Mission, outbox: Outbox, parked: Dict[str, np.ndarray], task_list: TaskList
    ):
        self._mission = mission
        self._vehicles = list(parked)
        self._outbox = outbox
        self._parked, self._goals = parked, Destinations(mission, parked)
        self._list = task_list
        self._attempts: Dict[int, int] = {}
        self._round = LookingRound(mission, outbox)
        self._home = self._way_home()
        self._reference_is_home = self._makes_room = False
        self._convoy: Optional[Convoy] = None
        self._standing: Optional[Union[Standing, Sweeping]] = None
        self._holding: Optional[Holding] = None
        self._task = Since()
        self.going_back = ""  # why nothing more is flown but the way back
        self.detail = ""
        self.notes: List[str] = []  # configurations that were left out, and why

    @classmethod
    def begin(
        cls,
        mission: Mission,
        vehicles: Sequence[str],
        outbox: Outbox,
        snapshot: Snapshot,
        indices=None,
    ):
        """Begins from where the vehicles stand now; ``indices`` of the configurations, None:
        all."""
        parked = {n: level_camera(snapshot.vehicles[n].T_home_cam) for n in vehicles}
        return cls(
            mission, outbox, parked, TaskList(mission, vehicles, tasks(mission, vehicles, indices))
        )

    @classmethod
    def remembered(
        cls, mission: Mission, vehicles: Sequence[str], outbox: Outbox, memory: RememberedList
    ):
        """Where a mission that was restarted stood; the first ``step`` waits until everybody
        holds."""
        parked = {n: np.array(memory.parked[n]).reshape(4, 4) for n in vehicles}
        again = cls(
            mission,
            outbox,
            parked,
            TaskList(mission, vehicles, memory.left, memory.flown, memory.away),
        )
        again.notes, again.going_back = list(memory.notes), memory.going_back
        again._holding = Holding(outbox, mission.min_separation_m, restarted=True)
        again._round = LookingRound(mission, outbox, memory.turned)
        return again

    @property
    def memory(self) -> RememberedList:
        """What a restart needs to go on."""
        parked = {n: T.ravel().tolist() for n, T in self._parked.items()}
        return RememberedList(
            list(self._list.left),
            list(self._list.flown),
            parked,
            list(self.notes),
            self.going_back,
            list(self._list.away),
            list(self._round.turned),
        )

    @property
    def finished(self) -> bool:
        return not self._list.left

    @property
    def stage(self) -> str:
        """What is done now, as stages.py names it."""
        if self.finished:
            return ""
        if self._standing is not None or self._round.running:
            return TURNS if self._standing is None else self._standing.stage
        return GOES_BACK if self._list.moment[0].index is None else MOVES

    @property
    def index(self) -> int:
        """Gives the index of the (first) running configuration; the last one's on the way back."""
        return self._list.index

    @property
    def share(self) -> float:
        """0..1 of the configurations that are behind."""
        behind = len(set(self._list.flown))
        return behind / max(
            behind + len({t.index for t in self._list.left if t.index is not None}), 1
        )

    @property
    def so_far(self) -> List[CaptureWindow]:
        """Gives the windows of sweeps under way: what is recorded already."""
        return self._standing.so_far if isinstance(self._standing, Sweeping) else []

    # ---- what interrupts it ----------------------------------------------------------------------

    def pause(self, snapshot: Snapshot, taken: Collection[str] = ()) -> None:
        """Something is wrong: whoever is in GUIDED and not taken by a pilot holds where it is, but
        never beneath a vehicle that comes down; a running recording does not count."""
        if self._holding is None:
            self._begin(snapshot)
        self._holding.step(snapshot, self._guided(snapshot, taken))

    def _guided(self, snapshot: Snapshot, taken: Collection[str]) -> List[str]:
        return [
            n for n in self._vehicles if snapshot.vehicles[n].mode == Mode.GUIDED and n not in taken
        ]

    def resumed(self) -> None:
        """The operator lets it go on: the running task has all its time again."""
        self._task.end()

    def go_back(self, snapshot: Snapshot, why: str) -> None:
        """Fly nothing more: who is away goes back to the column."""
        self.going_back = why
        self._task.end()
        self._begin(snapshot)
        self._list.go_back()

    def change(self, snapshot: Snapshot, operation: str) -> str:
        """The operator's "skip", "repeat", "next" or "previous"; "" when done, else why not."""
        # of a turn in the column
        if operation == "skip" and self._convoy is None and self._round.leave_out():
            self._begin(snapshot)
            return ""
        titles = " and ".join(self._mission.configurations[i].title for i in self._list.coming)
        change = {
            "skip": self._list.skip,
            "repeat": self._list.again,
            "next": self._list.put_off,
            "previous": self._list.before,
        }[operation]
        refusal = change()
        if not refusal:
            self._begin(snapshot)
            self._attempts = {}
            self._task.end()
            if operation == "skip":
                self.notes.append(f"{titles} left out by the operator")
        return refusal

    @property
    def working(self) -> List[str]:
        """Vehicles that have a configuration left to fly."""
        return self._list.working

    def leave(self, snapshot: Snapshot, name: str) -> None:
        """A vehicle is down and takes no part any more; the others begin their running task
        again."""
        self._begin(snapshot)
        lost = self._list.leave(name)
        self._vehicles = [n for n in self._vehicles if n != name]
        self._attempts = {}
        self._task.end()
        self.notes += [
            f"{self._mission.configurations[i].title} left out, {name} is down" for i in lost
        ]

    # ---- its steps -------------------------------------------------------------------------------

    def step(self, snapshot: Snapshot, taken: Collection[str] = ()) -> List[CaptureWindow]:
        """Advance the running tasks; recordings that count come back once."""
        if self.going_back:
            self._leave_to_pilots(taken)
        if self.finished:
            return []
        moment = self._list.moment
        self._watch_time(snapshot, moment)
        if self._holding is not None and self._hold(snapshot, taken):
            return []
        if not self.going_back and not self._bring_reference_home(snapshot, moment):
            return []
        if not self._look_round(snapshot):
            return []
        if self._standing is not None:
            return self._stand(snapshot, moment)
        if self._round.running or self._travel(snapshot, moment):
            if moment[0].index is None:
                self._next()
            elif self._look_round(snapshot, moment):
                self._standing = self._stand_at(moment)
        return []

    def _leave_to_pilots(self, taken: Collection[str]) -> None:
        """Whom pilots have they land."""
        for name in {t.vehicle for t in self._list.left} & set(taken):
            self._list.leave(name)
            self._convoy = None
            self._task.end()

    def _watch_time(self, snapshot: Snapshot, moment: Sequence[Task]) -> None:
        """Raises MissionError where a task does not end: short pauses again and again pass every
        other limit."""
        task_s = self._task.lasts_s(snapshot.now_s)
        most_s = self._mission.limits.task_s
        if moment[0].index is not None:
            record_s = self._mission.configurations[moment[0].index].record_s
            most_s += _LONGEST * self._mission.settle.attempts * record_s
            most_s += self._round.most_s(len(self._vehicles) + len(moment))
        if task_s > most_s:
            who, where = self._goals.in_words(moment)
            verb = "are" if len(moment) > 1 else "is"
            raise MissionError(f"{who} {verb} not done with {where} after {most_s:g} s: landing")

    def _hold(self, snapshot: Snapshot, taken: Collection[str]) -> bool:
        """Whether all still hold."""
        self.detail = self._holding.why
        if self._holding.over(snapshot, self._guided(snapshot, taken)):
            self._holding = None
        return self._holding is not None

    def _begin(self, snapshot: Snapshot) -> None:
        """The running tasks from their start, and the reference home again, once all stand."""
        if self._standing is not None:
            self._standing.stop(snapshot)
        self._holding = self._holding or Holding(self._outbox, self._mission.min_separation_m)
        self._convoy, self._standing = None, None
        self._round.begin_again()
        self._home = self._way_home()
        self._reference_is_home = self._makes_room = False

    def _next(self) -> None:
        self._list.done()
        self._convoy = self._standing = None
        self._task.end()
        if not self.finished:
            self.detail = f"next: {self._goals.in_words(self._list.moment)[1]}"

    def _way_home(self) -> Journey:
        m = self._mission
        return Journey(
            self._outbox, m.reference, T_HOME_CAM_AT_HOME, Keep.of(m), m.settle.timeout_s
        )

    def _others(self, names: Collection[str]) -> List[str]:
        return [n for n in self._vehicles if n not in names]

    def _bring_reference_home(self, snapshot: Snapshot, moment: Sequence[Task]) -> bool:
        """It goes there once and stays; nobody else moves before, unless one is where it must go:
        blown there, or put there by a pilot. Then the others go to their places first."""
        if self._reference_is_home or (self._makes_room and not self._travel(snapshot, moment)):
            return self._reference_is_home
        self._makes_room, name = False, self._mission.reference
        self.detail = f"{name} goes home"
        try:
            self._reference_is_home = self._home.step(snapshot, self._others([name]))
        except MissionError:
            if self._home.planned:
                raise
            self._makes_room, self.detail = True, f"{name} goes home once there is room"
        return self._reference_is_home

    def _travel(self, snapshot: Snapshot, moment: Sequence[Task]) -> bool:
        places = self._goals.places(moment)
        if self._convoy is None:
            self._convoy = Convoy(self._outbox, self._mission, places)
        there = self._convoy.step(snapshot, self._others(places))
        said = f" ({self._convoy.said})" if self._convoy.said else ""
        self.detail = "{} on their way to {}{}".format(*self._goals.in_words(moment), said)
        self.detail = (
            self.detail
            if len(moment) > 1
            else self.detail.replace(" on their way", " on its way", 1)
        )
        return there

    def _look_round(self, snapshot: Snapshot, moment: Optional[Sequence[Task]] = None) -> bool:
        """Whether nobody has to turn (any more): in the column, which nobody has left yet, or at
        these places."""
        if moment is None:
            spread = (
                self.going_back or self._list.flown or self._list.away or self._convoy is not None
            )
            done = bool(spread) or self._round.in_column(snapshot, self._parked, self._vehicles)
        else:
            where = self._goals.in_words(moment)[1]
            done = self._round.at_places(snapshot, self._goals.places(moment), where)
        self.detail = self.detail if done else self._round.detail
        self.notes += self._round.take_notes()
        return done

    def _stand_at(self, moment: Sequence[Task]) -> Union[Standing, Sweeping]:
        """The next attempt at the running configurations."""
        index, movers = moment[0].index, {t.vehicle: t.index for t in moment}
        self._attempts[index] = self._attempts.get(index, 0) + 1
        last = self._attempts[index] >= self._mission.settle.attempts
        if self._mission.configurations[index].sweep is not None:
            return Sweeping(self._mission, movers, self._outbox, last)
        places = self._goals.places(moment)
        places[self._mission.reference] = T_HOME_CAM_AT_HOME
        return Standing(self._mission, movers, places, self._outbox, last)

    def _stand(self, snapshot: Snapshot, moment: Sequence[Task]) -> List[CaptureWindow]:
        """Settle and record, or sweep; what was disturbed is taken again, what never becomes calm
        is left out."""
        progress, windows = self._standing.step(snapshot)
        self.detail = self._standing.detail
        # from its beginning
        if progress is Progress.AGAIN and isinstance(self._standing, Sweeping):
            self._convoy, self._standing = None, None
        elif progress is Progress.AGAIN:
            self._standing = self._stand_at(moment)
        elif progress is Progress.GIVEN_UP:
            self.notes.append(f"{self._goals.in_words(moment)[1]} left out, {self._standing.why}")
            self._next()
        elif progress is Progress.DONE:
            self._next()
        return windows

    def require_some(self, captures: int) -> None:
        """Raises MissionError where the whole list left nothing."""
        if not captures:
            raise MissionError("no configuration could be recorded: " + "; ".join(self.notes))
