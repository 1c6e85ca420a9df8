# SPDX-License-Identifier: Apache-2.0
"""What the console finds out itself: rehearsal, work after the flight, the master, messages it
cannot use."""

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
class EpipolarReport:
    """Holds the error of a pair's newest pictures: median distance from the epipolar lines of their
    places, NaN: too few matches.

    ``refined_px``: what is left of it once the pair is fitted as the map fits it, ``surprise``: how
    far that pose is from the trackers' (standard deviations of the map's prior); NaN: not fitted.
    ``picture_focal_px``: of the picture. ``unlike``: why the pictures tell nothing of each other, in
    words; empty where they do, or too few of them were seen yet.
    """

    pair: Tuple[str, str]
    error_px: float
    matches: int
    refined_px: float = math.nan
    surprise: float = math.nan
    picture_focal_px: float = math.nan
    unlike: str = ""


@dataclass(frozen=True)
class RehearsalProgress:
    """Holds the rehearsal of a mission file's ``text``; ``state``: "runs", "passed", "broken",
    "impossible", "stopped"; ``share`` (0..1) of one that runs, NaN: not known."""

    text: str
    state: str
    share: float = math.nan
    words: str = ""


@dataclass(frozen=True)
class JobProgress:
    """Holds the state of "gather", "map" or "report". ``state``: "runs", "done", "failed",
    "stopped"; ``share``: 0..1; NaN: unknown."""

    job: str
    state: str
    share: float = math.nan
    words: str = ""


@dataclass(frozen=True)
class PlacesFound:
    """Whether there is a session, and a map's report, where they are looked for.

    ``recording``: a bag of the session is still written; ``mapping``: some command makes a map
    there now.
    """

    session: bool
    report: bool
    recording: bool = False
    mapping: bool = False


@dataclass(frozen=True)
class MasterReport:
    """Whether the ROS master answers."""

    problem: str = ""
