# SPDX-License-Identifier: Apache-2.0
"""Which poses of external navigation go on to the autopilot: new ones only, at a steady rate."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Optional, Tuple

from fcsv_geometry.flow import RateGate


@dataclass(frozen=True)
class FeedParameters:
    """ArduCopter flies well on 30 Hz, needs 10 Hz; a pose older than ``stale_s`` is no news."""

    rate_hz: float = 30.0
    stale_s: float = 0.3

    def __post_init__(self):
        if not 10.0 <= self.rate_hz <= 100.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 10..100")
        if not 0.0 < self.stale_s <= 1.0:
            raise ValueError(f"stale_s: {self.stale_s} is not in (0, 1]")


class FeedVerdict(Enum):
    """What becomes of a pose."""

    SEND = auto()
    THIN_OUT = auto()  # more come than are wanted, as it should be
    DROP = auto()


class VisionFeed:
    """Decides by stamps; never lets one pass twice."""

    _FUTURE_S = 0.1  # how far ahead of the clock a stamp may be
    _EARLY = 0.3  # share of a period by which a pose may come early and pass: jitter of the sender

    def __init__(self, parameters: FeedParameters):
        self._parameters = parameters
        self._last_s: Optional[float] = None
        self._gate = RateGate(parameters.rate_hz, self._EARLY)

    def judge(self, now_s: float, stamp_s: float) -> Tuple[FeedVerdict, str]:
        """What to do, and why it is dropped where it is."""
        age_s = now_s - stamp_s
        if not -self._FUTURE_S <= age_s <= self._parameters.stale_s:
            why = f"pose is {age_s:.2f} s old" if age_s > 0 else f"pose is {-age_s:.2f} s ahead of the clock"
            return FeedVerdict.DROP, why
        due = self._gate.due(stamp_s)  # also where the clock was set back
        if self._last_s is not None and stamp_s <= self._last_s and not due:
            return FeedVerdict.DROP, "pose is not newer than the last"
        if not due:
            return FeedVerdict.THIN_OUT, ""
        self._gate.take(stamp_s)
        self._last_s = stamp_s
        return FeedVerdict.SEND, ""
