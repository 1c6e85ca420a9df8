# SPDX-License-Identifier: Apache-2.0
"""Lands all vehicles that the mission flies, none of them onto another."""

from typing import Dict, List, Optional, Sequence, Set

import numpy as np

from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.watches.fleet_modes import FleetModes
from fcsv_control.mission.ways import clearing
from fcsv_control.mission.ways.journey import go_to
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.vehicles.modes import Mode

_REPEAT_S = 3.0
_ASIDE_REPEAT_S = 1.0
_GUIDED_TRIES = 3  # to take a vehicle that was stopped (BRAKE) aside; then it lands where it is


class Landing:
    """A vehicle that stands above another moves aside first, and so does one that another comes
    down upon; the others land at once. Who is flown by hand is not commanded: its pilot is told to
    land it. Ways aside keep within the mission's fence, where that can be."""

    def __init__(
        self, mission: Mission, vehicles: Sequence[str], outbox: Outbox, modes: FleetModes
    ):
        self._vehicles = list(vehicles)
        self._outbox = outbox
        self._modes, self._mission = modes, mission
        self._clear_m = clearing.clearance_m(mission.min_separation_m)
        self._next_s: Dict[str, float] = dict.fromkeys(vehicles, float("-inf"))
        self._tries: Dict[str, int] = dict.fromkeys(vehicles, 0)
        self._recorders_off: Dict[str, Optional[Order]] = dict.fromkeys(vehicles)
        self._down: Set[str] = set()  # heard with motors off since the landing began
        self.problems: List[str] = []

    def step(self, snapshot: Snapshot) -> bool:
        """Whether every vehicle was heard to be on the ground with motors off."""
        self.problems = []
        for name in self._vehicles:
            self._note_down(snapshot, name)
        flying = [n for n in self._vehicles if snapshot.vehicles[n].armed]
        unheard = [n for n in self._vehicles if n not in self._down and n not in flying]
        self.problems += [
            f"{n}: not heard; see whether it flies, and land it by hand" for n in unheard
        ]
        for name, view in snapshot.vehicles.items() if flying else ():
            if view.lost and not view.armed:
                text = f"{name}: lies within {view.astray_m:.0f} m of where it was known last"
                self.problems.append(f"{text}; who lands by hand looks for it")
        for name in flying:
            self._switch_off(snapshot, name)
            self._land(snapshot, name)
        return not flying and not unheard

    def _within(self, p_home_m: np.ndarray) -> bool:
        return not self._mission.fence.outside(p_home_m, self._mission.home_height_m)

    def _note_down(self, snapshot: Snapshot, name: str) -> None:
        view = snapshot.vehicles[name]
        if view.armed:
            self._down.discard(name)
        elif view.down:
            self._down.add(name)

    def _switch_off(self, snapshot: Snapshot, name: str) -> None:
        order = self._recorders_off[name]
        if order is None or order.failed:
            self._recorders_off[name] = self._outbox.order(
                snapshot.now_s, name, "RECORD", flag=False
            )

    def _land(self, snapshot: Snapshot, name: str) -> None:
        mode = snapshot.vehicles[name].mode
        if mode == Mode.LAND:
            return
        if mode != Mode.GUIDED and name not in self._modes.ours:
            self._tell_the_pilot(snapshot, name, mode)
        elif snapshot.now_s >= self._next_s[name]:
            self._bring_down(snapshot, name)

    def _tell_the_pilot(self, snapshot: Snapshot, name: str, mode: str) -> None:
        under = clearing.below(snapshot, name, self._clear_m)
        where = (
            f"is above {under}: fly it aside, then land it"
            if under
            else "is flown by hand: land it"
        )
        self.problems.append(f"{name} {where} ({mode or 'mode unknown'})")

    def _bring_down(self, snapshot: Snapshot, name: str) -> None:
        in_the_way = clearing.below(snapshot, name, self._clear_m) or clearing.coming_down_on(
            snapshot, name, self._clear_m
        )
        mode = snapshot.vehicles[name].mode
        if in_the_way is not None and mode == Mode.BRAKE and self._tries[name] < _GUIDED_TRIES:
            self._tries[name] += 1
            self._outbox.order(snapshot.now_s, name, "SET_MODE", mode=Mode.GUIDED)
            self._modes.asked(name, Mode.GUIDED)
            self._next_s[name] = snapshot.now_s + _ASIDE_REPEAT_S
        elif in_the_way is not None and mode == Mode.GUIDED:
            place = clearing.aside(snapshot, name, in_the_way, self._clear_m, self._within)
            go_to(self._outbox, snapshot, name, place)
            self._next_s[name] = snapshot.now_s + _ASIDE_REPEAT_S
        else:
            self._outbox.order(snapshot.now_s, name, "LAND")
            self._modes.asked(name, Mode.LAND)
            self._next_s[name] = snapshot.now_s + _REPEAT_S
