# SPDX-License-Identifier: Apache-2.0
"""The conditions by which a flight is judged: facts and a user's bounds in, a grade and words out.

Flight check, guardian, mission and Tello link ask the same functions with bounds of their own
(``fcsv_geometry.vehicles.thresholds``). What is worse than a bound is red, or amber; at the bound
it is neither. NaN is not known. Without an amber bound there is no amber.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Tuple

NONE = math.nan  # no amber bound


class Grade(IntEnum):
    """Numbers the grade as in fcsv_msgs/FlightCheckLine. What is not known is never green."""

    UNKNOWN = 0
    GREEN = 1
    AMBER = 2
    RED = 3

    @property
    def word(self) -> str:
        """Says it for people, who may not tell colours apart."""
        return "RED" if self is Grade.RED else self.name.lower()


@dataclass(frozen=True)
class Condition:
    """How one thing stands: ``value`` in its own unit; ``words`` say what is wrong, "" where
    nothing is, and hold no number that changes while it stays so."""

    grade: Grade
    value: float
    words: str = ""

    def measured(self, words: str) -> Tuple[Grade, str]:
        """Gives the grade with words that hold the figure; with its own where that is not known."""
        return self.grade, self.words if self.grade is Grade.UNKNOWN else words

    @property
    def green(self) -> bool:
        """Says that nothing is wrong: known, and within all bounds."""
        return self.grade is Grade.GREEN

    @property
    def red(self) -> bool:
        """Says that it is worse than its red bound; what is not known is not."""
        return self.grade is Grade.RED


def at_most(value: float, red: float, amber: float = NONE) -> Grade:
    """Grades a value that should be small.

    >>> [at_most(v, 0.8, 0.5).word for v in (0.5, 0.6, 0.8, 0.9, math.nan)]
    ['green', 'amber', 'amber', 'RED', 'unknown']
    """
    if math.isnan(value):
        return Grade.UNKNOWN
    return Grade.RED if value > red else Grade.AMBER if value > amber else Grade.GREEN


def at_least(value: float, red: float, amber: float = NONE) -> Grade:
    """Grades a value that should be large.

    >>> [at_least(v, 0.2, 0.4).word for v in (0.4, 0.3, 0.2, 0.1, math.nan)]
    ['green', 'amber', 'amber', 'RED', 'unknown']
    """
    return at_most(-value, -red, -amber)


def _condition(grade: Grade, value: float, red: float, amber: float, wrong: str, unknown: str):
    """``wrong`` has a place for the bound that is not kept."""
    words = "" if grade is Grade.GREEN else unknown
    if grade > Grade.GREEN:
        words = wrong.format(red if grade is Grade.RED else amber)
    return Condition(grade, value, words)


def silence(what: str, age_s: float, red_s: float) -> Condition:
    """Judges the age of what should come again and again; ``what`` is missing, as in "no pose".
    What is of the future, by a clock that was measured a little wrong, is fresh.

    >>> silence("no state", 3.6, 3.5).words, silence("no state", -1.0, 3.5).green
    ('no state for 3.5 s', True)
    """
    return _condition(at_most(age_s, red_s), age_s, red_s, NONE, what + " for {:g} s", what)


def feed_age(age_s: float, red_s: float) -> Condition:
    """Judges the age of the tracker's newest pose."""
    return silence("no poses of the tracker", age_s, red_s)


def feed_rate(rate_hz: float, red_hz: float, amber_hz: float = NONE) -> Condition:
    """Judges the rate of the tracker's poses."""
    wrong, unknown = "fewer than {:g} poses of the tracker a second", "the feed's rate is not known"
    grade = at_least(rate_hz, red_hz, amber_hz)
    return _condition(grade, rate_hz, red_hz, amber_hz, wrong, unknown)


