# SPDX-License-Identifier: Apache-2.0
"""The tracker's motion against the vehicle's own pictures: a slow drift that is level only they can
tell.

While a vehicle holds its place by a tracker that drifts, it flies, and what its camera sees moves.
"""

from dataclasses import dataclass
from typing import Optional

from fcsv_geometry.config import require_positive


@dataclass(frozen=True)
class SceneCheckRules:
    """Bounds: see docs/design/guardian.md#a-slow-drift for what calm flights need of them."""

    off_rad: float = 0.02  # so far 70 % of the points may be from where the poses moved them,
    # and so much of the turn of the camera: of its calibration, stamps and mount
    off_share: float = 0.1
    least_points: int = 15
    least_s: float = 0.6  # between the two pictures
    looks: int = 3  # in a row
    longest_s: float = 2.0  # between two of those
    # whether this is a doubt, upon which the vehicle lands; else it is only said
    lands: bool = False
    # along one way over across it (scene.one_way): it flew, and does not know,
    one_way_ratio: float = 3.8
    one_way_looks: int = 2  # in a row,
    # over the take-off: nearer to the ground small errors move the points far
    one_way_above_m: float = 2.5
    one_way_lands: bool = True  # likewise

    def __post_init__(self):
        require_positive(self)


class _InARow:
    """Counts looks that are off, one after the other, none much later than the one before."""

    def __init__(self, looks: int, longest_s: float):
        self._looks, self._longest_s = looks, longest_s
        self._count, self._last_s = 0, float("-inf")

    def enough(self, now_s: float, off: bool) -> bool:
        """Whether this look is the last of so many."""
        if not off:
            self._count = 0
            return False
        self._count = self._count + 1 if now_s - self._last_s < self._longest_s else 1
        self._last_s = now_s
        return self._count >= self._looks


class SceneCheck:
    """Told what each look says, it gives the doubt."""

    def __init__(self, rules: Optional[SceneCheckRules] = None):
        self._rules = rules or SceneCheckRules()
        self.begin_again()

    def begin_again(self) -> None:
        """Nothing of before counts."""
        r = self._rules
        self._off, self._one_way = (
            _InARow(r.looks, r.longest_s),
            _InARow(r.one_way_looks, r.longest_s),
        )

    def look(
        self, now_s: float, span_s: float, off_rad: float, turn_rad: float, points: int
    ) -> str:
        """A look (SceneMotion.msg) at the scene of a flying vehicle; why the tracker is not
        believed, or nothing."""
        r = self._rules
        if span_s < r.least_s or points < r.least_points:
            return ""
        off = off_rad > r.off_rad + r.off_share * turn_rad
        return (
            "the camera's pictures move, the tracker does not: it drifts"
            if self._off.enough(now_s, off)
            else ""
        )

    def one_way(self, now_s: float, span_s: float, ratio: float, above_m: float) -> str:
        """How much more points moved along one way than across it (SceneMotion.msg), this high over
        the take-off (m); why the tracker is not believed, or nothing."""
        r = self._rules
        if span_s < r.least_s or not above_m > r.one_way_above_m:
            return ""
        off = self._one_way.enough(now_s, ratio > r.one_way_ratio)
        return "the camera sees the vehicle fly, the tracker does not: it drifts" if off else ""
