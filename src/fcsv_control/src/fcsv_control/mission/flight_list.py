# SPDX-License-Identifier: Apache-2.0
"""The list of configurations, one after the other: go there, settle, record, go on; at the end back to the column."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.mission import clearing
from fcsv_control.mission.journey import Journey, go_to
from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.places import T_HOME_CAM_AT_HOME, camera_place, level_camera
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.standing import CaptureWindow, Progress, Standing
from fcsv_geometry.errors import MissionError
from fcsv_geometry.mission import Mission


@dataclass(frozen=True)
class Task:
    """A vehicle's place: that of a configuration, or (None) where it was parked when the list began."""

    vehicle: str
    index: Optional[int]


def tasks(mission: Mission, vehicles: Sequence[str]) -> List[Task]:
    """What is flown in order. A vehicle that has done its part goes back to its place in the column before another
    moves and before all land, so that no vehicle comes down on another."""
    found: List[Task] = []
    for i in range(len(mission.configurations)):
        mover = mission.mover(i, vehicles)
        if found and found[-1].vehicle != mover:
            found.append(Task(found[-1].vehicle, None))
        found.append(Task(mover, i))
    return [*found, Task(found[-1].vehicle, None)]


class FlightList:
    """Flies a mission's configurations in GUIDED. ``step`` raises MissionError where it cannot go on."""

    def __init__(self, mission: Mission, vehicles: Sequence[str], outbox: Outbox, snapshot: Snapshot):
        self._mission = mission
        self._vehicles = list(vehicles)
        self._outbox = outbox
        self._tasks = tasks(mission, vehicles)
        self._parked = {n: level_camera(snapshot.vehicles[n].T_home_cam) for n in vehicles}
        self._attempts: Dict[int, int] = {}
        self._home = self._journey(mission.reference, T_HOME_CAM_AT_HOME)
        self._reference_is_home = False
        self._journey_now: Optional[Journey] = None
        self._standing: Optional[Standing] = None
        self._paused = False
        self._dodged: Dict[str, Order] = {}
        self.detail = ""
        self.notes: List[str] = []  # configurations that were left out, and why

    @property
    def finished(self) -> bool:
        return not self._tasks

    @property
    def index(self) -> int:
        """Of the running configuration; the last one's on the way back."""
        return next((t.index for t in self._tasks if t.index is not None), len(self._mission.configurations) - 1)

    def pause(self, snapshot: Snapshot) -> None:
        """Something is wrong: whoever is in GUIDED holds where it is, but never beneath a vehicle that comes down; a
        running recording does not count."""
        if not self._paused:
            self._paused = True
            self._dodged = {}
            if self._standing is not None:
                self._standing.stop(snapshot)
            for name in self._in_guided(snapshot):
                if not self._dodge(snapshot, name):
                    self._outbox.order(snapshot.now_s, name, "HOLD")
            self._begin()
            return
        for name in self._in_guided(snapshot):
            self._dodge(snapshot, name)

    def _in_guided(self, snapshot: Snapshot) -> List[str]:
        return [n for n in self._vehicles if snapshot.vehicles[n].mode == "GUIDED"]

    def _dodge(self, snapshot: Snapshot, name: str) -> bool:
        """Whether a vehicle comes down on this one: then it is sent aside, again where it did not obey."""
        clear_m = clearing.clearance_m(self._mission.min_separation_m)
        upper = clearing.coming_down_on(snapshot, name, clear_m)
        if upper is None:
            return False
        order = self._dodged.get(name)
        if order is None or order.failed:
            place = clearing.aside(snapshot, name, upper, clear_m)
            self._dodged[name] = go_to(self._outbox, snapshot, name, place)
        return True

    def step(self, snapshot: Snapshot) -> Optional[CaptureWindow]:
        """Advance the running task; a recording that counts comes back once."""
        self._paused = False
        if self.finished or not self._bring_reference_home(snapshot):
            return None
        task = self._tasks[0]
        if self._standing is not None:
            return self._stand(snapshot, task)
        if self._travel(snapshot, task):
            if task.index is None:
                self._next()
            else:
                self._standing = self._stand_at(task)
        return None

    # ---- parts of one task ---------------------------------------------------------------------------------

    def _begin(self) -> None:
        """The running task from its start, and the reference home again."""
        self._journey_now, self._standing = None, None
        self._home = self._journey(self._mission.reference, T_HOME_CAM_AT_HOME)
        self._reference_is_home = False

    def _next(self) -> None:
        self._tasks.pop(0)
        self._journey_now, self._standing = None, None

    def _journey(self, name: str, T_home_cam: np.ndarray) -> Journey:
        m = self._mission
        return Journey(self._outbox, name, T_home_cam, m.min_separation_m, m.settle.timeout_s)

    def _others(self, name: str) -> List[str]:
        return [n for n in self._vehicles if n != name]

    def _bring_reference_home(self, snapshot: Snapshot) -> bool:
        """It goes there once and stays; nobody else moves before."""
        if not self._reference_is_home:
            name = self._mission.reference
            self.detail = f"{name} goes home"
            self._reference_is_home = self._home.step(snapshot, self._others(name))
        return self._reference_is_home

    def _travel(self, snapshot: Snapshot, task: Task) -> bool:
        if self._journey_now is None:
            place, words = self._place(task)
            self._journey_now = self._journey(task.vehicle, place)
            self.detail = f"{task.vehicle} on its way to {words}"
        return self._journey_now.step(snapshot, self._others(task.vehicle))

    def _place(self, task: Task) -> Tuple[np.ndarray, str]:
        if task.index is None:
            return self._parked[task.vehicle], "its place in the column"
        configuration = self._mission.configurations[task.index]
        return camera_place(configuration), configuration.title

    def _stand_at(self, task: Task) -> Standing:
        self._attempts[task.index] = self._attempts.get(task.index, 0) + 1
        places = {task.vehicle: self._place(task)[0], self._mission.reference: T_HOME_CAM_AT_HOME}
        last = self._attempts[task.index] >= self._mission.settle.attempts
        return Standing(self._mission, task.index, task.vehicle, places, self._outbox, last)

    def _stand(self, snapshot: Snapshot, task: Task) -> Optional[CaptureWindow]:
        """Settle and record; what was disturbed is taken again, what never becomes calm is left out."""
        progress, window = self._standing.step(snapshot)
        self.detail = self._standing.detail
        if progress is Progress.AGAIN:
            self._standing = self._stand_at(task)
        elif progress is Progress.GIVEN_UP:
            title = self._mission.configurations[task.index].title
            self.notes.append(f"{title} left out, not calm there: {self._standing.detail}")
            self._next()
        elif progress is Progress.DONE:
            self._next()
        return window

    def require_some(self, captures: int) -> None:
        """Raises MissionError where the whole list left nothing."""
        if not captures:
            raise MissionError("no configuration could be recorded: " + "; ".join(self.notes))