def battery(share: float, red: float, amber: float = NONE) -> Condition:
    """Judges the share of the charge.

    >>> [battery(share, 0.2).words for share in (0.3, 0.1, math.nan)]
    ['', 'battery below 20%', 'battery is not known']
    """
    grade = at_least(share, red, amber)
    return _condition(grade, share, red, amber, "battery below {:.0%}", "battery is not known")


def ekf(variance: float, red: float, amber: float = NONE) -> Condition:
    """Judges the largest variance of the autopilot's filter."""
    wrong = "the autopilot's filter does not agree with its sensors"
    grade = at_most(variance, red, amber)
    return _condition(grade, variance, red, amber, wrong, "its variances are not known")


def estimate_apart(apart_m: float, red_m: float, amber_m: float = NONE) -> Condition:
    """Judges the distance between the autopilot's estimate and the tracker's pose."""
    wrong = "autopilot and tracker are more than {:g} m apart"
    grade = at_most(apart_m, red_m, amber_m)
    return _condition(grade, apart_m, red_m, amber_m, wrong, "estimate or feed is not known")


def confidence(level: float, low: float) -> Condition:
    """Judges what a tracking camera thinks of its poses (``tracker_confidence``): up to ``low`` is
    red; a tracker that tells none is amber.

    >>> [confidence(level, 1.0).grade.word for level in (1.0, 1.1, math.nan)]
    ['RED', 'green', 'amber']
    """
    if math.isnan(level):
        return Condition(Grade.AMBER, level, "it tells no confidence")
    if level <= low:
        return Condition(Grade.RED, level, "the tracking camera has low confidence")
    return Condition(Grade.GREEN, level)


def tilt(tilt_deg: float, red_deg: float) -> Condition:
    """Judges how far a vehicle leans."""
    wrong, unknown = "it leans by more than {:g} deg", "its attitude is not known"
    return _condition(at_most(tilt_deg, red_deg), tilt_deg, red_deg, NONE, wrong, unknown)


def transmitter(throttle: float, age_s: float, red_s: float) -> Condition:
    """Judges whether the pilot's transmitter is heard: ``throttle`` is NaN where it is not."""
    heard = not math.isnan(throttle) and at_most(age_s, red_s) is Grade.GREEN
    words = "" if heard else "no transmitter is heard"
    return Condition(Grade.GREEN if heard else Grade.RED, age_s, words)


def stick(throttle: float, red: float) -> Condition:
    """Judges how far the throttle stick (-1..1) is off its middle; without a transmitter it is not
    known."""
    wrong, unknown = "the throttle stick is not in the middle", "no transmitter is heard"
    return _condition(at_most(abs(throttle), red), throttle, red, NONE, wrong, unknown)


def recorder(age_s: float, problem: str, dropped: int, red_s: float) -> Condition:
    """Judges what a recorder tells: its age, its problem, how many messages it dropped."""
    if at_most(age_s, red_s) is not Grade.GREEN:
        return Condition(Grade.RED, age_s, "not heard")
    if problem:
        return Condition(Grade.RED, age_s, problem)
    words = f"{dropped} messages were dropped" if dropped else ""
    return Condition(Grade.AMBER if dropped else Grade.GREEN, age_s, words)


def disk(free_mib: float, red_mib: float, amber_mib: float = NONE) -> Condition:
    """Judges what is free where a recorder writes."""
    wrong, unknown = "less than {:g} MiB are free", "the recorder's disk is not known"
    grade = at_least(free_mib, red_mib, amber_mib)
    return _condition(grade, free_mib, red_mib, amber_mib, wrong, unknown)


def clock(offset_s: float, uncertainty_s: float, red_s: float, amber_s: float = NONE) -> Condition:
    """Judges how far apart two machines' clocks are for sure."""
    grade = at_most(abs(offset_s) - uncertainty_s, red_s, amber_s)
    wrong, unknown = "clocks are more than {:g} s apart", "the other clock is not known"
    return _condition(grade, offset_s, red_s, amber_s, wrong, unknown)
