# SPDX-License-Identifier: Apache-2.0
"""Offset between two machines' clocks from exchanges of messages (NTP, RFC 5905 section 8)."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Deque, Optional, Tuple

_CLOCK_SET_S = 0.5  # an exchange that contradicts all before it by more: one of the clocks was set


@dataclass(frozen=True)
class ClockOffset:
    """How far the other clock is ahead (s); the true offset is within ``uncertainty_s`` of it for
    sure."""

    stamp_s: float
    offset_s: float
    uncertainty_s: float

    @property
    def least_s(self) -> float:
        """How far the clocks are apart for sure; under 0 where they may agree."""
        return abs(self.offset_s) - self.uncertainty_s

    def beyond(self, bound_s: float) -> bool:
        """Whether the clocks differ by more than a bound, for sure."""
        return self.least_s > bound_s


@dataclass(frozen=True)
class VehicleClock:
    """How far a vehicle's clock is ahead of this machine's."""

    vehicle: str
    offset: ClockOffset


class ClockExchange:
    """Keeps the newest exchanges with one machine; the one with the shortest round trip is the best
    of them."""

    def __init__(self, keep: int = 20, most_round_trip_s: float = 2.0):
        self._exchanges: Deque[ClockOffset] = deque(maxlen=keep)
        self._most_round_trip_s = most_round_trip_s
        self.rejected = 0

    def add(self, sent_s: float, received_s: float, answered_s: float, returned_s: float) -> bool:
        """One exchange: sent and returned by our clock, received and answered by the other's; False
        where it is none.

        >>> exchange = ClockExchange()
        >>> exchange.add(10.0, 10.52, 10.53, 10.05)  # 20 ms there, 20 ms back
        True
        >>> round(exchange.offset().offset_s, 6), round(exchange.offset().uncertainty_s, 6)
        (0.5, 0.02)
        """
        stamps = (sent_s, received_s, answered_s, returned_s)
        round_trip_s = (returned_s - sent_s) - (answered_s - received_s)
        sane = all(math.isfinite(s) and s > 0 for s in stamps) and answered_s >= received_s
        if not sane or not 0.0 <= round_trip_s <= self._most_round_trip_s:
            self.rejected += 1
            return False
        offset_s = 0.5 * ((received_s - sent_s) + (answered_s - returned_s))
        newest = ClockOffset(returned_s, offset_s, 0.5 * round_trip_s)
        if self._exchanges and all(
            abs(e.offset_s - offset_s) > _CLOCK_SET_S for e in self._exchanges
        ):
            self._exchanges.clear()
        self._exchanges.append(newest)
        return True

    def offset(self) -> Optional[ClockOffset]:
        """The best of what is kept, with the newest's stamp; None before the first exchange."""
        if not self._exchanges:
            return None
        best = min(self._exchanges, key=lambda e: e.uncertainty_s)
        return ClockOffset(self._exchanges[-1].stamp_s, best.offset_s, best.uncertainty_s)


def in_words(vehicle: str, offset: ClockOffset) -> str:
    """One line for the operator."""
    direction = "ahead of" if offset.offset_s > 0 else "behind"
    return f"{vehicle}'s clock is {abs(offset.offset_s):.3f} s {direction} the control PC's: start chrony on {vehicle}"


def difference(a: Optional[ClockOffset], b: Optional[ClockOffset]) -> Optional[Tuple[float, float]]:
    """Offset and uncertainty (s) between two vehicles; None where either is not known."""
    if a is None or b is None:
        return None
    return a.offset_s - b.offset_s, a.uncertainty_s + b.uncertainty_s
