# SPDX-License-Identifier: Apache-2.0
"""Goals that are dragged in a view of three dimensions (thesis 4.3): each only while it was enabled
by itself."""

from dataclasses import dataclass
from typing import Optional, Sequence, Set, Tuple

from fcsv_console.model.mission_file import ConfigurationRow, stepped

Vector3 = Tuple[float, float, float]


@dataclass(frozen=True)
class GoalEnabled:
    """A fact: the operator lets the goal of configuration ``index`` be dragged, or no longer."""

    index: int
    on: bool


@dataclass(frozen=True)
class GoalMoved:
    """A fact: a goal was let go of there."""

    index: int
    p_home_m: Vector3


@dataclass(frozen=True)
class GoalsElsewhere:
    """A fact: the window of that node has the goals in rviz; empty: this one has them."""

    window: str

    @property
    def words(self) -> str:
        """Says it as an event."""
        whose = (
            f"of {self.window}, opened before this window" if self.window else "this window's again"
        )
        return f"goals in rviz are {whose}"


@dataclass(frozen=True)
class BaselineGoal:
    """One configuration's baseline and place in home (m), and the unit vector along which it may be
    dragged.

    ``asked``: how often something was asked of it; another number means that it is to be drawn
    anew, where it stands.
    """

    index: int
    baseline_m: float
    p_home_m: Vector3
    along: Vector3
    enabled: bool
    asked: int

    @property
    def words(self) -> str:
        """Beside it; they stand 2 m apart."""
        return f"{self.baseline_m:g} m" + (", free" if self.enabled else "")


class Goals:
    """Keeps the goals of the list that is shown. Another number of configurations disables all.

    >>> from fcsv_console.model import mission_file
    >>> text = "name: a\\nconfigurations:\\n  - {axis: horizontal, baseline_m: 4.0}\\n"
    >>> goals, rows, there = Goals(), mission_file.parse(text).rows, (0.0, -6.04, 1.0)
    >>> goals.moved(rows, 0, there), goals.enable(rows, 0, True), goals.moved(rows, 0, there)
    (None, None, 6.0)
    """

    def __init__(self) -> None:
        self._enabled: Set[int] = set()
        self._number, self._asked = 0, 0

    def shown(self, rows: Sequence[ConfigurationRow]) -> Tuple[BaselineGoal, ...]:
        """Gives the goals as they are to be drawn."""
        self._follow(rows)
        return tuple(
            BaselineGoal(
                r.index,
                r.baseline_m,
                r.goal_m,
                (0.0, -1.0, 0.0) if r.axis == "horizontal" else (0.0, 0.0, 1.0),
                r.index in self._enabled,
                self._asked,
            )
            for r in rows
            if r.way_m is None
        )

    def enable(self, rows: Sequence[ConfigurationRow], index: int, on: bool) -> None:
        """One that is not in the list is left alone."""
        self._follow(rows)
        self._asked += 1
        if 0 <= index < len(rows) and rows[index].way_m is None:  # a sweep has no one place
            self._enabled = self._enabled | {index} if on else self._enabled - {index}

    def moved(
        self, rows: Sequence[ConfigurationRow], index: int, p_home_m: Vector3
    ) -> Optional[float]:
        """The baseline (m), in whole steps, of a goal that was let go of there; None where nothing
        changes by it."""
        self._follow(rows)
        self._asked += 1
        if index not in self._enabled:
            return None
        along_m = -p_home_m[1] if rows[index].axis == "horizontal" else p_home_m[2]
        baseline_m = stepped(along_m)
        return None if baseline_m == rows[index].baseline_m else baseline_m

    def _follow(self, rows: Sequence[ConfigurationRow]) -> None:
        if len(rows) != self._number:
            self._number, self._enabled = len(rows), set()
