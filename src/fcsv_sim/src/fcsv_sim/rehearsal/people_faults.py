# SPDX-License-Identifier: Apache-2.0
"""Pilots and operators who do what nobody expects."""

import numpy as np

from fcsv_sim.people.operator import Sight, Sticks
from fcsv_sim.rehearsal.fault import Fault
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.hands import HandsOn
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

_ENDS = ("LAND", "DONE", "ABORTED")
_TOLD_S = 3.0  # after which a pilot who is told to land does
_PATIENCE_S = 120.0  # who got no word for so long lands


class PilotTakesOver(Fault):
    """A pilot switches to a mode of his and hovers; in two of three flights he gives it back after 5 to 20 s."""

    name = "pilot takes over"
    modes = ("LOITER", "ALT_HOLD", "LAND", "BRAKE")
    _roams = _drops = False

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self.mode = str(self._random.choice(self.modes))
        self._until_s = self._lasts_s(0.33, 5.0, 20.0)
        self._hands_on = HandsOn(self.mode, vehicle.p_world_m, self._random, self._roams, self._drops)
        self._told_s = np.inf
        self._mine, self._pilot = self._hands, flight.pilots[vehicle.name]
        flight.hands[vehicle.name] = self._mine

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._until_s and not self.ended:
            self.ended = True
            if flight.hands.get(self.vehicle.name) is self._mine:
                del flight.hands[self.vehicle.name]

    def _hands(self, now_s: float, phase: str, sight: Sight) -> Sticks:
        if phase in _ENDS:
            self._told_s = min(self._told_s, now_s)
        if now_s > self._told_s + _TOLD_S or now_s > self.began_s + _PATIENCE_S:
            return self._pilot.land_by_hand(now_s, sight)
        return self._hands_on.sticks(now_s - self.began_s, sight)


class PilotDisobeys(PilotTakesOver):
    """Any mode, any time; he flies about a little, or pulls the throttle down as he takes over."""

    name = "pilot disobeys"
    modes = ("STABILIZE", "ALT_HOLD", "LOITER", "LAND", "BRAKE")

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._roams, self._drops = (bool(self._random.random() < 0.5) for _ in range(2))
        super().begin(flight, vehicle)


class Aborted(Fault):
    """The operator presses abort."""

    name = "abort"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.machine.abort("aborted by the operator: landing")


PEOPLE_FAULTS = (PilotTakesOver, PilotDisobeys, Aborted)
