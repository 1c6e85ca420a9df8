# SPDX-License-Identifier: Apache-2.0
"""A whole rehearsed flight: vehicles, radios, control PC and people on one clock."""

import time
from dataclasses import dataclass, field
from typing import Callable, Dict, List, Optional, Sequence

import numpy as np

from fcsv_geometry.missions.mission import Mission
from fcsv_sim.people.operator import ButtonPresser, Field, Pilot
from fcsv_sim.rehearsal.calm import Calm
from fcsv_sim.rehearsal.control import ControlPc
from fcsv_sim.rehearsal.invariants import LATE_FEED, NEEDLESS, OVERRULED, Invariants, Violation
from fcsv_sim.rehearsal.radio import Radio, RadioQuality
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle, Start
from fcsv_sim.rehearsal.witness import FaultAnswer, Witness
from fcsv_sim.trials.formation import formation_vehicle
from fcsv_sim.vehicles.vehicle import PASS_S

_PEOPLE_EVERY, _MISSION_EVERY = 5, 10  # passes
LONGEST_S = 900.0
_DOWN_S = 10.0  # everybody down for so long: the flight is over, whatever the mission thinks


@dataclass
class Result:
    """How a flight went."""

    seed: int
    phase: str
    detail: str
    flown_s: float
    captures: int
    nearest_m: float  # smallest distance between two vehicles in the air
    violations: List[Violation] = field(default_factory=list)
    faults: Sequence[str] = ()
    answers: List[FaultAnswer] = field(default_factory=list)
    # smallest horizontal distance when one that lands comes past another
    crossing_m: float = float("inf")
    off_m: float = 0.0  # largest error of a recorded baseline
    wanted: int = 0  # captures of the whole mission
    began: Sequence[str] = ()  # faults that did
    cpu_s: float = field(default=0.0, compare=False)
    # longest of each feed, where nothing befell anybody
    silences_s: Optional[Dict[str, float]] = None

    def has(self, kind: str) -> bool:
        """Whether a violation of a kind happened."""
        return any(v.kind == kind for v in self.violations)


