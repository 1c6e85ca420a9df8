# SPDX-License-Identifier: Apache-2.0
"""What every fault of a rehearsal has: a moment at which it begins, and whom it befalls."""

from typing import Optional

import numpy as np

from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.phases import PHASES
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

#: How long (s) phases in the air last without faults, about; CONFIGURATIONS for each configuration.
_LASTS_S = {
    "TAKE_OFF": 7.0,
    "COLUMN": 5.0,
    "CALIBRATE": 8.0,
    "MOVE_HOME": 5.0,
    "SET_HOME": 1.5,
    "GUIDED": 1.0,
    "CONFIGURATIONS": 12.0,
    "LAND": 8.0,
}
_MOSTLY = "CONFIGURATIONS"  # half of the faults begin there


class Fault:
    """Told of every pass. ``begin`` is called once, in the air, at a moment that the seed draws:
    some time after a phase of the mission began, any phase, or when that phase was over early."""

    name = ""
    changes_nothing = False  # whether nobody may be stopped because of it

    def __init__(self, random: np.random.Generator):
        self._random = random
        self.phase = _MOSTLY if random.random() < 0.5 else str(random.choice(list(_LASTS_S)))
        self._share = float(random.random())
        self._phase_s: Optional[float] = None
        self.began_s: Optional[float] = None
        self.ended = False  # whether all is as it was before it
        self.vehicle: Optional[RehearsedVehicle] = None

    def adapt(self, mission: Mission) -> Mission:
        """The mission that it befalls; most befall any."""
        return mission

    def __call__(self, flight: Flight) -> None:
        if self.began_s is not None:
            self.goes_on(flight, flight.now_s - self.began_s)
        elif flight.invariants.flew and self._due(flight) and self._ready(flight):
            self.began_s, self.vehicle = flight.now_s, self._some(flight)
            flight.witness.begins(flight.now_s, self.name, self.vehicle, self._endangered(flight))
            self.begin(flight, self.vehicle)

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        """It happens, to ``vehicle`` where it happens to one."""
        raise NotImplementedError

    def goes_on(self, flight: Flight, since_s: float) -> None:
        """Some end again."""

    def _due(self, flight: Flight) -> bool:
        now = PHASES.index(flight.phase)
        if now != PHASES.index(self.phase):
            return now > PHASES.index(self.phase)
        self._phase_s = flight.now_s if self._phase_s is None else self._phase_s
        times = len(flight.mission.configurations) if self.phase == _MOSTLY else 1
        return flight.now_s >= self._phase_s + self._share * times * _LASTS_S[self.phase]

    def _ready(self, _flight: Flight) -> bool:
        """Whether it can happen now."""
        return True

    def _some(self, flight: Flight) -> RehearsedVehicle:
        return list(flight.fleet.values())[int(self._random.integers(len(flight.fleet)))]

    def _endangered(self, _flight: Flight) -> Optional[RehearsedVehicle]:
        """Who must answer it, where that is not whom it befalls."""

    def _uniform(self, low: float, high: float) -> float:
        return float(self._random.uniform(low, high))

    def _lasts_s(self, share_for_good: float, low_s: float, high_s: float) -> float:
        """How long it lasts; infinite for ``share_for_good`` of the flights."""
        lasts_s = self._uniform(low_s, high_s)
        return np.inf if self._random.random() < share_for_good else lasts_s
