# SPDX-License-Identifier: Apache-2.0
"""What goes wrong in rehearsals: each fault begins once, at a moment that its flight's seed draws."""

from typing import Callable, Dict, List, Optional

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.people.operator import Sight, Sticks
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

_LATEST_S = 95.0  # after take-off: about as long as the demo's mission flies


class Fault:
    """Told of every pass; ``begin`` is called once, ``_LATEST_S`` after take-off at the latest."""

    name = ""

    def __init__(self, random: np.random.Generator):
        self._random = random
        self._after_s = float(random.uniform(0.0, _LATEST_S))
        self._up_s: Optional[float] = None
        self.began_s: Optional[float] = None

    def __call__(self, flight: Flight) -> None:
        if self._up_s is None:
            self._up_s = flight.now_s if flight.invariants.flew else None
        elif self.began_s is None and flight.now_s >= self._up_s + self._after_s:
            self.began_s = flight.now_s
            self.begin(flight, self._some(flight))
        elif self.began_s is not None:
            self.goes_on(flight, flight.now_s - self.began_s)

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        """It happens, to ``vehicle`` where it happens to one."""
        raise NotImplementedError

    def goes_on(self, flight: Flight, since_s: float) -> None:
        """Some end again."""

    def _some(self, flight: Flight) -> RehearsedVehicle:
        return list(flight.fleet.values())[int(self._random.integers(len(flight.fleet)))]


class TrackerGone(Fault):
    """No sample any more; in one of two flights it comes back after 0.3 to 5 s."""

    name = "tracker gone"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._vehicle = vehicle
        self._lasts_s = float(self._random.uniform(0.3, 5.0)) if self._random.random() < 0.5 else np.inf
        vehicle.tracker_on = False

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._lasts_s:
            self._vehicle.tracker_on = True


class TrackerFrozen(Fault):
    """The same pose again and again with fresh stamps, as a T265 that looks down is known for."""

    name = "tracker frozen"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        last = vehicle.tracker.odometry
        frozen: List = []

        def odometry(stamp_s, T_world_body):
            if not frozen:
                frozen.append((last(stamp_s, T_world_body)[0], np.zeros(3), np.zeros(3)))
            return frozen[0]

        vehicle.tracker.odometry = odometry


class TrackerDrifts(Fault):
    """The position runs away at 0.2 to 9 m/s."""

    name = "tracker drifts"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        true, begun = vehicle.tracker.odometry, []
        speed = float(np.exp(self._random.uniform(np.log(0.2), np.log(9.0))))
        way = self._random.normal(size=3) * [1.0, 1.0, 0.3]
        v = speed * way / np.linalg.norm(way)

        def odometry(stamp_s, T_world_body):
            begun or begun.append(stamp_s)
            T, linear, angular = true(stamp_s, T_world_body)
            return transforms.transform(T[:3, :3], T[:3, 3] + v * (stamp_s - begun[0])), linear, angular

        vehicle.tracker.odometry = odometry


class TrackerJumps(Fault):
    """A step of 0.3 to 30 m."""

    name = "tracker jumps"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        true = vehicle.tracker.odometry
        way = self._random.normal(size=3)
        step = way / np.linalg.norm(way) * np.exp(self._random.uniform(np.log(0.3), np.log(30.0)))

        def odometry(stamp_s, T_world_body):
            T, linear, angular = true(stamp_s, T_world_body)
            return transforms.transform(T[:3, :3], T[:3, 3] + step), linear, angular

        vehicle.tracker.odometry = odometry


class RadioCut(Fault):
    """A vehicle's radio is dead for 1 to 40 s, or for good; or all radios are."""

    name = "radio cut"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._radios = list(flight.radios.values()) if self._random.random() < 0.3 else [flight.radios[vehicle.name]]
        self._lasts_s = float(self._random.uniform(1.0, 40.0)) if self._random.random() < 0.7 else np.inf
        for radio in self._radios:
            radio.cut = True

    def goes_on(self, flight: Flight, since_s: float) -> None:
        for radio in self._radios:
            radio.cut = since_s < self._lasts_s


class ClockSteps(Fault):
    """A vehicle's clock is set by 0.4, 2 or 60 s."""

    name = "clock steps"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.clock_offset_s = float(self._random.choice([-60.0, -2.0, -0.4, 0.4, 2.0, 60.0]))


class Battery(Fault):
    """A battery that is low, empty, or whose share is not known."""

    name = "battery"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.battery_share[vehicle.name] = float(self._random.choice([0.15, 0.05, np.nan]))


class PilotTakesOver(Fault):
    """A pilot switches to a mode of his and hovers; in two of three flights he gives it back after 5 to 20 s."""

    name = "pilot takes over"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self.vehicle, self.mode = vehicle, str(self._random.choice(["LOITER", "ALT_HOLD", "LAND", "BRAKE"]))
        self._back_s = float(self._random.uniform(5.0, 20.0)) if self._random.random() < 0.67 else np.inf
        self.given_back = False
        flight.hands[vehicle.name] = self._hands

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._back_s and not self.given_back:
            self.given_back = True
            del flight.hands[self.vehicle.name]

    def _hands(self, _now_s: float, phase: str, _sight: Sight) -> Sticks:
        if phase in ("LAND", "DONE", "ABORTED"):
            return Sticks(mode="LAND")
        return Sticks(mode=self.mode)


class Aborted(Fault):
    """The operator presses abort."""

    name = "abort"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.machine.abort("aborted by the operator: landing")


#: By name.
FAULTS: Dict[str, Callable[[np.random.Generator], Fault]] = {
    f.name: f
    for f in (
        TrackerGone,
        TrackerFrozen,
        TrackerDrifts,
        TrackerJumps,
        RadioCut,
        ClockSteps,
        Battery,
        PilotTakesOver,
        Aborted,
    )  # fmt: skip
}
