# SPDX-License-Identifier: Apache-2.0
"""Machines, processes and radios that fail."""

from dataclasses import replace
from itertools import permutations
from typing import Optional, Tuple

import numpy as np

from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.ground import READY_S
from fcsv_sim.rehearsal.fault import Fault
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

_CLOCK_STEPS_S = (-60.0, -2.0, -0.4, 0.4, 2.0, 60.0)
_ABOVE_M = 1.0  # horizontally nearer than this, and 2 m higher: above another


class RadioCut(Fault):
    """A vehicle's radio is dead for 1 to 40 s, or for good; or all radios are."""

    name = "radio cut"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._radios = (
            list(flight.radios.values())
            if self._random.random() < 0.3
            else [flight.radios[vehicle.name]]
        )
        self._until_s = self._lasts_s(0.3, 1.0, 40.0)
        for radio in self._radios:
            radio.cut = True

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._until_s and not self.ended:
            self.ended = True
            for radio in self._radios:
                radio.cut = False


class RadioLoses(Fault):
    """All radios lose 30 % of the messages, for good."""

    name = "radio loses"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        for radio in flight.radios.values():
            radio.quality = replace(radio.quality, loss=0.3)


class RadioHoldsUp(Fault):
    """A relay on the way keeps what one vehicle, or everybody, sends and is sent for 0.5 to 4 s,
    then delivers it in a burst; again every 4 to 12 s, for good."""

    name = "radio holds up"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._radios = (
            list(flight.radios.values())
            if self._random.random() < 0.3
            else [flight.radios[vehicle.name]]
        )
        self._next_s = flight.now_s
        self.goes_on(flight, 0.0)

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if flight.now_s < self._next_s:
            return
        until_s = flight.now_s + self._uniform(0.5, 4.0)
        self._next_s = flight.now_s + self._uniform(4.0, 12.0)
        for radio in self._radios:
            radio.held_until_s = until_s


class ClockSteps(Fault):
    """A vehicle's clock is set by 0.4, 2 or 60 s. Where a calibration is refused because of it,
    somebody starts chrony as he reads, and the clock is right 10 s later."""

    name = "clock steps"
    changes_nothing = True

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.clock_offset_s = float(self._random.choice(_CLOCK_STEPS_S))
        self._right_s = np.inf

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if flight.control.replied.clocks_apart:
            self._right_s = min(self._right_s, since_s + 10.0)
        if since_s > self._right_s:
            self.vehicle.clock_offset_s = 0.0


class ControlClockSteps(Fault):
    """The control PC's clock is set by 0.4, 2 or 60 s, and set back 5 s later in one of two
    flights."""

    name = "control clock steps"
    changes_nothing = True

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._until_s = self._lasts_s(0.5, 5.0, 5.0)
        flight.control.clock_offset_s = float(self._random.choice(_CLOCK_STEPS_S))

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._until_s and not self.ended:
            self.ended = True
            flight.control.clock_offset_s = 0.0


class Battery(Fault):
    """A battery that is low, empty, or whose share is not known."""

    name = "battery"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.battery_said = float(self._random.choice([0.15, 0.05, np.nan]))
        flight.control.battery_share[vehicle.name] = vehicle.battery_said


class LowBatteryAlone(Fault):
    """A battery is low, and the control PC died just before: nobody but the guardian brings the
    vehicle home."""

    name = "low battery alone"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.die()
        vehicle.battery_said = 0.15


class AgentDies(Fault):
    """The agent's process is killed; nobody starts it again."""

    name = "agent dies"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.agent.kill()


class LinkDies(Fault):
    """The flight link's process is killed; it is started again 2 s later."""

    name = "link dies"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.kill_link()

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > 2.0 and not self.ended:
            self.ended = True
            self.vehicle.link.start(flight.now_s)