class Flight:
    """``run`` flies a mission to its end. A fault is told the flight with every pass and may do
    what it likes."""

    def __init__(
        self, mission: Mission, vehicles: int, seed: int, quality: Optional[RadioQuality] = None
    ):
        self.seed, self.now_s, self.mission = seed, 0.0, mission
        names = [f"uav{k + 1}" for k in range(vehicles)]
        random = np.random.default_rng([seed, 20])
        field_ = Field(
            home_height_m=mission.home_height_m,
            spacing_m=mission.column_spacing_m,
            vehicles=vehicles,
        )
        self.fleet: Dict[str, RehearsedVehicle] = {}
        for k, name in enumerate(names):
            xy = np.array([-mission.column_spacing_m * k, 0.0]) + random.uniform(-0.3, 0.3, 2)
            start = Start((*xy, 0.0, random.uniform(-0.1, 0.1)), random.uniform(0.3, 2.0))
            self.fleet[name] = RehearsedVehicle(formation_vehicle(k + 1), start, seed)
        self.radios = {
            n: Radio(quality or RadioQuality(), seed * 100 + k) for k, n in enumerate(names)
        }
        self.control = ControlPc(mission, self.fleet, self.radios, seed)
        self._field = field_
        self._new_pilots()
        self.presser = ButtonPresser()
        self.operator_there = True
        self.hand_flown: Dict[str, Callable] = {}  # by vehicle: sticks in place of its pilot's
        self.invariants = Invariants(self)
        self.witness = Witness(
            self.fleet, lambda now_s, who, text: self.invariants.tell(OVERRULED, who, now_s, text)
        )
        self.recorder: Optional[Callable[[Flight], None]] = None  # told of every look at the truth
        self._calm: Optional[Calm] = None
        self._passes = 0
        self._up_s = float("inf")

    def _new_pilots(self) -> None:
        self.pilots = {n: Pilot(k, self._field, self.seed) for k, n in enumerate(self.fleet)}

    def take_off_again(self) -> None:
        """All are down, and the mission is over: its process begins anew with what it remembers, and
        the pilots fly another time."""
        self._new_pilots()
        self.presser, self._up_s = ButtonPresser(), float("inf")
        self.control.restart(self.now_s)

    @property
    def phase(self) -> str:
        """The mission's."""
        return self.control.machine.phase

    def step(self) -> None:
        """One pass of 10 ms."""
        self.now_s += PASS_S
        self._passes += 1
        now_s = self.now_s
        for vehicle in self.fleet.values():
            vehicle.step(now_s)
        self.control.look(now_s)
        for radio in self.radios.values():
            radio.step(now_s)
        if self._passes % _PEOPLE_EVERY == 0:
            self._people(now_s)
            self.control.listen(now_s)
            self.invariants.check(now_s)
            self.witness.look(now_s, self.control.machine.lands_flown)
            if self._calm is not None:
                self._calm.look(now_s)
            if self.recorder is not None:
                self.recorder(self)
        if self._passes % _MISSION_EVERY == 0:
            self.control.step(now_s)
            self._tell_each_other(now_s)

    def _tell_each_other(self, now_s: float) -> None:
        """Every vehicle tells the others where it is, over its own radio; who has none does not
        hear it."""
        for name, vehicle in self.fleet.items():
            told = vehicle.tell()
            for other, hearer in self.fleet.items():
                if told and other != name and not self.radios[other].cut:
                    self.radios[name].send(
                        now_s, lambda m, v=hearer, t=now_s: v.on_other_vehicle(t, m), told
                    )

    def _people(self, now_s: float) -> None:
        phase = self.phase if self.control.alive else ""
        places = {n: v.p_world_m for n, v in self.fleet.items()}
        sights = {
            n: v.sight([p for o, p in places.items() if o != n]) for n, v in self.fleet.items()
        }
        for name, pilot in self.pilots.items():
            decide = self.hand_flown.get(name, pilot.sticks)
            self.fleet[name].sticks(now_s, decide(now_s, phase, sights[name]))
        machine = self.control.machine
        if self.operator_there and self.control.alive:
            if self.presser.press(
                now_s, machine.waits_for, phase, sights, list(self.pilots.values())
            ):
                self.confirm(machine.waits_for)

    def confirm(self, step: str) -> None:
        """The operator confirms a step of the mission, whether it is waited for or not."""
        if not self.control.proceed(self.now_s, step) and step in ("execute", "resume"):
            self.witness.confirmed(self.now_s)

    @property
    def over(self) -> bool:
        """The mission has ended and nobody flies, or everybody who flew has been down for a
        while."""
        for vehicle in self.fleet.values():
            if vehicle.autopilot.armed:
                self._up_s = self.now_s
                return False
        return self.control.machine.over or self.now_s > self._up_s + _DOWN_S

    def expect_calm(self) -> None:
        """Nothing will befall anybody that asks for an answer: nobody may be stopped, and no feed
        be late."""
        needless, late = (
            lambda who, now_s, text, kind=kind: self.invariants.tell(kind, who, now_s, text)
            for kind in (NEEDLESS, LATE_FEED)
        )
        self._calm = Calm(self.fleet, self.control, needless, late)
        self.witness.posed = self._calm.posed

    def run(
        self, faults: Sequence[Callable[["Flight"], None]] = (), longest_s: float = LONGEST_S
    ) -> Result:
        """Flies to its end, or for ``longest_s``; ``faults`` are told of every pass."""
        cpu_s = time.process_time()
        while not self.over and self.now_s < longest_s:
            for fault in faults:
                fault(self)
            self.step()
        machine = self.control.machine
        self.invariants.end(self.over)
        if self._calm is not None:
            self._calm.end(self.now_s)
        # before anybody had to answer
        ended = [f.name for f in faults if getattr(f, "ended", False)]
        answers = [a for a in self.witness.answers if a.after_s is not None or a.fault not in ended]
        looked = self.invariants
        return Result(
            self.seed,
            machine.phase,
            machine.detail,
            self.now_s,
            len(machine.captures),
            looked.nearest_m,
            looked.violations,
            [getattr(f, "name", "") for f in faults],
            answers,
            looked.crossing_m,
            looked.off_m,
            len(self.mission.recorded),
            [fault for _, fault, _ in self.witness.begun],
            time.process_time() - cpu_s,
            None if self._calm is None else self._calm.longest_s,
        )
