# SPDX-License-Identifier: Apache-2.0
"""Values with the time at which they came, rates, and the autopilot's own words. Times are
monotonic and arguments."""

from collections import deque
from typing import Deque, Dict, Generic, List, Optional, TypeVar

T = TypeVar("T")
_PREARM = "PreArm: "
_SAID_TOGETHER_S = 5.0  # all reasons that stand are said in one go, every 30 s
_OLD_S = 70.0  # one repetition may get lost


class LineStream(Generic[T]):
    """The newest value of something, and when it came."""

    def __init__(self) -> None:
        self.value: Optional[T] = None
        self.at_s = float("-inf")

    def tell(self, now_s: float, value: T) -> None:
        """It came now."""
        self.value, self.at_s = value, now_s

    def fresh(self, now_s: float, most_s: float) -> bool:
        """Whether it came within the last ``most_s``."""
        return now_s - self.at_s <= most_s


class MessageRate:
    """Messages per second over the last ``window_s``.

    >>> rate = MessageRate(2.0)
    >>> for k in range(60):
    ...     rate.tick(k / 30.0)
    >>> rate.hz(1.99), rate.hz(9.0)
    (30.0, 0.0)
    """

    def __init__(self, window_s: float):
        self._window_s = window_s
        self._times_s: Deque[float] = deque()

    def tick(self, now_s: float) -> None:
        """One came."""
        self._times_s.append(now_s)
        self._forget(now_s)

    def hz(self, now_s: float) -> float:
        """Now."""
        self._forget(now_s)
        return len(self._times_s) / self._window_s

    def _forget(self, now_s: float) -> None:
        while self._times_s and self._times_s[0] < now_s - self._window_s:
            self._times_s.popleft()


class PreArmTexts:
    """Why the autopilot does not arm, in its own words; those that it no longer repeats are
    forgotten.

    >>> texts = PreArmTexts()
    >>> for at_s, text in ((0.0, "PreArm: RC not found"), (0.1, "PreArm: VisOdom: not healthy"), (0.2, "Ready")):
    ...     texts.add(at_s, text)
    >>> texts.now(1.0)
    ['RC not found', 'VisOdom: not healthy']
    >>> texts.add(30.1, "PreArm: VisOdom: not healthy")
    >>> texts.now(30.2), texts.now(120.0)
    (['VisOdom: not healthy'], [])
    """

    def __init__(self) -> None:
        self._at_s: Dict[str, float] = {}

    def add(self, now_s: float, text: str) -> None:
        """A status text; those that are no reason are passed over."""
        if text.startswith(_PREARM):
            self._at_s[text[len(_PREARM) :]] = now_s

    def now(self, now_s: float) -> List[str]:
        """The reasons that stand, in the order in which they began."""
        newest_s = max(self._at_s.values(), default=float("-inf"))
        since_s = max(newest_s - _SAID_TOGETHER_S, now_s - _OLD_S)
        self._at_s = {text: at_s for text, at_s in self._at_s.items() if at_s >= since_s}
        return list(self._at_s)
