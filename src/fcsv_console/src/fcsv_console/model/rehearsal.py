# SPDX-License-Identifier: Apache-2.0
"""Whether the list that is shown was flown in simulation, and what that means for Execute."""

import math
from dataclasses import dataclass
from typing import Dict, Optional, Sequence, Set

from fcsv_console.model import facts as f
from fcsv_geometry.programs.durations import clock_words

NONE, RUNS, PASSED, BROKEN, IMPOSSIBLE, STOPPED = (
    "none",
    "runs",
    "passed",
    "broken",
    "impossible",
    "stopped",
)
_UNFLYABLE = 3  # exit status of ``rehearse`` for a mission that cannot be flown


@dataclass(frozen=True)
class Rehearsal:
    """Shows the rehearsal of the list as it is shown. ``waived``: the operator flies it though it
    did not pass."""

    state: str = NONE
    share: float = math.nan
    words: str = ""
    waived: bool = False

    @property
    def summary(self) -> str:
        """Says it in one line."""
        share = "" if math.isnan(self.share) else f": {100.0 * self.share:.0f} %"
        line = {
            NONE: "not rehearsed",
            RUNS: f"is being rehearsed{share}",
            PASSED: f"rehearsed: {self.words}",
            BROKEN: f"REHEARSAL BROKE: {self.words}",
            IMPOSSIBLE: f"cannot be rehearsed: {self.words}",
            STOPPED: "rehearsal stopped",
        }[self.state]
        return f"{line}; the operator flies it so" if self.waived else line

    @property
    def runs(self) -> bool:
        return self.state == RUNS

    @property
    def wanted(self) -> bool:
        """Whether the list is to be rehearsed before it can be flown."""
        return bool(self.locks) and not self.runs

    @property
    def locks(self) -> str:
        """Why the list is not flown yet; "" where it may be."""
        if self.state == PASSED or self.waived:
            return ""
        if self.state in (NONE, STOPPED):
            return f"the list is not rehearsed: rehearse it [V]{self._why}"
        return f"the list {self.summary}" if self.state == RUNS else self.summary

    @property
    def _why(self) -> str:
        return "; the last one was stopped" if self.state == STOPPED else ""


class Rehearsals:
    """Keeps what was heard of rehearsals. An outcome holds for the text that was flown, and for no
    other."""

    def __init__(self) -> None:
        self._told: Dict[str, f.RehearsalProgress] = {}
        self._waived: Set[str] = set()

    def tell(self, told: f.RehearsalProgress) -> None:
        """What became of one; of a text that is flown again the newest counts."""
        before = self._told.get(told.text)
        if math.isnan(told.share) and before is not None and before.state == RUNS == told.state:
            told = before  # a line without a share
        self._told[told.text] = told

    def waive(self, text: str) -> None:
        """The operator flies this text though its rehearsal did not pass."""
        self._waived.add(text)

    def of(self, text: str) -> Rehearsal:
        """Gives the rehearsal of the text that is shown."""
        told = self._told.get(text, f.RehearsalProgress(text, NONE))
        return Rehearsal(told.state, told.share, told.words, text in self._waived)


def judged(
    text: str, status: int, last: str, flown: Optional[Sequence[dict]]
) -> f.RehearsalProgress:
    """Judges from the exit status of ``rehearse``, its last line, and what it wrote.

    >>> judged("", 3, "rehearse: mission 'a' cannot be flown: 3 m is outside", None).words
    "mission 'a' cannot be flown: 3 m is outside"
    >>> good = {"violations": [], "captures": 8, "wanted": 8, "flown_s": 190.0, "nearest_m": 1.66, "phase": "DONE"}
    >>> judged("", 0, "", [good]).words
    '8 of 8 recorded in 3:10, never nearer than 1.7 m'
    """
    if not flown or status not in (0, 1):
        words = last.split("rehearse: ", 1)[-1] or "it told nothing"
        return f.RehearsalProgress(
            text, BROKEN if status == _UNFLYABLE else IMPOSSIBLE, words=words
        )
    violations = [
        f"{v['kind']} at {v['at_s']:.0f} s ({v['text']})"
        for one in flown
        for v in one["violations"]
    ]
    short = [
        f"{one['captures']} of {one['wanted']} recorded, then {one['phase']}: {one.get('detail', '')}".rstrip(
            ": "
        )
        for one in flown
        if one["captures"] < one["wanted"]
    ]
    if violations or short or status:
        return f.RehearsalProgress(
            text, BROKEN, words="; ".join(violations[:3] + short) or f"exit status {status}"
        )
    one = flown[0]
    took = clock_words(round(one["flown_s"]))
    near = "" if one["nearest_m"] is None else f", never nearer than {one['nearest_m']:.1f} m"
    return f.RehearsalProgress(
        text, PASSED, words=f"{one['captures']} of {one['wanted']} recorded in {took}{near}"
    )
