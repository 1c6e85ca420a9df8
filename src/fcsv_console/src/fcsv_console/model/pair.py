# SPDX-License-Identifier: Apache-2.0
"""What is heard of the pictures of a pair: how far apart in time they are, and their epipolar error."""

import math
from collections import deque
from typing import Any, Deque, Dict, Mapping, Sequence, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model.hearing import Heard

_KEPT = 6  # stamps per vehicle: two vehicles' newest pictures may be of different moments
_LIVE_S, _TAKEN_S = 2.5, 1.5  # previews come once a second, pictures while recording twice
_EPIPOLAR_S = 4.0  # measured once a second

Stamps = Dict[str, Deque[Tuple[float, float]]]  # by vehicle: (when it came, monotonic; its stamp)


class PairWatch:
    """Pictures that are taken while recording count before the reduced ones that always cross the radio."""

    def __init__(self, names: Sequence[str]):
        self._live: Stamps = {n: deque(maxlen=_KEPT) for n in names}
        self._taken: Stamps = {n: deque(maxlen=_KEPT) for n in names}
        self._epipolar: Heard[f.EpipolarTold] = Heard(_EPIPOLAR_S)

    def tell(self, now_s: float, fact: Any) -> None:
        """Of pictures and epipolar errors; all else is left alone."""
        if isinstance(fact, f.EpipolarTold):
            self._epipolar.tell(now_s, fact)
        elif isinstance(fact, (f.PictureHeard, f.Captured)):
            stamps = self._taken if isinstance(fact, f.Captured) else self._live
            stamps[fact.vehicle].append((now_s, fact.stamp_s))

    def skew_s(self, now_s: float, pair: Tuple[str, str], offsets_s: Mapping[str, float]) -> float:
        """Between the newest moment of which both have a picture and the other's nearest one; NaN: not known.

        ``offsets_s``: of the vehicles' clocks against the control PC's.
        """
        for stamps, patience_s in ((self._taken, _TAKEN_S), (self._live, _LIVE_S)):
            a, b = ([stamp_s - offsets_s.get(n, 0.0) for at_s, stamp_s in stamps[n] if now_s - at_s <= patience_s]
                    for n in pair)  # fmt: skip
            if a and b:
                older, other = (a, b) if max(a) <= max(b) else (b, a)
                return min(abs(max(older) - stamp_s) for stamp_s in other)
        return math.nan

    def epipolar_px(self, now_s: float, pair: Tuple[str, str]) -> float:
        """NaN: not known."""
        told = self._epipolar.at(now_s)
        return math.nan if told.value is None or told.stale or told.value.pair != pair else told.value.error_px
