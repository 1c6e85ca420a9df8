# SPDX-License-Identifier: Apache-2.0
"""The conditions by which a flight is judged: facts and a user's bounds in, a grade and words out.

Flight check, guardian, mission and Tello link ask the same conditions with bounds of their own
(``fcsv_geometry.vehicles.thresholds``). What is worse than a bound is so; at the bound it is not.
NaN is not known; without an amber bound there is no amber.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from operator import gt, le, lt
from typing import Callable, NamedTuple, Tuple

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


_GREEN, _RED = Grade.GREEN, Grade.RED


class Condition(NamedTuple):
    """How one thing stands: ``value`` in its own unit; ``words`` say what is wrong, "" where
    nothing is, and hold no number that changes while it stays so. A tuple, because a guardian
    makes a dozen in each of 25 steps a second."""

    grade: Grade
    value: float
    words: str = ""

    def measured(self, words: str) -> Tuple[Grade, str]:
        """Gives the grade with words that hold the figure; with its own where that is not known."""
        return self.grade, self.words if self.grade is Grade.UNKNOWN else words

    @property
    def green(self) -> bool:
        """Says that nothing is wrong: known, and within all bounds."""
        return self.grade is _GREEN

    @property
    def red(self) -> bool:
        """Says that it is worse than its red bound; what is not known is not."""
        return self.grade is _RED


@dataclass(frozen=True)
class Measure:
    """Judges one value. ``wrong`` has a place for the bound that is not kept; ``worse`` says that a
    value is worse than a bound: ``gt`` of bounds that are the most that is well. What is not known
    is not worse.

    >>> [battery(share, 0.2, 0.4).words for share in (0.4, 0.3, 0.2, 0.1, math.nan)]
    ['', 'battery below 40%', 'battery below 40%', 'battery below 20%', 'battery is not known']
    """

    wrong: str
    unknown: str = "not known"
    worse: Callable[[float, float], bool] = gt

    def __call__(self, value: float, red: float, amber: float = NONE) -> Condition:
        if self.worse(value, red):
            return Condition(_RED, value, self.wrong.format(red))
        if self.worse(value, amber):
            return Condition(Grade.AMBER, value, self.wrong.format(amber))
        if math.isnan(value):
            return Condition(Grade.UNKNOWN, value, self.unknown)
        return Condition(_GREEN, value)


# shares, rates (Hz), MiB: too little is wrong
battery = Measure("battery below {:.0%}", "battery is not known", worse=lt)
feed_rate = Measure("fewer than {:g} poses of the tracker a second", worse=lt)
rate = Measure("fewer than {:g} a second", worse=lt)
disk = Measure("less than {:g} MiB are free", worse=lt)
# variances, metres, degrees, the stick's way (0..1), seconds: too much is
ekf = Measure(
    "the autopilot's filter does not agree with its sensors", "its variances are not known"
)
estimate_apart = Measure(
    "autopilot and tracker are more than {:g} m apart", "estimate or feed is not known"
)
tilt = Measure("it leans by more than {:g} deg")
stick = Measure("the throttle stick is not in the middle", "no transmitter is heard")
clock = Measure("clocks are more than {:g} s apart")
# ages (s) of what comes again and again; one of the future, as clocks are measured, is new
feed_age = Measure("no poses of the tracker for {:g} s")
pose_age = Measure("no pose for {:g} s")
state_age = Measure("no state for {:g} s")
control_age = Measure("nothing from the control PC for {:g} s")
agent_age = Measure("nothing from the agent for {:g} s")
link_age = Measure("nothing from the flight link for {:g} s")
wifi_age = Measure("its Wi-Fi has been silent for {:g} s")
low_confidence = Measure("the tracking camera has low confidence", worse=le)


def confidence_level(variance_m2: float) -> float:
    """What a tracking camera thinks of its poses: 0 failed, 1 low, 2 medium, 3 high. By the variance
    of x, into which realsense2_camera puts it: 0.01 * 10^(3 - level). NaN: it tells none (0).

    >>> [confidence_level(v) for v in (0.01, 0.1, 1.0, 10.0, 1e-3, 0.0)]
    [3.0, 2.0, 1.0, 0.0, 3.0, nan]
    """
    return min(3.0 - math.log10(variance_m2 / 0.01), 3.0) if variance_m2 > 0.0 else math.nan


def confidence(level: float, low: float) -> Condition:
    """Judges this level: up to ``low`` is red; a tracker that tells none is amber."""
    if math.isnan(level):
        return Condition(Grade.AMBER, level, "it tells no confidence")
    if low_confidence.worse(level, low):
        return Condition(_RED, level, low_confidence.wrong)
    return Condition(Grade.GREEN, level)


def transmitter(throttle: float, age_s: float, red_s: float) -> Condition:
    """Judges whether the pilot's transmitter is heard: ``throttle`` is NaN where it is not."""
    if age_s <= red_s and not math.isnan(throttle):
        return Condition(Grade.GREEN, age_s)
    return Condition(Grade.RED, age_s, "no transmitter is heard")


def recorder(age_s: float, problem: str, red_s: float, dropped: int = 0) -> Condition:
    """Judges what a recorder tells: its age, its problem, how many messages it dropped."""
    if problem or not age_s <= red_s:
        return Condition(Grade.RED, age_s, problem if age_s <= red_s else "not heard")
    words = f"{dropped} messages were dropped" if dropped else ""
    return Condition(Grade.AMBER if dropped else Grade.GREEN, age_s, words)
