# SPDX-License-Identifier: Apache-2.0
"""Whose the vehicles' modes are, as the mission can tell.

A mode that the mission did not ask for is somebody else's decision: the pilot's, the guardian's or
the autopilot's. The mission then sends no mode and no way-point until the vehicle is given back and
the operator confirms it.
"""

from typing import Dict, List, Sequence, Set

from fcsv_control.mission.snapshot import Snapshot
from fcsv_geometry.vehicles.modes import MISSION, Mode, ModeOwner


class FleetModes:
    """A ModeOwner for each vehicle, and what follows for pilots and operator."""

    def __init__(self, vehicles: Sequence[str]):
        self._owners = {name: ModeOwner(MISSION) for name in vehicles}
        self._lost: Set[str] = set()  # vehicles without a position

    @property
    def taken(self) -> Dict[str, Mode]:
        """The mode that somebody else chose after the mission had flown it, by vehicle."""
        return {n: owner.mode for n, owner in self._owners.items() if owner.taken}

    @property
    def ours(self) -> Set[str]:
        """Vehicles that show a mode which the mission asked for."""
        return {n for n, owner in self._owners.items() if owner.ours}

    def asked(self, name: str, mode: Mode) -> None:
        """The mission asks for a mode."""
        self._owners[name].asked(mode)

    def all_asked(self, mode: Mode) -> None:
        """Somebody on our side has asked for a mode of every vehicle that is ours."""
        for name in self.ours:
            self.asked(name, mode)

    def give_back(self) -> None:
        """The operator has confirmed: the mission may ask for modes again. Who is in GUIDED is ours
        from now on."""
        for owner in self._owners.values():
            owner.give_back()

    @property
    def all_given_back(self) -> bool:
        """Whether every vehicle that was taken shows a mode in which pilots give back, and has a
        position."""
        return all(mode.gives_back and n not in self._lost for n, mode in self.taken.items())

    def problems(self) -> List[str]:
        """A line for each vehicle that somebody else has, and what to do."""
        return [
            f"{n}: {mode} was not asked for by the mission; {self._then(n, mode)}"
            for n, mode in self.taken.items()
        ]

    def _then(self, name: str, mode: Mode) -> str:
        """What its pilot is to do. Without a position LOITER and GUIDED would fly after a wrong
        one."""
        if name in self._lost:
            return "it lost its position: land it in ALT_HOLD, or abort"
        if mode.gives_back:
            return "confirm 'resume'"
        return "give it back in LOITER or GUIDED, or abort"

    def take_over(self, taken: Dict[str, str]) -> None:
        """Takes the fleet over after a restart: GUIDED was asked for, and ``taken`` was in a
        pilot's hands. Any other mode is a pilot's."""
        for name, owner in self._owners.items():
            owner.take_over()
            if name in taken:
                owner.mark_taken(Mode(taken[name]))

    def may_be_asked(self, name: str, mode: Mode) -> bool:
        """Whether a vehicle that shows ``mode`` may be asked for another one. If not, somebody else
        has it: a pilot may have taken it before the mission had asked for anything."""
        owner = self._owners[name]
        if not (mode.gives_back or owner.ours or owner.waits):
            owner.mark_taken(mode)
        return not owner.taken

    def show(self, snapshot: Snapshot) -> None:
        """What modes tell."""
        self._lost = {name for name, view in snapshot.vehicles.items() if view.lost}
        for name, view in snapshot.vehicles.items():
            heard = view.state_age_s < float("inf")
            if heard and (view.mode or not view.armed):
                self._owners[name].shows(view.mode, view.armed)
