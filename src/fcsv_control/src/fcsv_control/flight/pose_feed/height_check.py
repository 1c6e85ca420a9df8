# SPDX-License-Identifier: Apache-2.0
"""The tracker's height against the barometer's: what drifts slowly no velocity can tell, but a
height can.

A barometer knows changes of height alone, to about half a metre in a minute: rotors near the
ground, wind and weather move it. So it is compared with what it was some seconds ago.
"""

from collections import deque
from dataclasses import dataclass
from itertools import takewhile
from typing import Deque, Optional, Tuple

from fcsv_geometry.config import require_positive

_SEA_HPA, _SCALE_M, _EXPONENT = 1013.25, 44330.0, 5.255  # of the standard atmosphere
_SILENT_S = 2.0  # after which nothing of before counts


def height_m(pressure_hpa: float) -> float:
    """Gives the height in the standard atmosphere; a difference of two is right to 2 % for 5
    degrees that it is warmer or colder.

    >>> round(height_m(1013.25), 6), round(height_m(1001.3), 1)
    (0.0, 100.0)
    """
    return _SCALE_M * (1.0 - (pressure_hpa / _SEA_HPA) ** (1.0 / _EXPONENT))


@dataclass(frozen=True)
class HeightCheckRules:
    """Bounds: see docs/design/guardian.md#a-slow-drift for what a calm flight needs of them."""

    off_m: float = 1.2  # by which the tracker's height may leave the barometer's
    mean_s: float = 1.0  # of what is compared now,
    before_s: float = 5.0  # with the mean over so long,
    apart_s: float = 10.0  # which ended so long ago
    above_m: float = 1.5  # over the take-off: below that the rotors' wash counts

    def __post_init__(self):
        require_positive(self)


class HeightCheck:
    """Told the barometer's heights and the tracker's, it says by how much one left the other
    lately."""

    def __init__(self, rules: Optional[HeightCheckRules] = None):
        self._rules = rules or HeightCheckRules()
        self.ground_seen = False  # by this process
        self.above_m = 0.0  # over the lowest since the take-off, by the barometer
        self._lowest_m: Optional[float] = None  # of the barometer since the take-off
        self.begin_again()

    def begin_again(self) -> None:
        """The tracker's frame was begun anew."""
        # time, tracker's height less the barometer's
        self._apart: Deque[Tuple[float, float]] = deque()

    def on_ground(self) -> None:
        """Nothing of before counts."""
        self.begin_again()
        self._lowest_m, self.ground_seen, self.above_m = None, True, 0.0

    def barometer(self, now_s: float, baro_m: float, tracker_m: float) -> float:
        """A sample, and the tracker's height then; by how much (m) they moved against each other,
        0.0 while too little is known."""
        r, apart = self._rules, self._apart
        if apart and now_s - apart[-1][0] > _SILENT_S:
            apart.clear()
        # who was started in flight never saw the ground: where the tracker began
        if self._lowest_m is None:
            self._lowest_m = baro_m if self.ground_seen else baro_m - max(0.0, tracker_m)
        self._lowest_m = min(self._lowest_m, baro_m)
        self.above_m = baro_m - self._lowest_m
        if self.above_m < r.above_m:
            return 0.0
        apart.append((now_s, tracker_m - baro_m))
        while apart[0][0] < now_s - r.apart_s - r.before_s:
            apart.popleft()
        if now_s - apart[0][0] < r.apart_s + 0.5 * r.before_s:
            return 0.0
        before = [d for _, d in takewhile(lambda a: a[0] <= now_s - r.apart_s, apart)]
        lately = [d for _, d in takewhile(lambda a: a[0] > now_s - r.mean_s, reversed(apart))]
        return sum(lately) / len(lately) - sum(before) / len(before)

    def doubt(self, off_m: float) -> str:
        """What it says of that, if it is too much."""
        if abs(off_m) <= self._rules.off_m:
            return ""
        return f"the tracker's height left the barometer's by {abs(off_m):.1f} m: it drifts"
