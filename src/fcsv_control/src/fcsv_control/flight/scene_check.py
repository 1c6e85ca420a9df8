# SPDX-License-Identifier: Apache-2.0
"""The tracker's motion against the vehicle's own pictures: a slow drift that is level only they can tell.

While a vehicle holds its place by a tracker that drifts, it flies, and what its camera sees moves.
"""

from dataclasses import dataclass
from typing import Optional

from fcsv_geometry.config import require_positive


@dataclass(frozen=True)
class SceneCheckRules:
    """Bounds: see docs/safety.md#a-slow-drift for what calm flights need of them."""

    off_rad: float = 0.02  # so far 70 % of the points may be from where the poses moved them,
    off_share: float = 0.1  # and so much of the turn of the camera: of its calibration, stamps and mount
    least_points: int = 15
    least_s: float = 0.6  # between the two pictures
    looks: int = 3  # in a row
    longest_s: float = 2.0  # between two of those
    lands: bool = False  # whether it is a doubt, upon which the vehicle lands; else it is only said
    one_way_share: float = 0.19  # of the points (fcsv_tracking.one_way), moved as if the vehicle flew one way,
    one_way_looks: int = 2  # in a row,
    one_way_above_m: float = 2.5  # over the take-off: nearer to the ground small errors move the points far
    one_way_lands: bool = False  # likewise

    def __post_init__(self):
        require_positive(self)


class SceneCheck:
    """Told what each look says, it gives the doubt."""

    def __init__(self, rules: Optional[SceneCheckRules] = None):
        self._rules = rules or SceneCheckRules()
        self.begin_again()

    def begin_again(self) -> None:
        """Nothing of before counts."""
        self._off, self._off_s = 0, float("-inf")
        self._one_way, self._one_way_s = 0, float("-inf")

    def look(self, now_s: float, span_s: float, off_rad: float, turn_rad: float, points: int) -> str:
        """A look (SceneMotion.msg) at the scene of a flying vehicle; why the tracker is not believed, or nothing."""
        r = self._rules
        if span_s < r.least_s or points < r.least_points:
            return ""
        if not off_rad > r.off_rad + r.off_share * turn_rad:
            self._off = 0
            return ""
        self._off = self._off + 1 if now_s - self._off_s < r.longest_s else 1
        self._off_s = now_s
        return "the camera's pictures move, the tracker does not: it drifts" if self._off >= r.looks else ""

    def one_way(self, now_s: float, span_s: float, share: float, above_m: float) -> str:
        """The share of the points that moved as if the vehicle flew one way, this high over the take-off (m); why the
        tracker is not believed, or nothing."""
        r = self._rules
        if span_s < r.least_s or not above_m > r.one_way_above_m:
            return ""
        if not share > r.one_way_share:
            self._one_way = 0
            return ""
        self._one_way = self._one_way + 1 if now_s - self._one_way_s < r.longest_s else 1
        self._one_way_s = now_s
        return (
            "the camera sees the vehicle fly, the tracker does not: it drifts"
            if self._one_way >= r.one_way_looks
            else ""
        )
