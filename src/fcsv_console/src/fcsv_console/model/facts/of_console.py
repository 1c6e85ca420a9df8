# SPDX-License-Identifier: Apache-2.0
"""What the console finds out itself: rehearsal, work after the flight, the master, messages it cannot use."""

import math
from dataclasses import dataclass
from typing import Tuple


@dataclass(frozen=True)
class Unusable:
    """A message that could not be read, and why; it changes nothing else."""

    vehicle: str
    topic: str
    why: str


@dataclass(frozen=True)
class EpipolarTold:
    """Of a pair's newest pictures: median distance from the epipolar lines of their places, NaN: too few matches."""

    pair: Tuple[str, str]
    error_px: float
    matches: int


@dataclass(frozen=True)
class RehearsalTold:
    """Of a mission file's ``text``; ``state``: "runs", "passed", "broken", "impossible", "stopped"; ``share`` (0..1) of
    one that runs, NaN: not known."""

    text: str
    state: str
    share: float = math.nan
    words: str = ""


@dataclass(frozen=True)
class JobTold:
    """Of "gather", "map" or "report". ``state``: "runs", "done", "failed", "stopped"; ``share``: 0..1; NaN: unknown."""

    job: str
    state: str
    share: float = math.nan
    words: str = ""


@dataclass(frozen=True)
class PlacesFound:
    """Whether there is a session, and a map's report, where they are looked for."""

    session: bool
    report: bool


@dataclass(frozen=True)
class MasterTold:
    """Whether the ROS master answers."""

    problem: str = ""
