# SPDX-License-Identifier: Apache-2.0
"""Vehicles that drop out of a list in flight: who is down takes no part any more, and the others
can go on."""

import dataclasses
from typing import List, Sequence, Set

from fcsv_control.mission.snapshot import Snapshot


class Dropouts:
    """``out``: who dropped out. The reference cannot, and neither can the last one that has
    something left to fly, nor one that has lost its position: nobody knows where it lies, and
    guardians keep their vehicles away from it."""

    def __init__(self, reference: str, vehicles: Sequence[str]):
        self._movers = [n for n in vehicles if n != reference]
        self.out: Set[str] = set()

    def update(self, snapshot: Snapshot, working: Sequence[str]) -> List[str]:
        """Those that are down since the last step. ``working``: those with configurations left to
        fly."""
        down = [n for n in self._movers if n not in self.out and snapshot.vehicles[n].down]
        lost = any(snapshot.vehicles[n].lost for n in down)
        if not down or lost or not set(working) - set(down):
            return []
        self.out |= set(down)
        return down

    def without(self, snapshot: Snapshot) -> Snapshot:
        """What is known of those that take part."""
        if not self.out:
            return snapshot
        taking_part = {n: v for n, v in snapshot.vehicles.items() if n not in self.out}
        return dataclasses.replace(snapshot, vehicles=taking_part)

    def problems(self, snapshot: Snapshot) -> List[str]:
        """Who dropped out and flies again is in nobody's plan."""
        return [
            f"{n}: dropped out and flies again: land it"
            for n in self._movers
            if n in self.out and snapshot.vehicles[n].armed
        ]
