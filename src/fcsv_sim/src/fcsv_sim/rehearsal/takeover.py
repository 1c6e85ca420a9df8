# SPDX-License-Identifier: Apache-2.0
"""The table of takings-over: in each phase a pilot takes a vehicle for a minute, in each of his
modes."""

from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.phases import PHASES
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot import modes
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.hand_flight import HandFlight

MODES = (Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.LAND, Mode.BRAKE)
TAKEN_S = 60.0
_AFTER_S = 0.5  # the phase began
_LONGEST_S = 600.0


@dataclass(frozen=True)
class Trial:
    """One taking-over; ``vehicle`` is taken."""

    mission: Mission
    vehicles: int
    seed: int
    phase: str
    mode: Mode
    taken_s: float = TAKEN_S

    @property
    def vehicle(self) -> str:
        """Gives the vehicle, in turn."""
        return f"uav{1 + (PHASES.index(self.phase) + MODES.index(self.mode)) % self.vehicles}"


@dataclass(frozen=True)
class TakeoverOutcome:
    """``commands`` that fought the pilot; ``reached``: whether the flight came to the phase,
    ``taken``: whether the autopilot was in the pilot's mode; it refuses LOITER and BRAKE before it
    has a position."""

    trial: Trial
    reached: bool
    taken: bool
    commands: Tuple[str, ...]


def trials(mission: Mission, vehicles: int, seed: int) -> List[Trial]:
    """Each phase with each mode."""
    return [Trial(mission, vehicles, seed, phase, mode) for phase in PHASES for mode in MODES]


def fly(trial: Trial) -> TakeoverOutcome:
    """Flies until the phase, then for the time that the pilot has it. ABORTED is reached by an
    abort in CONFIGURATIONS."""
    flight = Flight(trial.mission, trial.vehicles, trial.seed)
    reached = _fly_to(flight, trial.phase)
    vehicle = flight.fleet[trial.vehicle]
    commands: List[str] = []
    taken = False
    flight.witness.overruled = lambda _s, _who, text: commands.append(text)
    if reached:
        pilot = HandFlight(
            trial.mode, vehicle.p_world_m, np.random.default_rng(trial.seed), False, False
        )
        begun_s = flight.now_s
        flight.hand_flown[trial.vehicle] = lambda now_s, _phase, sight: pilot.sticks(
            now_s - begun_s, sight
        )
        while flight.now_s < begun_s + trial.taken_s:
            flight.step()
            taken |= vehicle.flown_by_hand and vehicle.by_hand[1] == modes.NUMBERS[trial.mode]
    return TakeoverOutcome(trial, reached, taken, tuple(commands))


def _fly_to(flight: Flight, phase: str) -> bool:
    """Whether ``phase`` was reached."""
    since_s = None
    while flight.now_s < _LONGEST_S:
        if phase == "ABORTED" and flight.phase == "CONFIGURATIONS":
            flight.control.abort(flight.now_s)
        since_s = since_s or (flight.now_s if flight.phase == phase else None)
        if since_s is not None and (flight.now_s > since_s + _AFTER_S or flight.phase != phase):
            return True
        flight.step()
    return False


def table(outcomes: Sequence[TakeoverOutcome]) -> List[str]:
    """Lines of a table: commands to the hand-flown vehicle, by phase and mode."""
    cells: Dict[Tuple[str, str], str] = {}
    for o in outcomes:
        words = "not reached" if not o.reached else "" if o.taken else " (mode refused)"
        cells[o.trial.phase, o.trial.mode] = f"{len(o.commands)}{words}" if o.reached else words
    rows = [[phase, *(cells.get((phase, mode), "–") for mode in MODES)] for phase in PHASES]
    lines = [["phase", *MODES], ["---"] * (1 + len(MODES)), *rows]
    return ["| " + " | ".join(row) + " |" for row in lines] + sorted(
        {t for o in outcomes for t in o.commands}
    )
