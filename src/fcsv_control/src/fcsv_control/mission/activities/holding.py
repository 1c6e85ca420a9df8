# SPDX-License-Identifier: Apache-2.0
"""Holds vehicles where they are, but never beneath one that comes down."""

from typing import Dict, Optional, Sequence

from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways import clearing
from fcsv_control.mission.ways.journey import go_to
from fcsv_geometry.streams.stream import Since

_CALM_MPS, _CALM_S = 0.3, 1.0
_LONGEST_S = 8.0  # nobody is waited for longer than this: one that is silent, or swings in gusts


class Holding:
    """One pause. Each vehicle is told once, and again where it refused or did not hear.
    ``restarted``: it is not known what they were told before, so it is not over until all have
    acknowledged it."""

    def __init__(self, outbox: Outbox, separation_m: float, restarted: bool = False):
        self._outbox, self._restarted = outbox, restarted
        self._clear_m = clearing.clearance_m(separation_m)
        self._orders: Dict[str, Order] = {}
        self._dodging: Dict[str, Order] = {}
        self._over, self._calm = Since(), Since()

    @property
    def why(self) -> str:
        """Says, in words, what is waited for."""
        return "taken over after a restart: all hold" if self._restarted else "all come to a stand"

    @property
    def done(self) -> bool:
        """Whether all that were told have acknowledged."""
        return all(o.done for o in [*self._orders.values(), *self._dodging.values()])

    def step(self, snapshot: Snapshot, names: Sequence[str]) -> None:
        """Hold these vehicles, which are in GUIDED; one that another comes down upon is sent
        aside."""
        self._over.end()
        self._order_holds(snapshot, names)

    def over(self, snapshot: Snapshot, names: Sequence[str]) -> bool:
        """Nothing asks for it any more: whether these may move again, as all have stood for a
        second. A way that began in the middle of a stop, or as one swings back to where it was told
        to hold, is not the one that was planned."""
        over_s = self._over.lasts_s(snapshot.now_s)
        self._order_holds(snapshot, names)
        stood = self.stood(snapshot, names)
        self._restarted = self._restarted and not self.done
        return not self._restarted and (stood or over_s > _LONGEST_S)

    def stood(self, snapshot: Snapshot, names: Sequence[str]) -> bool:
        """Whether all of these have been calm for a second: who swings is so for a moment, too."""
        calm = all(snapshot.vehicles[n].speed_mps < _CALM_MPS for n in names)
        return self._calm.lasts_s(snapshot.now_s, calm) >= _CALM_S - 1e-6

    def _order_holds(self, snapshot: Snapshot, names: Sequence[str]) -> None:
        for name in names:
            upper = clearing.coming_down_on(snapshot, name, self._clear_m)
            if upper is not None:
                self._dodge(snapshot, name, upper)
            elif name not in self._dodging and _needs_order(self._orders.get(name)):
                self._orders[name] = self._outbox.order(snapshot.now_s, name, "HOLD")

    def _dodge(self, snapshot: Snapshot, name: str, upper: str) -> None:
        if _needs_order(self._dodging.get(name)):
            self._orders.pop(name, None)
            place = clearing.aside(snapshot, name, upper, self._clear_m)
            self._dodging[name] = go_to(self._outbox, snapshot, name, place)


def _needs_order(order: Optional[Order]) -> bool:
    return order is None or order.failed
