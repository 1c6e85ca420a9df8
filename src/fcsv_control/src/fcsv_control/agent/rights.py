# SPDX-License-Identifier: Apache-2.0
"""Who may have a command obeyed: whoever stops a vehicle that is not flown by hand, and one
commander who moves it, while the guardian lets him."""

import math
from typing import Sequence

from fcsv_control.agent.epochs import CalibratedFrame
from fcsv_control.agent.lease import LEASE_S, Lease
from fcsv_control.agent.messages import Instruction, Kind
from fcsv_geometry.vehicles.modes import AGENT, Mode, ModeOwner
from fcsv_geometry.vehicles.thresholds import GUARDIAN_AGE_S

# a commander learns of somebody else's stop a moment after the vehicle, or before it
_MARGIN_S = 0.5


class Rights:
    """``owner``, ``lease`` and ``frame`` are told what is heard of modes, commanders and the
    odometry's epochs."""

    def __init__(self, vehicle: str, needs_guardian: bool = False):
        self._vehicle, self._needs_guardian = vehicle, needs_guardian
        self.guardian_s = -math.inf  # when it was heard last
        self.owner, self.lease, self.frame = ModeOwner(AGENT), Lease(), CalibratedFrame()
        self._stopped_s, self._stopped_by = -math.inf, ""
        self._chosen_s = -math.inf  # when somebody else's mode came up
        self.guarded = ""  # why the guardian flies, "" where it does not
        self.aside = False  # out of the way of one that comes down: then nobody stops it there
        self.forbidden: Sequence[str] = ()  # why the guardian forbids to hand the vehicle over

    @property
    def by_hand(self) -> str:
        """The mode in which somebody else flies it; "": nobody else does."""
        owner = self.owner
        ours = not owner.armed or owner.ours or owner.mode == Mode.GUIDED
        return "" if ours else owner.mode

    def shows(self, now_s: float, mode: Mode, armed: bool) -> None:
        """The mode that the vehicle shows: what was ordered before a pilot chose it does not count
        any more, however late the radio brings it."""
        if self.owner.shows(mode, armed):
            self._chosen_s = now_s

    def stopped(self, now_s: float, sender: str) -> None:
        """A command to stop was obeyed: what others ordered before does not count any more."""
        self._stopped_s, self._stopped_by = now_s, sender

    def refusal(self, now_s: float, c: Instruction) -> str:
        """Why a command is not obeyed; "" where it is. A moving command takes or renews the
        lease."""
        if c.stops:
            mode = self.by_hand
            if mode:
                return f"{self._vehicle} is flown by hand ({mode}); tell its pilot"
            return (
                f"{self._vehicle}: its guardian moves it aside: {self.guarded}"
                if self.aside
                else ""
            )
        if not c.moves:
            return ""
        if c.sender != self._stopped_by and c.ordered_s < self._stopped_s + _MARGIN_S:
            return f"{self._vehicle} was stopped by {self._stopped_by} after this was ordered"
        if c.ordered_s < self._chosen_s:
            return f"{self._vehicle}: {self.owner.mode} was chosen on it after this was ordered"
        mode = self.by_hand
        if c.to_guided and mode and not Mode(mode).gives_back:
            return f"{self._vehicle} is flown by hand ({mode}); its pilot gives it back by LOITER"
        holder = self.lease.request(now_s, c.sender)
        if holder:
            return (
                f"{self._vehicle} is commanded by {holder}; end it, or wait until it is silent for {LEASE_S:g} s: "
                "LAND, BRAKE and HOLD are obeyed from anybody"
            )
        if c.to_guided and self.frame.outdated:
            return f"{self._vehicle}: {self.frame.outdated}"
        return self._guardians(now_s, c)

    def _guardians(self, now_s: float, c: Instruction) -> str:
        if self.guarded and c.kind in (Kind.GOTO, Kind.TAKEOFF):
            return f"{self._vehicle}: the guardian flies: {self.guarded}"
        hands_over = c.to_guided or (c.kind is Kind.ARM and c.flag)
        silent = now_s - self.guardian_s > GUARDIAN_AGE_S.agent.red
        if hands_over and self._needs_guardian and silent:
            return f"{self._vehicle}: its guardian is not heard; start it before vehicles are handed over"
        if self.forbidden and hands_over:
            return f"{self._vehicle}: the guardian forbids it: {'; '.join(self.forbidden)}"
        return ""
