# SPDX-License-Identifier: Apache-2.0
"""Asks vehicles for GUIDED, again where they refuse."""

from typing import Dict, Sequence

from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.watches.fleet_modes import FleetModes
from fcsv_geometry.vehicles.modes import Mode

# a heartbeat a second tells the mode: so long after the acknowledgement it must show
_MODE_SHOWS_S = 2.0


class Handover:
    """One handing over. ``detail`` says who refuses and why."""

    def __init__(self, outbox: Outbox, modes: FleetModes):
        self._outbox, self._modes = outbox, modes
        self._orders: Dict[str, Order] = {}
        self.detail = ""

    def step(self, snapshot: Snapshot, vehicles: Sequence[str]) -> bool:
        """Whether all show GUIDED; who does not is asked."""
        waiting = [n for n in vehicles if snapshot.vehicles[n].mode != Mode.GUIDED]
        for name in waiting:
            if self._modes.may_be_asked(name, snapshot.vehicles[name].mode):
                self._switch(snapshot, name)
        return not waiting

    def _switch(self, snapshot: Snapshot, name: str) -> None:
        now_s, order = snapshot.now_s, self._orders.get(name)
        if order is not None and order.failed:
            self.detail = f"{name} does not go to GUIDED: {order.outcome}"
        unheard = order is not None and order.outcome is None
        if order is None or not (unheard or now_s - order.ordered_s < _MODE_SHOWS_S):
            self._orders[name] = self._outbox.order(now_s, name, "SET_MODE", mode=Mode.GUIDED)
            self._modes.asked(name, Mode.GUIDED)
