# SPDX-License-Identifier: Apache-2.0
"""A verdict on a pair that does not flicker: GO and NO-GO change places only where the other
lasts."""

from dataclasses import replace
from typing import Any, Hashable, Tuple

from fcsv_console.model.stereo import StereoHealth
from fcsv_geometry.streams.stream import Since

HOLD_S = 3.0


class SteadyVerdict:
    """Shows every judgement's figures at once, and its verdict once it has lasted ``hold_s``.

    Another subject or pair begins anew. What could not be judged before is judged at once.
    """

    def __init__(self, hold_s: float = HOLD_S):
        self._hold_s = hold_s
        self._shown: Tuple[Any, StereoHealth] = (None, StereoHealth())
        self._other = Since()

    def at(self, now_s: float, what: Hashable, judged: StereoHealth) -> StereoHealth:
        """What to show at monotonic time ``now_s`` (s) of a judgement of now; ``what``: the subject
        that is judged."""
        subject, (before, shown) = (what, judged.pair, judged.before), self._shown
        same = (judged.judged, judged.go) == (shown.judged, shown.go)
        if same or subject != before or not shown.judged:
            return self._show(subject, judged)
        if self._other.lasts_s(now_s) >= self._hold_s:
            return self._show(subject, judged)
        return replace(judged, go=shown.go, reasons=shown.reasons, judged=shown.judged)

    def _show(self, subject: Any, judged: StereoHealth) -> StereoHealth:
        self._shown = subject, judged
        self._other.end()
        return judged
