# SPDX-License-Identifier: Apache-2.0
"""Pilots and operators who do what nobody expects."""

from dataclasses import replace

import numpy as np

from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot import modes
from fcsv_sim.people.operator import PilotSight, TransmitterSticks
from fcsv_sim.rehearsal.fault import Fault
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.hand_flight import HandFlight
from fcsv_sim.rehearsal.invariants import LATE_STOP
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

_ENDS = ("LAND", "DONE", "ABORTED")
_TOLD_S = 3.0  # after which a pilot who is told to land does
_PATIENCE_S = 120.0  # who got no word for so long lands
_STOPS_S, _STOPS_WITH_LOSS_S = 0.5, 1.5  # after two repetitions that were lost, after seven
_GOOD = 0.1  # a radio that loses less
_STEPS = ("calibrate", "set_home", "execute", "resume")
_ABOUT_TO_BE = ("SET_HOME", "GUIDED")
_SINKS_S = 3.0  # by then he sees that it sinks or climbs


class PilotTakesOver(Fault):
    """A pilot switches to a mode of his and hovers; in two of three flights he gives it back after
    5 to 20 s."""

    name = "pilot takes over"
    modes = (Mode.LOITER, Mode.ALT_HOLD, Mode.LAND, Mode.BRAKE)
    _roams = _drops = False

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self.mode = Mode(self._random.choice(self.modes))
        self._until_s = self._lasts_s(0.33, 5.0, 20.0)
        self._by_hand = HandFlight(
            self.mode, vehicle.p_world_m, self._random, self._roams, self._drops
        )
        self._told_s = np.inf
        self._mine, self._pilot = self._sticks_of, flight.pilots[vehicle.name]
        flight.hand_flown[vehicle.name] = self._mine

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._until_s and not self.ended:
            self.ended = True
            if flight.hand_flown.get(self.vehicle.name) is self._mine:
                del flight.hand_flown[self.vehicle.name]

    def _sticks_of(self, now_s: float, phase: str, sight: PilotSight) -> TransmitterSticks:
        if phase in _ENDS:
            self._told_s = min(self._told_s, now_s)
        if now_s > self._told_s + _TOLD_S or now_s > self.began_s + _PATIENCE_S:
            return self._pilot.land_by_hand(now_s, sight)
        return self._by_hand.sticks(now_s - self.began_s, sight)


class PilotDisobeys(PilotTakesOver):
    """Any mode, any time; he flies about a little, or pulls the throttle down as he takes over."""

    name = "pilot disobeys"
    modes = (Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.LAND, Mode.BRAKE)

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._roams, self._drops = (bool(self._random.random() < 0.5) for _ in range(2))
        super().begin(flight, vehicle)


class Aborted(Fault):
    """The operator presses abort."""

    name = "abort"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flight.control.abort(flight.now_s)


class StopsAll(Fault):
    """Somebody calls /stop_all; the operator resumes later. Who was in GUIDED, and hears it, must
    be asked for BRAKE (or land already) in time."""

    name = "stop all"

    def _ready(self, flight: Flight) -> bool:
        return flight.control.stop_all_alive

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        flown = [
            v
            for v in flight.fleet.values()
            if v.autopilot.mode == modes.GUIDED and not v.flown_by_hand
        ]
        self._must = {v.name: len(v.modes_asked) for v in flown}
        loss = max(radio.quality.loss for radio in flight.radios.values())
        self._within_s = _STOPS_S if loss < _GOOD else _STOPS_WITH_LOSS_S
        flight.control.stop_all(flight.now_s)

    def goes_on(self, flight: Flight, since_s: float) -> None:
        for name in list(self._must):
            vehicle, radio = flight.fleet[name], flight.radios[name]
            stopped = [mode for _, mode in vehicle.modes_asked[self._must[name] :] if mode.stops]
            deaf = (
                radio.cut
                or radio.held_until_s > flight.now_s
                or not (vehicle.agent.runs and vehicle.link.runs)
            )
            aside = vehicle.guardian.verdict.action == "aside"  # nobody but the pilot stops that
            if stopped or deaf or aside or vehicle.autopilot.mode != modes.GUIDED:
                del self._must[name]
            elif since_s > self._within_s:
                del self._must[name]
                text = f"{name} was not asked to stop {since_s:.2f} s after /stop_all"
                flight.invariants.tell(LATE_STOP, name, flight.now_s, text)


class StickOff(Fault):
    """A thumb rests on the throttle stick of a vehicle that is flown in GUIDED, or is about to be;
    in two of three flights for 2 to 8 s."""

    name = "stick off the middle"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._until_s = flight.now_s + self._lasts_s(0.33, 2.0, 8.0)
        self._throttle = self._uniform(0.3, 0.6) * float(self._random.choice([-1.0, 1.0]))
        self._mine, self._pilot = self._sticks_of, flight.pilots[vehicle.name]
        flight.hand_flown.setdefault(vehicle.name, self._mine)

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if flight.now_s > self._until_s and flight.hand_flown.get(self.vehicle.name) is self._mine:
            self.ended = True
            del flight.hand_flown[self.vehicle.name]

    def _sticks_of(self, now_s: float, phase: str, sight: PilotSight) -> TransmitterSticks:
        sticks = self._pilot.sticks(now_s, phase, sight)
        waits = phase in _ABOUT_TO_BE and now_s < self.began_s + _SINKS_S
        return (
            replace(sticks, throttle=self._throttle)
            if waits or sight.mode == Mode.GUIDED
            else sticks
        )


class ConfirmsAnything(Fault):
    """Confirms: for 3 s the operator confirms whatever comes to his mind, three times a second."""

    name = "operator confirms anything"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._next_s = 0.0

    def goes_on(self, flight: Flight, since_s: float) -> None:
        self.ended = since_s > 3.0
        if not self.ended and since_s > self._next_s and flight.control.alive:
            self._next_s = since_s + 0.33
            flight.confirm(str(self._random.choice(_STEPS)))


PEOPLE_FAULTS = (PilotTakesOver, PilotDisobeys, Aborted, StopsAll, StickOff, ConfirmsAnything)
