# SPDX-License-Identifier: Apache-2.0
"""Holds vehicles where they are, but never beneath one that comes down."""

from typing import Dict, Optional, Sequence

from fcsv_control.mission import clearing
from fcsv_control.mission.journey import go_to
from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot

_CALM_MPS = 0.3


class Holding:
    """One pause. Each vehicle is told once, and again where it refused or did not hear."""

    def __init__(self, outbox: Outbox, separation_m: float):
        self._outbox = outbox
        self._clear_m = clearing.clearance_m(separation_m)
        self._orders: Dict[str, Order] = {}
        self._dodging: Dict[str, Order] = {}

    @property
    def done(self) -> bool:
        """Whether all that were told have acknowledged."""
        return all(o.done for o in [*self._orders.values(), *self._dodging.values()])

    @staticmethod
    def calm(snapshot: Snapshot, names: Sequence[str]) -> bool:
        """Whether all of these stand."""
        return all(snapshot.vehicles[n].speed_mps < _CALM_MPS for n in names)

    def step(self, snapshot: Snapshot, names: Sequence[str]) -> None:
        """Hold these vehicles, which are in GUIDED; one that another comes down upon is sent aside."""
        for name in names:
            upper = clearing.coming_down_on(snapshot, name, self._clear_m)
            if upper is not None:
                self._dodge(snapshot, name, upper)
            elif name not in self._dodging and _to_be_told(self._orders.get(name)):
                self._orders[name] = self._outbox.order(snapshot.now_s, name, "HOLD")

    def _dodge(self, snapshot: Snapshot, name: str, upper: str) -> None:
        if _to_be_told(self._dodging.get(name)):
            self._orders.pop(name, None)
            place = clearing.aside(snapshot, name, upper, self._clear_m)
            self._dodging[name] = go_to(self._outbox, snapshot, name, place)


def _to_be_told(order: Optional[Order]) -> bool:
    return order is None or order.failed
