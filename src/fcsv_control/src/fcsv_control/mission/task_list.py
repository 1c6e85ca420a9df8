# SPDX-License-Identifier: Apache-2.0
"""What is flown in which order, and how the operator changes it."""

from dataclasses import dataclass
from typing import List, Optional, Sequence

from fcsv_geometry.mission import Mission


@dataclass(frozen=True)
class Task:
    """A vehicle's place: that of a configuration, or (None) where it was parked when the list began."""

    vehicle: str
    index: Optional[int] = None


def tasks(
    mission: Mission, vehicles: Sequence[str], indices: Optional[Sequence[int]] = None, away: Optional[str] = None
) -> List[Task]:
    """What is flown in order. A vehicle that has done its part goes back to its place in the column before another
    moves and before all land, so that no vehicle comes down on another. ``away`` is out of the column already."""
    found: List[Task] = []
    for i in range(len(mission.configurations)) if indices is None else indices:
        mover = mission.mover(i, vehicles)
        if away is not None and away != mover:
            found.append(Task(away))
        found.append(Task(mover, i))
        away = mover
    return found if away is None else [*found, Task(away)]


class TaskList:
    """The tasks that are left, the running one first. Changes answer "" or why they cannot be made."""

    def __init__(self, mission: Mission, vehicles: Sequence[str], left: Sequence[Task], flown: Sequence[int] = ()):
        self._mission, self._vehicles = mission, list(vehicles)
        self.left = list(left)
        self.flown = list(flown)  # configurations that are behind, recorded or left out
        self._last = next((t.index for t in self.left if t.index is not None), 0)

    @property
    def index(self) -> int:
        """Of the running configuration, also on the way back from the last."""
        running = self.running
        self._last = self._last if running is None else running
        return self._last

    @property
    def running(self) -> Optional[int]:
        """Index of the configuration that is flown, or that comes next; None on the last way back."""
        return next((t.index for t in self.left if t.index is not None), None)

    def done(self) -> None:
        """The running task is done."""
        task = self.left.pop(0)
        if task.index is not None:
            self._last = task.index
            self.flown.append(task.index)

    def go_back(self) -> None:
        """Nothing more is flown but the way back."""
        self.left = [Task(self.left[0].vehicle)] if self.left else []

    def skip(self) -> str:
        """Leave the running configuration out."""
        if self.running is None:
            return "no configuration is left that could be skipped"
        first, *others = self._indices()
        self._order(others)
        self.flown.append(first)
        return ""

    def put_off(self) -> str:
        """Fly the next configuration first, the running one after all others."""
        first, *others = self._indices() or [None]
        if not others:
            return "no other configuration is left that could come first"
        self._order([*others, first])
        return ""

    def before(self) -> str:
        """Fly the configuration before again, then the running one."""
        if not self.flown:
            return "no configuration was flown before"
        self._order([self.flown.pop(), *self._indices()])
        return ""

    def again(self) -> str:
        """Fly the running configuration from its start; on the last way back the one before."""
        return self.before() if self.running is None else ""

    def _indices(self) -> List[int]:
        return [t.index for t in self.left if t.index is not None]

    def _order(self, indices: Sequence[int]) -> None:
        away = self.left[0].vehicle if self.left else None
        self.left = tasks(self._mission, self._vehicles, indices, away)
