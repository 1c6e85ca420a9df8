# SPDX-License-Identifier: Apache-2.0
"""Numbered commands on their way: repeated until acknowledged, never after they expire."""

from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional

_REPEAT_S = 0.3
_RECORDING = {"RECORD"}  # all other kinds move the vehicle


@dataclass
class Order:
    """A command to one vehicle; ``outcome`` is None under way, "" when done, else why not."""

    vehicle: str
    kind: str
    arguments: Dict[str, Any]
    number: int
    ordered_s: float
    expires_s: float
    outcome: Optional[str] = None
    last_sent_s: float = field(default=float("-inf"))

    @property
    def done(self) -> bool:
        return self.outcome == ""

    @property
    def failed(self) -> bool:
        return bool(self.outcome)


class Outbox:
    """Orders of one sender. A newer order replaces an older open one of the same sort: a late
    repetition of a way-point must not undo the hold that came after it."""

    def __init__(self, lifetime_s: float = 5.0):
        self._lifetime_s = lifetime_s
        self._number = 0
        self._open: Dict[int, Order] = {}

    def order(self, now_s: float, vehicle: str, kind: str, **arguments) -> Order:
        """A new order; sent by the next due()."""
        for older in list(self._open.values()):
            if older.vehicle == vehicle and (older.kind in _RECORDING) == (kind in _RECORDING):
                self._close(older, "replaced by a newer command")
        self._number += 1
        order = Order(vehicle, kind, arguments, self._number, now_s, now_s + self._lifetime_s)
        self._open[order.number] = order
        return order

    def withdraw(self, why: str) -> None:
        """No order that moves a vehicle is sent again."""
        for order in [o for o in self._open.values() if o.kind not in _RECORDING]:
            self._close(order, why)

    def due(self, now_s: float) -> List[Order]:
        """Orders to publish now, again where no acknowledgement came."""
        for order in list(self._open.values()):
            if now_s > order.expires_s:
                self._close(order, f"{order.vehicle} did not acknowledge {order.kind} in time")
        due = [o for o in self._open.values() if now_s - o.last_sent_s >= _REPEAT_S]
        for order in due:
            order.last_sent_s = now_s
        return due

    def acknowledged(self, vehicle: str, number: int, outcome: str) -> None:
        """An acknowledgement came: "" when done, else the reason."""
        order = self._open.get(number)
        if order is not None and order.vehicle == vehicle:
            self._close(order, outcome)

    def _close(self, order: Order, outcome: str) -> None:
        order.outcome = outcome
        del self._open[order.number]
