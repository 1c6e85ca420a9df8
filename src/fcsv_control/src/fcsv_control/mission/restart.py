# SPDX-License-Identifier: Apache-2.0
"""Whether a mission that starts goes on with what its last run left."""

from enum import Enum, auto
from typing import List, Tuple

from fcsv_control.mission.memory import Memory
from fcsv_control.mission.snapshot import Snapshot
from fcsv_geometry.missions.phases import BY_HOME, FLOWN
from fcsv_geometry.vehicles.modes import Mode


class RestartVerdict(Enum):
    """What becomes of the memory."""

    WAIT = auto()  # not everybody was heard yet
    ANEW = auto()  # it does not count
    TAKE_OVER = auto()  # hold everybody, then go on
    STOPPED = auto()  # somebody stopped everybody meanwhile: the operator goes on, or aborts
    LAND = auto()


def decide(memory: Memory, snapshot: Snapshot) -> Tuple[RestartVerdict, str]:
    """What to do, and why in words. One vehicle in GUIDED is enough: nobody but this mission flies
    it."""
    heard = [n for n, v in snapshot.vehicles.items() if v.fresh]
    flying = [n for n in heard if snapshot.vehicles[n].armed]
    if memory.phase in FLOWN and in_guided(snapshot):
        return (
            RestartVerdict.TAKE_OVER,
            f"restarted in flight: takes over {', '.join(in_guided(snapshot))}",
        )
    braking = [n for n in flying if snapshot.vehicles[n].mode == Mode.BRAKE]
    if braking and memory.phase in BY_HOME:
        return RestartVerdict.STOPPED, f"restarted: {', '.join(braking)} found in BRAKE"
    if memory.phase == "LAND" and flying:
        return RestartVerdict.LAND, f"restarted while landing: {memory.detail}"
    unheard = [n for n in snapshot.vehicles if n not in heard]
    if unheard:
        return (
            RestartVerdict.WAIT,
            f"restarted: goes on or begins anew once {', '.join(unheard)} is heard",
        )
    if not flying:
        return RestartVerdict.ANEW, "restarted while nobody flies: a new mission begins"
    if memory.phase in FLOWN and any(snapshot.vehicles[n].mode == Mode.LAND for n in flying):
        return RestartVerdict.LAND, f"restarted: {', '.join(flying)} found coming down"
    return (
        RestartVerdict.ANEW,
        f"restarted: {', '.join(flying)} flown by hand: begins anew, calibrate again",
    )


def in_guided(snapshot: Snapshot) -> List[str]:
    """Vehicles that fly in GUIDED, by a fresh state."""
    return [
        n for n, v in snapshot.vehicles.items() if v.fresh and v.armed and v.mode == Mode.GUIDED
    ]