class LinkSleeps(Fault):
    """The flight link's process is stopped for 2 to 5 s (SIGSTOP), or a computer that has no time
    for it."""

    name = "link sleeps"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.link.stop()
        self._until_s = self._uniform(2.0, 5.0)

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._until_s and not self.ended:
            self.ended = True
            self.vehicle.link.go_on(flight.now_s)


class MissionDies(Fault):
    """The control PC says and hears nothing any more."""

    name = "mission dies"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.die()


class MissionRestarts(Fault):
    """The mission's process dies; 5 s later a new one runs."""

    name = "mission restarts"
    _remembers = True

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.alive = self._restarted = False

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > 5.0 and not self._restarted:
            self._restarted, self.ended = True, self._remembers
            flight.control.restart(flight.now_s, self._remembers)


class MissionForgets(MissionRestarts):
    """Acts likewise likewise, and its memory is lost or damaged. Where it finds vehicles in GUIDED
    of which it knows nothing, the operator reads so and aborts after 5 to 15 s."""

    name = "mission forgets"
    _remembers = False

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        super().begin(flight, vehicle)
        self._read_s, self._reads_s = np.inf, self._uniform(5.0, 15.0)

    def goes_on(self, flight: Flight, since_s: float) -> None:
        super().goes_on(flight, since_s)
        if self._restarted and not self.ended and flight.control.machine.unexplained:
            self._read_s = min(self._read_s, flight.now_s)
            if flight.now_s > self._read_s + self._reads_s:
                self.ended = True
                flight.control.abort(flight.now_s)


class AutopilotReboots(Fault):
    """Reboots it in the air. Its filter then begins as late as a real one's."""

    name = "autopilot reboots"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.autopilot.estimator.ready_s = READY_S
        vehicle.autopilot.reboot()


class ComesDown(Fault):
    """Brings one down: in a vertical configuration of 3, 5 or 10 m the upper vehicle's autopilot
    lands by itself, on the lower one; in one of two flights its tracker is gone as well."""

    name = "comes down"

    def adapt(self, mission: Mission) -> Mission:
        height_m = float(self._random.choice([3.0, 5.0, 10.0]))
        height_m = max(height_m, mission.min_separation_m)
        self.phase = "CONFIGURATIONS"
        return replace(
            mission, configurations=[StereoConfiguration("vertical", height_m, record_s=3.0)]
        )

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        vehicle.autopilot.say(2, "EKF Failsafe: changed to LAND Mode")
        vehicle.autopilot.set_mode(flight.now_s, modes.LAND)
        vehicle.tracker_on = self._random.random() < 0.5

    def _ready(self, flight: Flight) -> bool:
        return self._pair(flight) is not None

    def _some(self, flight: Flight) -> RehearsedVehicle:
        return self._pair(flight)[0]

    def _endangered(self, flight: Flight) -> Optional[RehearsedVehicle]:
        return self._pair(flight)[1]

    @staticmethod
    def _pair(flight: Flight) -> Optional[Tuple[RehearsedVehicle, RehearsedVehicle]]:
        """Upper and lower, where one stands above another."""
        pairs = (
            (a, b, a.p_world_m - b.p_world_m) for a, b in permutations(flight.fleet.values(), 2)
        )
        return next(
            ((a, b) for a, b, d in pairs if d[2] > 2.0 and np.hypot(d[0], d[1]) < _ABOVE_M), None
        )


class ComesDownAlone(ComesDown):
    """Acts likewise likewise, and the control PC died just before."""

    name = "comes down alone"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.die()
        super().begin(flight, vehicle)


BOARD_FAULTS = (
    RadioCut,
    RadioLoses,
    RadioHoldsUp,
    ClockSteps,
    ControlClockSteps,
    Battery,
    LowBatteryAlone,
    AgentDies,
    LinkDies,
    LinkSleeps,
    MissionDies,
    MissionRestarts,
    MissionForgets,
    ComesDown,
    ComesDownAlone,
    *([AutopilotReboots] if hasattr(Autopilot, "reboot") else []),
)
