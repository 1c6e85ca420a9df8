# SPDX-License-Identifier: Apache-2.0
"""The autopilot's own words. Times are monotonic and arguments."""

from typing import Dict, List

_PREARM = "PreArm: "
_SAID_TOGETHER_S = 5.0  # all reasons that stand are said in one go, every 30 s
_OLD_S = 70.0  # one repetition may get lost


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
