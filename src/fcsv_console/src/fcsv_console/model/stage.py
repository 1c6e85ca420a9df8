# SPDX-License-Identifier: Apache-2.0
"""How far the running configuration is: on its way, holding, recording or following, by when the mission began
to say so."""

from dataclasses import dataclass
from typing import Dict, Optional, Tuple

from fcsv_console.model.facts import MissionReport
from fcsv_console.model.mission_file import ConfigurationRow
from fcsv_control.mission.activities import stages

_WAITS = "waits"
_NEARLY = 0.9  # a recording ends a moment before its last picture would be due


@dataclass(frozen=True)
class Stage:
    """``share``: 0..1 of holding and recording; ``words``: "" on the way, and where nothing is
    flown."""

    share: float = 0.0
    words: str = ""


class StageWatch:
    """Told every MissionReport with the time; the clock runs from the first that says another thing.

    A pause, or a recording that begins anew, begins its time anew as well; ``reached`` does not go
    back.
    """

    def __init__(self):
        self._said: Tuple[int, str] = (-1, "")
        self._since_s = 0.0
        self._reached: Dict[int, float] = {}  # largest share, by index of the configuration

    def tell(self, now_s: float, fact: MissionReport) -> None:
        """What the mission does now."""
        said = (fact.configuration, _stage(fact))
        if fact.configuration < self._said[0]:
            self._reached.clear()
        if said != self._said:
            self._said, self._since_s = said, now_s

    @property
    def recording_since_s(self) -> Optional[float]:
        """When the recording that runs began; None: none runs."""
        return self._since_s if self._said[1] == stages.RECORDS else None

    def reached(self, index: int) -> float:
        """The largest share, 0..1, that a configuration was at when it was looked at."""
        return self._reached.get(index, 0.0)

    def was_recorded(self, index: int) -> bool:
        """Whether a configuration that ended was recorded, as far as was seen; one that was not
        seen counts as such."""
        return self._reached.get(index, 1.0) > _NEARLY

    def at(self, now_s: float, row: Optional[ConfigurationRow]) -> Stage:
        """Gives the stage of the running configuration; it never promises more than the file
        says."""
        stage = self._stage_at(now_s, row)
        if row is not None:
            self._reached[row.index] = max(self.reached(row.index), stage.share)
        return stage

    def _stage_at(self, now_s: float, row: Optional[ConfigurationRow]) -> Stage:
        if row is None or row.index != self._said[0]:
            return Stage()
        hold_s, record_s = row.settle_s, row.record_s
        elapsed_s, whole_s = max(0.0, now_s - self._since_s), hold_s + record_s
        if self._said[1] == stages.HOLDS and whole_s > 0.0:
            done_s = min(elapsed_s, hold_s)
            return Stage(done_s / whole_s, f"held {done_s:.1f} of {hold_s:g} s")
        if self._said[1] in (stages.RECORDS, stages.FOLLOWS) and whole_s > 0.0:
            done_s = min(elapsed_s, record_s)
            return Stage((hold_s + done_s) / whole_s, f"{done_s:.0f} of {record_s:g} s")
        return Stage()


def _stage(told: MissionReport) -> str:
    return _WAITS if told.waits_for or told.problems else told.stage
