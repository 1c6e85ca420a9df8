# SPDX-License-Identifier: Apache-2.0
"""Whether a device's driver still speaks, and what to try when it does not. Time is an argument."""

from dataclasses import dataclass, field
from enum import Enum
from typing import List, Optional, Tuple

from fcsv_geometry.config import require_positive
from fcsv_geometry.streams.stream import Stream

_RATE_OVER_S = 3.0


class Remedy(Enum):
    """Orders remedies from mild to strong."""

    RESET = "the device is reset"  # by the driver's own service
    RESTART = "its driver is restarted"  # asked to end; roslaunch starts it again
    KILL = "its driver is killed"  # where it does not end


class Level(Enum):
    OK, WARN, ERROR = range(3)


@dataclass(frozen=True)
class DeviceRules:
    """What is expected of a device.

    ``topic``: what it sends; ``least_hz``: below is a warning; ``silent_s``: longer begins the
    remedies; ``starts_s``: how long a driver may take to come up after a start or a remedy.
    ``reset``: a std_srvs/Empty service of the driver; ``nodes``: of the driver, which roslaunch
    starts again (empty: nothing is restarted); ``usb``: vendor:product.
    """

    topic: str
    least_hz: float
    silent_s: float = 1.0
    starts_s: float = 12.0
    reset: str = ""
    nodes: List[str] = field(default_factory=list)
    usb: List[str] = field(default_factory=list)

    def __post_init__(self):
        require_positive(self)

    @property
    def remedies(self) -> List[Remedy]:
        """Lists the remedies in the order in which they are tried."""
        return [Remedy.RESET] * bool(self.reset) + [Remedy.RESTART, Remedy.KILL] * bool(self.nodes)


class DriverWatch:
    """One device. It is never given up: after the strongest remedy comes the mildest again.

    One that speaks for a moment after a remedy and is silent again gets the next one.
    """

    def __init__(self, name: str, rules: DeviceRules, now_s: float):
        self.name, self.rules = name, rules
        self.silences = self.tries = 0
        self._heard: Stream[None] = Stream(_RATE_OVER_S)
        self._wait_until_s = now_s + rules.starts_s
        self._silent = False
        self._tried = 0  # since it last spoke for long
        self._speaks_since_s = now_s
        self._done = ""

    def on_message(self, now_s: float) -> None:
        """A message of the device."""
        self._heard.tell(now_s)
        if self._silent:
            self._silent, self._speaks_since_s = False, now_s

    def rate_hz(self, now_s: float) -> float:
        """Counts samples over the last three seconds."""
        return self._heard.rate_hz(now_s)

    def step(self, now_s: float) -> Optional[Remedy]:
        """What is to be tried now."""
        if self._heard.fresh(now_s, self.rules.silent_s):
            if now_s - self._speaks_since_s > self.rules.starts_s:
                self._tried = 0
            return None
        if not self._silent and (self._heard.known or now_s >= self._wait_until_s):
            self._silent = True
            self.silences += 1
            self._wait_until_s = now_s
        remedies = self.rules.remedies
        if not self._silent or now_s < self._wait_until_s or not remedies:
            return None
        remedy = remedies[self._tried % len(remedies)]
        self._tried, self.tries, self._done = self._tried + 1, self.tries + 1, remedy.value
        self._wait_until_s = now_s + self.rules.starts_s
        return remedy

    def status(self, now_s: float) -> Tuple[Level, str]:
        """Gives the state for the diagnostics."""
        if not self._heard.known and not self._silent:
            return Level.WARN, f"{self.name} has not begun to send {self.rules.topic}"
        if self._silent:
            since = (
                f"for {self._heard.age_s(now_s):.0f} s" if self._heard.known else "since the start"
            )
            done = (
                f"{self._done} (try {self._tried})"
                if self._tried
                else "nobody here can restart its driver"
            )
            return Level.ERROR, f"{self.name} is silent {since}; {done}"
        rate = self.rate_hz(now_s)
        if rate < self.rules.least_hz and self._heard.span_s(now_s) > 0.8 * _RATE_OVER_S:
            return (
                Level.WARN,
                f"{self.name} sends at {rate:.0f} Hz, {self.rules.least_hz:.0f} are expected",
            )
        again = (
            f"; it was silent {self.silences} times, last remedy: {self._done}"
            if self.silences
            else ""
        )
        return (
            Level.WARN if self.silences else Level.OK
        ), f"{self.name} sends at {rate:.0f} Hz{again}"
