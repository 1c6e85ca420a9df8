# SPDX-License-Identifier: Apache-2.0
"""What a list's activities have in common: the list owns one at a time, and steps it until it is
over."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import List, Sequence

from fcsv_control.mission.snapshot import Snapshot


@dataclass(frozen=True)
class CaptureWindow:
    """A recording window that counts: pictures stamped within it (s) belong to configuration
    ``index``."""

    index: int
    vehicle: str
    start_s: float
    stop_s: float
    position_error_m: float  # largest distance of mover or reference from its place, by odometry


class Progress(Enum):
    """How far an activity is."""

    UNDER_WAY = auto()
    DONE = auto()
    AGAIN = auto()  # it was disturbed
    GIVEN_UP = auto()  # a note says why


class Activity:
    """One activity begins when it is made, and ends at the step that does not answer UNDER_WAY."""

    stage = ""  # as stages.py names it; "": vehicles are on their way

    def __init__(self) -> None:
        self.detail = ""  # what is done, in words
        self.windows: List[
            CaptureWindow
        ] = []  # what counts, one per configuration, once it is done
        # the windows as long as they are already; replaced every two seconds
        self.so_far: List[CaptureWindow] = []
        self._notes: List[str] = []

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        """Advance; orders go to the outbox. ``guided``: vehicles that the mission flies now. Raises
        MissionError where the list cannot go on."""
        raise NotImplementedError

    def stop(self, snapshot: Snapshot) -> None:
        """It is interrupted, and not stepped again."""

    def skip(self) -> bool:
        """Leaves out what is no configuration, for the operator; whether there was such."""
        return False

    def pop_notes(self) -> List[str]:
        """What was left out, and why, each told once."""
        notes, self._notes = self._notes, []
        return notes
