# SPDX-License-Identifier: Apache-2.0
"""The list of configurations, one after the other or at once: go there, settle, record, go on; at
the end back to the column."""

from typing import Any, Callable, Collection, Dict, List, Mapping, Optional, Sequence, Tuple, Type

import numpy as np

from fcsv_control.mission.activities.activity import Activity, CaptureWindow, Progress
from fcsv_control.mission.activities.calibrating import Calibrating
from fcsv_control.mission.activities.changing_over import ChangeOver
from fcsv_control.mission.activities.following import Following
from fcsv_control.mission.activities.looking_round import (
    LookRoundAtPlaces,
    LookRoundInColumn,
    Turned,
    turn_most_s,
)
from fcsv_control.mission.activities.moving import BringHome, Hold, Return, Rise, Travel
from fcsv_control.mission.activities.stages import GOES_BACK, MOVES
from fcsv_control.mission.activities.standing import Standing
from fcsv_control.mission.activities.sweeping import Sweeping
from fcsv_control.mission.memory import RememberedList
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.plans.task_list import Task, TaskList, tasks
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.destinations import Destinations
from fcsv_control.mission.ways.places import FollowPlace, level_camera
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME, in_home, reference_place
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.stations import HOME_VIEW
from fcsv_geometry.streams.stream import Since
from fcsv_geometry.vehicles.modes import Mode

# what follows these begins in the same step; a recording and the next task begin at the next one
_AT_ONCE = (Hold, BringHome, Calibrating, LookRoundInColumn, Rise, Travel)
_LONGEST = 4  # times the wanted recording: what one attempt records at most


