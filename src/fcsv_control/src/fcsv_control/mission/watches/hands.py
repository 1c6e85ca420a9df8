# SPDX-License-Identifier: Apache-2.0
"""Whose hands a vehicle is in, as the mission can tell: by its mode, and by the modes that the
mission asked for.

A mode that the mission did not ask for is somebody else's decision: the pilot's, the guardian's or
the autopilot's. The mission then sends no mode and no way-point until the vehicle is given back and
the operator confirms it.
"""

from typing import Dict, List, Sequence, Set

from fcsv_control.mission.snapshot import Snapshot

#: Modes in which a pilot gives a vehicle back.
GIVEN_BACK = ("GUIDED", "LOITER")


class MissionModeOwner:
    """``taken`` tells by vehicle the mode that somebody else chose after the mission had flown
    it."""

    def __init__(self):
        self.taken: Dict[str, str] = {}
        self._asked: Dict[str, str] = {}  # modes that were asked for and do not show yet
        self._before: Dict[str, str] = {}  # and the modes from which
        self._ours: Dict[str, str] = {}  # modes that show and were asked for
        self._lost: Set[str] = set()  # vehicles without a position

    def asked(self, name: str, mode: str, now: str) -> None:
        """The mission asks for a mode while the vehicle shows ``now``."""
        self._asked[name], self._before[name] = mode, now

    def all_asked(self, mode: str) -> None:
        """Somebody on our side has asked for a mode of every vehicle that is ours."""
        for name, now in self._ours.items():
            self.asked(name, mode, now)

    def give_back(self) -> None:
        """The operator has confirmed: the mission may ask for modes again. Who is in GUIDED is ours
        from now on."""
        for name, mode in self.taken.items():
            if mode == "GUIDED":
                self._ours[name] = mode
        self.taken = {}

    @property
    def all_given_back(self) -> bool:
        """Whether every vehicle that was taken shows a mode in which pilots give back, and has a
        position."""
        return all(
            mode in GIVEN_BACK and name not in self._lost for name, mode in self.taken.items()
        )

    def problems(self) -> List[str]:
        """A line for each vehicle that somebody else has, and what to do."""
        return [
            f"{n}: {mode} was not asked for by the mission; {self._then(n)}"
            for n, mode in self.taken.items()
        ]

    def _then(self, name: str) -> str:
        """What its pilot is to do. Without a position LOITER and GUIDED would fly after a wrong
        one."""
        if name in self._lost:
            return "it lost its position: land it in ALT_HOLD, or abort"
        return (
            "confirm 'resume'"
            if self.taken[name] in GIVEN_BACK
            else "give it back in LOITER or GUIDED, or abort"
        )

    def take_over(self, vehicles: Sequence[str], taken: Dict[str, str]) -> None:
        """Takes vehicles over after a restart: GUIDED was asked for, and ``taken`` was in a pilot's
        hands. Any other mode is a pilot's."""
        self._ours = dict.fromkeys(vehicles, "GUIDED")
        self.taken = dict(taken)

    def ours(self) -> Set[str]:
        """Vehicles that show a mode which the mission asked for."""
        return set(self._ours)

    def may_be_asked(self, name: str, mode: str) -> bool:
        """Whether a vehicle that shows ``mode`` may be asked for another one. If not, somebody else
        has it: a pilot may have taken it before the mission had asked for anything."""
        if mode not in GIVEN_BACK and name not in self._ours and name not in self._asked:
            self.taken[name] = mode
        return name not in self.taken

    def see(self, snapshot: Snapshot) -> None:
        """What modes tell."""
        self._lost = {name for name, view in snapshot.vehicles.items() if view.lost}
        for name, view in snapshot.vehicles.items():
            if view.state_age_s == float("inf"):
                continue  # never heard
            if not view.armed:
                for known in (self.taken, self._asked, self._ours):
                    known.pop(name, None)
            elif view.mode:
                self._see(name, view.mode)

    def _see(self, name: str, mode: str) -> None:
        if name in self.taken:
            self.taken[name] = mode
        elif mode == self._asked.get(name):
            self._ours[name] = self._asked.pop(name)
        elif name in self._asked and mode == self._before[name]:
            pass  # the order is on its way
        elif name in self._asked or mode != self._ours.get(name, mode):
            self._asked.pop(name, None)
            self._ours.pop(name, None)
            self.taken[name] = mode
