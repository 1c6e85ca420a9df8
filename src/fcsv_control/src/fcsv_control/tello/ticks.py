# SPDX-License-Identifier: Apache-2.0
"""When a record of a Tello's log was measured: its tick, on this computer's clock.

The radio only ever delays. The clocks' difference is that of the quickest packets; it may grow
slowly, as clocks run apart.
"""

from typing import Optional

TICKS_PER_S = 2344062.0  # as recorded from a real Tello (tellopy's repository)
_WRAPS = 1 << 32
_CREEP = 1e-3  # s per s: how much faster or slower its clock may be
# ticks and arrivals disagree by more: it was switched on again, or the record is damaged
_APART_S = 0.5


class TickClock:
    """``stamp_s`` of each record, in the order of their arrival."""

    def __init__(self):
        self._tick: Optional[int] = None
        self._now_s = self._drone_s = self._apart_s = 0.0

    def stamp_s(self, now_s: float, tick: int) -> float:
        """Gives the stamp on the clock of ``now_s``, the time of arrival: not after it, and at most
        half a second before it.

        >>> clock = TickClock()
        >>> came = [(10.0, 1.0), (10.3, 1.1), (10.32, 1.3)]
        >>> [round(clock.stamp_s(now_s, int(s * TICKS_PER_S)), 3) for now_s, s in came]
        [10.0, 10.1, 10.3]
        """
        if self._tick is None:
            return self._begin(now_s, tick)
        step_s = (((tick - self._tick) + _WRAPS // 2) % _WRAPS - _WRAPS // 2) / TICKS_PER_S
        arrived_s = now_s - self._now_s
        drone_s = self._drone_s + step_s
        apart_s = min(self._apart_s + _CREEP * max(arrived_s, 0.0), now_s - drone_s)
        if (
            step_s < 0.0
            or abs(step_s - arrived_s) > _APART_S
            or now_s - (drone_s + apart_s) > _APART_S
        ):
            return self._begin(now_s, tick)
        self._tick, self._now_s, self._drone_s, self._apart_s = tick, now_s, drone_s, apart_s
        return drone_s + apart_s

    def _begin(self, now_s: float, tick: int) -> float:
        self._tick, self._now_s, self._drone_s, self._apart_s = tick, now_s, 0.0, now_s
        return now_s