class FlightList:
    """Flies a mission's configurations in GUIDED, one activity at a time; ``_follows``
    says which comes next. ``step`` raises MissionError where it cannot go on.

    ``parked`` is each vehicle's T_home_cam in the column, level; ``turned``: who has looked round
    where.
    """

    def __init__(
        self,
        mission: Mission,
        outbox: Outbox,
        parked: Dict[str, np.ndarray],
        task_list: TaskList,
        turned: Sequence[Turned] = (),
        calibrated: str = HOME_VIEW.station,
        restarted: bool = False,
    ):
        self._mission = mission
        self._vehicles = list(parked)
        self._outbox = outbox
        self._parked, self._goals = parked, Destinations(mission, parked)
        self._list, self._turned = task_list, list(turned)
        self._calibrated_at = calibrated  # name of the station; "": the column has left it
        self._attempts: Dict[int, int] = {}
        self._task = Since()
        self._follow: Optional[Following] = None  # once it has begun, whatever interrupts it
        self.going_back = ""  # why nothing more is flown but the way back
        self.detail = ""
        self.notes: List[str] = []  # configurations that were left out, and why
        self._follows: Dict[Type[Activity], Callable[[Any], Activity]] = {
            Hold: lambda _: self._opening(),
            BringHome: lambda home: home.travelled or self._departure(),
            Calibrating: lambda _: self._calibrated(),
            LookRoundInColumn: lambda _: self._way(),
            Rise: lambda _: self._return(),
            Travel: lambda _: self._turns(),
            LookRoundAtPlaces: lambda _: self._attempt(),
            Standing: lambda _: self._next_task(),
            Sweeping: lambda _: self._next_task(),
            Following: lambda _: self._next_task(),
            Return: lambda _: self._next_task(),
            ChangeOver: lambda _: self._next_task(),
        }
        self._activity = self._holding(restarted) if restarted else self._opening()

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
            TaskList(mission, vehicles, memory.left, memory.flown, memory.away, memory.at),
            memory.turned,
            memory.calibrated,
            restarted=True,
        )
        again.notes, again.going_back = list(memory.notes), memory.going_back
        again._follow = again._begun_following({}) if memory.follows else None
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
            list(self._turned),
            self._list.at,
            self._calibrated_at,
            self.follows,
        )

    @property
    def follows(self) -> bool:
        """Whether vehicles follow, away from their places."""
        return self._follow is not None

    @property
    def lands_there(self) -> bool:
        """Whether vehicles follow and nobody goes back any more."""
        return self.follows and self._mission.lands_there(self._list.index)

    @property
    def finished(self) -> bool:
        return not self._list.left

    @property
    def stage(self) -> str:
        """What is done now, as stages.py names it."""
        if self.finished:
            return ""
        return self._activity.stage or (GOES_BACK if self._goes_back else MOVES)

    @property
    def _goes_back(self) -> bool:
        """Whether the running tasks lead back to the column, or change over to another place."""
        return self._list.moment[0].index is None

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
        return self._activity.so_far

    # ---- what interrupts it ----------------------------------------------------------------------

    def pause(self, snapshot: Snapshot, taken: Collection[str] = ()) -> None:
        """Something is wrong: whoever is in GUIDED and not taken by a pilot holds where it is, but
        never beneath a vehicle that comes down; a running recording does not count."""
        guided = self._guided(snapshot, taken)
        self._hold(snapshot).pause(snapshot, guided)
        if self._follow is not None:
            self._follow.keep(guided)

    def _hold(self, snapshot: Snapshot) -> Hold:
        """All hold; then the running tasks begin from their start, with the reference at home."""
        if not isinstance(self._activity, Hold):
            self._activity.stop(snapshot)
            self._activity = self._holding()
        return self._activity

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
        self._hold(snapshot)
        self._follow = None
        self._list.go_back()

    def change(self, snapshot: Snapshot, operation: str) -> str:
        """The operator's "skip", "repeat", "next" or "previous", or one of these of a station; ""
        when done, else why not."""
        if self.follows and operation != "skip":
            then = "land where they are" if self.lands_there else "go back to the column"
            return f"vehicles follow; 'skip' ends it, and all {then}"
        if operation == "skip" and (self._follow or self._activity).skip():
            if isinstance(self._activity, Calibrating):
                self.notes += self._activity.pop_notes()
                self._calibrated_at = self._mission.viewpoints[self._list.moment[0].view].station
            self._hold(snapshot)
            return ""
        left = self._list.left
        change = {
            "skip": self._list.skip,
            "repeat": self._list.again,
            "next": self._list.put_off,
            "previous": self._list.before,
            "skip_station": self._list.skip_station,
            "repeat_station": self._list.station_again,
        }[operation]
        refusal = change()
        if not refusal:
            self._hold(snapshot)
            self._attempts = {}
            self._task.end()
            if operation in ("skip", "skip_station"):
                stay = {t.index for t in self._list.left}
                gone = [t.index for t in left if t.index is not None and t.index not in stay]
                titles = " and ".join(self._mission.title(i) for i in gone)
                self.notes.append(f"{titles} left out by the operator")
        return refusal

    def follow(self, vehicle: str, place: FollowPlace) -> str:
        """A vehicle is asked to a place; "" or why it does not go."""
        if self._follow is None or self.finished:
            return f"no vehicle follows: {self.detail}"
        if vehicle not in self._vehicles:
            return f"{vehicle} takes no part any more"
        self._follow.ask(vehicle, place)
        return ""

    @property
    def working(self) -> List[str]:
        """Vehicles that have a configuration left to fly."""
        return self._list.working

    def leave(self, snapshot: Snapshot, name: str) -> None:
        """A vehicle is down and takes no part any more; the others begin their running task
        again."""
        self._hold(snapshot)
        lost = self._list.leave(name)
        self._vehicles = [n for n in self._vehicles if n != name]
        self._attempts = {}
        self._task.end()
        self.notes += [f"{self._mission.title(i)} left out, {name} is down" for i in lost]

    # ---- calibrating in flight -------------------------------------------------------------------

    def pop_wants_calibration(self) -> bool:
        """Whether the service that calibrates the column is to be called now; told once."""
        activity = self._activity
        if not isinstance(activity, Calibrating) or not activity.wants:
            return False
        activity.wants = False
        return True

    def calibration_answered(self, done: bool, text: str) -> None:
        """How the service ended; one that nobody waits for any more is passed over."""
        if isinstance(self._activity, Calibrating):
            self._activity.answered(done, text)

    def _calibrated(self) -> Activity:
        """It is over, done or left out: the running task has all its time again."""
        self._calibrated_at = self._mission.viewpoints[self._list.moment[0].view].station
        self._task.end()
        return self._departure()

    def _is_to_calibrate(self, view: int) -> bool:
        """Whether the whole column has come to a station at which it calibrates."""
        station = self._mission.viewpoints[view].station
        return (
            self._list.at == view
            and set(self._vehicles) == set(self._parked)
            and self._calibrated_at != station
            and self._mission.calibrates(view)
        )

    # ---- its steps -------------------------------------------------------------------------------

    def step(self, snapshot: Snapshot, taken: Collection[str] = ()) -> List[CaptureWindow]:
        """Advance the running tasks; recordings that count come back once."""
        if self.going_back:
            self._leave_to_pilots(taken)
        if self.finished:
            return []
        self._watch_time(snapshot, self._list.moment)
        guided = self._guided(snapshot, taken)
        while True:
            activity = self._activity
            progress = activity.step(snapshot, guided)
            self.detail = activity.detail or self.detail
            self.notes += activity.pop_notes()
            if progress is Progress.UNDER_WAY:
                return []
            self._activity = self._following(activity, progress)
            if type(activity) not in _AT_ONCE:
                return activity.windows

    def _leave_to_pilots(self, taken: Collection[str]) -> None:
        """Whom pilots have they land; the others plan their way anew."""
        for name in {t.vehicle for t in self._list.left} & set(taken):
            self._list.leave(name)
            self._task.end()
            if isinstance(self._activity, (Rise, Travel, ChangeOver)) and not self.finished:
                self._activity = self._way()

    def _watch_time(self, snapshot: Snapshot, moment: Sequence[Task]) -> None:
        """Raises MissionError where a task does not end: short pauses again and again pass every
        other limit."""
        task_s = self._task.lasts_s(snapshot.now_s)
        most_s = self._mission.limits.task_s
        if not self._goes_back:
            stands_s = self._mission.configurations[moment[0].index].stands_s
            most_s += _LONGEST * self._mission.settle.attempts * stands_s
            most_s += turn_most_s(self._mission) * (len(self._vehicles) + len(moment))
        if task_s > most_s:
            who, where = self._goals.in_words(moment)
            verb = "are" if len(moment) > 1 and not moment[0].changes else "is"
            raise MissionError(f"{who} {verb} not done with {where} after {most_s:g} s: landing")

    # ---- the activities, and what follows each ---------------------------------------------------

    def _following(self, activity: Activity, progress: Progress) -> Activity:
        """What follows an activity that is over; a sweep that was disturbed is flown from its
        beginning."""
        if isinstance(activity, ChangeOver) and progress is Progress.AGAIN:
            return self._holding()
        if progress is Progress.AGAIN:
            return self._way() if isinstance(activity, Sweeping) else self._attempt()
        return self._follows[type(activity)](activity)

    def _holding(self, restarted: bool = False) -> Hold:
        return Hold(self._outbox, self._mission.min_separation_m, restarted)

    def _opening(self) -> Activity:
        """The reference home, where it has to be before others move; who follows goes on from where
        it is."""
        if self._follow is not None:
            return self._follow
        moment = self._list.moment
        if self.going_back or moment[0].changes:
            return self._way()
        others = self._others([self._mission.reference])
        T_home_cam = reference_place(self._mission, moment[0].view)
        return BringHome(self._mission, self._outbox, others, self._way(), T_home_cam)

    def _departure(self) -> Activity:
        """The column calibrates where it has come to a station; all look round in it first, where
        nobody has left it yet."""
        first = self._list.moment[0]
        if self.going_back or self._list.away or first.changes:
            return self._way()
        if self._is_to_calibrate(first.view):
            front_first = {n: self._figure[n] for n in self._parked}
            return Calibrating(self._mission, self._outbox, front_first, first.view)
        if self._list.flown:
            return self._way()
        parked = {n: in_home(self._mission, first.view, self._figure[n]) for n in self._vehicles}
        return LookRoundInColumn(self._mission, self._outbox, parked, self._turned)

    @property
    def _figure(self) -> Dict[str, np.ndarray]:
        """T_view_cam of each vehicle in the column, the one that leads first."""
        reference = self._mission.reference
        figure = {n: self._parked[n] for n in self._vehicles}
        if reference in figure:
            figure = {
                reference: T_HOME_CAM_AT_HOME,
                **{n: figure[n] for n in self._others([reference])},
            }
        return figure

    def _way(self) -> Activity:
        """The running tasks' movers to their places, or the column to another viewpoint."""
        first = self._list.moment[0]
        if first.changes:
            self._list.depart()
            if self._mission.viewpoints[first.view].station != self._calibrated_at:
                self._calibrated_at = ""
            flying = {t.vehicle for t in self._list.moment}
            figure = {n: T for n, T in self._figure.items() if n in flying}
            return ChangeOver(self._mission, self._outbox, figure, first.view)
        places, where = self._places()
        if self._goes_back:
            return Rise(self._mission, self._outbox, places, self._vehicles)
        return Travel(self._mission, self._outbox, places, where, self._others(places))

    def _return(self) -> Activity:
        places, where = self._places()
        return Return(self._mission, self._outbox, places, where, self._others(places))

    def _turns(self) -> Activity:
        places, where = self._places()
        return LookRoundAtPlaces(self._mission, self._outbox, places, f"at {where}", self._turned)

    def _places(self) -> Tuple[Dict[str, np.ndarray], str]:
        """T_home_cam of the running tasks by mover, and what they are in words."""
        moment = self._list.moment
        return self._goals.places(moment), self._goals.in_words(moment)[1]

    def _attempt(self) -> Activity:
        """The next one at the running configurations."""
        moment = self._list.moment
        index, movers = moment[0].index, {t.vehicle: t.index for t in moment}
        if self._mission.follows(index):
            reference, view = self._mission.reference, moment[0].view
            there = {**self._goals.places(moment), reference: reference_place(self._mission, view)}
            self._follow = self._begun_following(there)
            return self._follow
        self._attempts[index] = self._attempts.get(index, 0) + 1
        last = self._attempts[index] >= self._mission.settle.attempts
        if self._mission.configurations[index].sweep is not None:
            return Sweeping(self._mission, movers, self._outbox, last)
        places = self._goals.places(moment)
        places[self._mission.reference] = reference_place(self._mission, moment[0].view)
        return Standing(self._mission, movers, places, self._outbox, last)

    def _begun_following(self, places: Mapping[str, np.ndarray]) -> Following:
        follow_s = self._mission.configurations[self._list.index].stands_s
        return Following(self._mission, self._outbox, follow_s, places)

    def _next_task(self) -> Activity:
        """The running tasks are done, or left out; the activity stays where nothing is left."""
        if self.follows and not self.lands_there:
            self._follow = None
        self._list.done()
        self._task.end()
        if self.finished:
            return self._activity
        self.detail = f"next: {self._places()[1]}"
        return self._departure()

    def _others(self, names: Collection[str]) -> List[str]:
        return [n for n in self._vehicles if n not in names]

    def require_some(self, captures: int) -> None:
        """Raises MissionError where all that was to be recorded left nothing."""
        if not captures and not all(self._mission.follows(i) for i in self._list.flown):
            raise MissionError("no configuration could be recorded: " + "; ".join(self.notes))
