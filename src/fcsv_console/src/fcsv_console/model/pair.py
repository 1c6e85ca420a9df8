# SPDX-License-Identifier: Apache-2.0
"""What is heard of the pictures of a pair: how far apart in time they are, and how they agree with
the places."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Deque, Dict, List, Mapping, Optional, Sequence, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model.hearing import AgingFact
from fcsv_stereo import instants

_KEPT = 400  # moments per vehicle, each told up to three times
_NEWEST_S = 2.5  # previews come once a second
_LONGEST_S = 6.0  # of a recording: its newest part is enough, and costs little
_EPIPOLAR_S = 4.0  # measured once a second


@dataclass(frozen=True)
class _Taken:
    stamp_s: float


@dataclass(frozen=True)
class _Recording:
    """Stands for a recording, as far as the map's choice of pictures looks at a
    ConfigurationInput."""

    references: List[_Taken]
    others: List[_Taken]


class PairWatch:
    """Every picture of which anything is heard counts: as preview, as one that is recorded, by the
    tags found in it."""

    def __init__(self, names: Sequence[str]):
        self._moments: Dict[str, Deque[Tuple[float, float]]] = {
            n: deque(maxlen=_KEPT) for n in names
        }
        self._epipolar: AgingFact[f.EpipolarReport] = AgingFact(_EPIPOLAR_S)

    def tell(self, now_s: float, fact: Any) -> None:
        """Takes the facts of pictures and epipolar errors; all else is left alone."""
        if isinstance(fact, f.EpipolarReport):
            self._epipolar.tell(now_s, fact)
        elif (
            isinstance(fact, (f.PreviewReport, f.PictureCaptured, f.TagReport))
            and fact.stamp_s > 0.0
        ):
            self._moments[fact.vehicle].append((now_s, fact.stamp_s))

    def skew_s(
        self,
        now_s: float,
        pair: Tuple[str, str],
        offsets_s: Mapping[str, float],
        since_s: Optional[float] = None,
    ) -> float:
        """Between the pictures that the map would take of what was heard; NaN: none of both of one
        time.

        Of the recording that began at ``since_s``, else of the last seconds. ``offsets_s``: of the
        vehicles' clocks against the control PC's.
        """
        begin_s = now_s - _NEWEST_S if since_s is None else max(since_s, now_s - _LONGEST_S)
        references, others = (
            sorted(
                {
                    stamp_s - offsets_s.get(n, 0.0)
                    for at_s, stamp_s in self._moments[n]
                    if at_s >= begin_s
                }
            )
            for n in pair
        )
        if not references or not others:
            return math.nan
        # of other moments the reference's picture came too early to be of this recording, or is
        # still on its way
        first_s, last_s = (
            references[0] - instants.MOST_SKEW_S,
            references[-1] + instants.MOST_SKEW_S,
        )
        told = [o for o in others if first_s <= o <= last_s]
        if not told:
            return math.nan
        recording = _Recording([_Taken(s) for s in references], [_Taken(s) for s in told])
        return instants.skew_s(recording.references, instants.middle(recording))

    def epipolar(self, now_s: float, pair: Tuple[str, str]) -> Optional[f.EpipolarReport]:
        """None: not known."""
        told = self._epipolar.at(now_s)
        return None if told.value is None or told.stale or told.value.pair != pair else told.value
