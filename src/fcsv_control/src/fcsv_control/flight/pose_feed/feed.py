# SPDX-License-Identifier: Apache-2.0
"""Which poses of external navigation go on to the autopilot: new ones only, at a steady rate.

Judged by when they arrive, on this computer's monotonic clock, and by differences of the sender's
stamps: the sender's wall clock may be set forwards or back at any time, and that must not stop the
feed of a flying vehicle.
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Optional, Tuple

from fcsv_geometry.streams.flow import RateGate


@dataclass(frozen=True)
class PoseGateParameters:
    """ArduCopter flies well on 30 Hz, needs 10 Hz; a pose older than ``stale_s`` is no news."""

    rate_hz: float = 30.0
    stale_s: float = 0.3

    def __post_init__(self):
        if not 10.0 <= self.rate_hz <= 100.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 10..100")
        if not 0.0 < self.stale_s <= 1.0:
            raise ValueError(f"stale_s: {self.stale_s} is not in (0, 1]")


class PoseVerdict(Enum):
    """What becomes of a pose."""

    SEND = auto()
    THIN_OUT = auto()  # more come than are wanted, as it should be
    DROP = auto()


class PoseGate:
    """Never lets a pose pass twice. ``stamp_s`` is the last passed one's, on the receiver's clock:
    it only rises."""

    # between the advance of the stamps and that of the receiver's clock: the sender's clock was set
    _STEP_S = 0.1
    _CADENCE_S = 0.2  # poses that come faster than this were not held up on the way
    # poses that are late by the same time for so long are not held up, but of another clock
    _HELD_UP_S = 0.1
    _CREEP = 1e-3  # share by which two clocks of one computer run apart, at most
    _LEAST_S = 1e-4  # between two stamps
    _EARLY = 0.3  # share of a period by which a pose may come early and pass: jitter of the sender

    def __init__(self, parameters: PoseGateParameters):
        self._parameters = parameters
        self._gate = RateGate(parameters.rate_hz, self._EARLY)
        self._before: Optional[Tuple[float, float]] = None  # arrival and stamp of the pose before
        self._offset_s = float("inf")  # receiver's clock minus sender's, of the freshest pose
        self._late = (float("-inf"), float("-inf"))  # since when poses are late, and by how much
        self.stamp_s = float("-inf")

    def decide(self, now_s: float, stamp_s: float) -> Tuple[PoseVerdict, str]:
        """What to do with a pose that arrived at ``now_s`` (monotonic), and why it is dropped where
        it is."""
        before, self._before = self._before, (now_s, stamp_s)
        if before is not None and stamp_s == before[1]:
            return PoseVerdict.DROP, "pose is not newer than the last"
        self._follow(now_s, stamp_s, before)
        age_s = now_s - stamp_s - self._offset_s
        if age_s > self._parameters.stale_s and not self._steadily_late(now_s, age_s):
            return PoseVerdict.DROP, f"pose is {age_s:.2f} s older than fresh ones are"
        self._late = (float("-inf"), float("-inf"))
        here_s = stamp_s + self._offset_s
        # taken in another order, or the clock was set by less than is noticed
        if here_s <= self.stamp_s:
            return PoseVerdict.DROP, "pose is not newer than the last"
        if not self._gate.passes(here_s):
            return PoseVerdict.THIN_OUT, ""
        self.stamp_s = here_s
        return PoseVerdict.SEND, ""

    def _steadily_late(self, now_s: float, age_s: float) -> bool:
        """A clock that was set while poses were held up: what was held up comes fresher and
        fresher, this does not."""
        if abs(age_s - self._late[1]) > 0.5 * self._STEP_S:
            self._late = (now_s, age_s)
        if now_s - self._late[0] < self._HELD_UP_S:
            return False
        self._offset_s += age_s
        return True

    def _follow(self, now_s: float, stamp_s: float, before: Optional[Tuple[float, float]]) -> None:
        """Keep the difference of the clocks: that of the freshest pose, and a new one where the
        sender's was set."""
        offset_s = now_s - stamp_s
        if before is None:
            self._offset_s = offset_s
            return
        passed_s, advance_s = now_s - before[0], stamp_s - before[1]
        if passed_s < 0.0:  # the receiver's own clock was set: it is no monotonic one
            self._offset_s, self.stamp_s = offset_s, float("-inf")
            self._gate = RateGate(self._parameters.rate_hz, self._EARLY)
            return
        set_back = passed_s < self._CADENCE_S and advance_s < passed_s - self._STEP_S
        if set_back:
            self._offset_s = max(offset_s, self.stamp_s + self._LEAST_S - stamp_s)
        else:
            self._offset_s = min(offset_s, self._offset_s + self._CREEP * passed_s)
