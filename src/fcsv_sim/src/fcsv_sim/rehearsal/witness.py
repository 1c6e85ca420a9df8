# SPDX-License-Identifier: Apache-2.0
"""Hears every message on its way to the autopilots: what was commanded to a hand-flown vehicle,
when a fault was answered."""

from dataclasses import dataclass
from typing import Callable, Dict, List, Optional, Set, Tuple

import numpy as np

from fcsv_control.agent.core import Kind
from fcsv_sim.autopilot import modes
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

# what left so soon after the companion heard of the pilot's mode does not count
_UNDER_WAY_S = 0.05
_SET_MODE, _TAKE_OFF, _LAND, _ARM = 176, 22, 21, 400  # MAV_CMD
_STOPPING = (modes.LAND, modes.BRAKE)
_CALM_MPS = 0.3


@dataclass
class FaultAnswer:
    """Is the answer to one fault. ``after_s`` None: nobody answered. ``moved_m``: from the place at
    the fault until then."""

    fault: str
    flown: bool  # by the companion (GUIDED) when it began; a hand-flown vehicle is the pilot's
    hovered: bool  # when it began
    after_s: Optional[float] = None
    moved_m: float = 0.0


class Witness:
    """``overruled`` is called with time, vehicle and words of each command that fights a pilot."""

    def __init__(
        self, fleet: Dict[str, RehearsedVehicle], overruled: Callable[[float, str, str], None]
    ):
        self._fleet, self.overruled = fleet, overruled
        # told of each pose for an autopilot
        self.posed: Optional[Callable[[float, str], None]] = None
        # the taking over, and when the companion knew
        self._heard_s: Dict[str, Tuple[Optional[float], float]] = {}
        self._consent_s = float("-inf")
        self._open: List[Tuple[float, RehearsedVehicle, np.ndarray, FaultAnswer]] = []
        self.answers: List[FaultAnswer] = []
        self.begun: List[Tuple[float, str, str]] = []  # time, fault, vehicle
        self._asides: Set[str] = set()  # vehicles for which a way-point is an answer
        # all that would move a vehicle, without set-points
        self.commands: List[Tuple[float, str, str]] = []
        for vehicle in fleet.values():
            vehicle.told = lambda now_s, what, which, v=vehicle: self._on_event(
                now_s, v, what, which
            )

    def confirmed(self, now_s: float) -> None:
        """The operator handed over to the mission: from now on it may take who was hand-flown until
        now."""
        self._consent_s = now_s

    def begins(
        self,
        now_s: float,
        fault: str,
        befallen: RehearsedVehicle,
        endangered: Optional[RehearsedVehicle] = None,
    ) -> None:
        """A fault befalls a vehicle. ``endangered``: another one, which must answer it: hold, land,
        or move aside."""
        vehicle = endangered or befallen
        flown = vehicle.autopilot.mode == modes.GUIDED and not vehicle.flown_by_hand
        speed_mps = float(np.linalg.norm(vehicle.body.velocity_mps))
        answer = FaultAnswer(fault, flown, speed_mps < _CALM_MPS)
        self.answers.append(answer)
        self.begun.append((now_s, fault, befallen.name))
        if endangered is not None:
            self._asides.add(vehicle.name)
        self._open.append((now_s, vehicle, vehicle.p_world_m, answer))

    def look(self, now_s: float, flown: bool) -> None:
        """Autopilots that stop by themselves; what companions know of pilots. ``flown``: the
        mission lands because all is flown, and that answers no fault."""
        if flown:
            self._open.clear()
        for _, vehicle, _, _ in list(self._open):
            if vehicle.autopilot.mode in _STOPPING or vehicle.flown_by_hand:
                self._answered(now_s, vehicle)
        for vehicle in self._fleet.values():
            self._knows(now_s, vehicle)

    def _on_event(self, now_s: float, vehicle: RehearsedVehicle, what: str, which) -> None:
        if what == "sent":
            self._sent(now_s, vehicle, which)
        elif what == "held" or which.kind in (Kind.HOLD, Kind.LAND):
            self._answered(now_s, vehicle)
        elif which.kind is Kind.GOTO and vehicle.name in self._asides:
            self._answered(now_s, vehicle)

    def _sent(self, now_s: float, vehicle: RehearsedVehicle, message) -> None:
        kind = message.get_type()
        if kind == "COMMAND_LONG" and message.command in (_SET_MODE, _TAKE_OFF, _LAND, _ARM):
            mode = (
                int(message.param2)
                if message.command == _SET_MODE
                else modes.LAND * (message.command == _LAND)
            )
            words = f"mode {modes.NAMES.get(mode, mode)}" if mode else f"command {message.command}"
            self.commands.append((now_s, vehicle.name, words))
            if mode in _STOPPING:
                self._answered(now_s, vehicle)
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            words = "a set-point"
        else:
            if self.posed is not None and kind == "VISION_POSITION_ESTIMATE":
                self.posed(now_s, vehicle.name)
            return
        if self._knows(now_s, vehicle):
            name = modes.NAMES[vehicle.autopilot.mode]
            self.overruled(
                now_s, vehicle.name, f"{vehicle.name} was sent {words} in its pilot's {name}"
            )

    def _knows(self, now_s: float, vehicle: RehearsedVehicle) -> bool:
        """Whether the companion has known for a while that the pilot has the vehicle, and nobody
        gave it back."""
        if not vehicle.flown_by_hand or not vehicle.autopilot.armed:
            return False
        taken_s, mode = vehicle.by_hand
        known_s = self._heard_s.get(vehicle.name, (None, 0.0))
        if known_s[0] != taken_s:
            if vehicle.state.mode != modes.NAMES[mode]:
                return False
            known_s = self._heard_s[vehicle.name] = (taken_s, now_s)
        return now_s > known_s[1] + _UNDER_WAY_S and self._consent_s < taken_s

    def _answered(self, now_s: float, vehicle: RehearsedVehicle) -> None:
        for entry in [e for e in self._open if e[1] is vehicle]:
            began_s, _, p_m, answer = entry
            answer.after_s = now_s - began_s
            answer.moved_m = float(np.linalg.norm(vehicle.p_world_m - p_m))
            self._open.remove(entry)
