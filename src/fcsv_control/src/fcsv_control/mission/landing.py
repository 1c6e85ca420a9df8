# SPDX-License-Identifier: Apache-2.0
"""Landing everybody, and nobody onto somebody."""

from typing import Dict, List, Optional, Sequence

import numpy as np

from fcsv_control.mission.journey import go_to
from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.places import level_camera
from fcsv_control.mission.snapshot import Snapshot
from fcsv_geometry import transforms

_REPEAT_S = 3.0


class Landing:
    """A vehicle that stands above another moves aside first, where the mission flies it; the others land at once."""

    def __init__(self, vehicles: Sequence[str], outbox: Outbox, separation_m: float):
        self._vehicles = list(vehicles)
        self._outbox = outbox
        self._clear_m = separation_m + 0.5
        self._next_s: Dict[str, float] = dict.fromkeys(vehicles, float("-inf"))
        self._recorders_off: Dict[str, Optional[Order]] = dict.fromkeys(vehicles)
        self.problems: List[str] = []

    def step(self, snapshot: Snapshot) -> bool:
        """Whether all are on the ground with motors off."""
        self.problems = []
        flying = [n for n in self._vehicles if snapshot.vehicles[n].armed]
        for name in flying:
            self._switch_off(snapshot, name)
            if snapshot.vehicles[name].mode != "LAND" and snapshot.now_s >= self._next_s[name]:
                self._bring_down(snapshot, name)
        return not flying

    def _switch_off(self, snapshot: Snapshot, name: str) -> None:
        order = self._recorders_off[name]
        if order is None or order.failed:
            self._recorders_off[name] = self._outbox.order(snapshot.now_s, name, "RECORD", flag=False)

    def _bring_down(self, snapshot: Snapshot, name: str) -> None:
        below = self._below(snapshot, name)
        if below is None:
            self._outbox.order(snapshot.now_s, name, "LAND")
            self._next_s[name] = snapshot.now_s + _REPEAT_S
        elif snapshot.vehicles[name].mode == "GUIDED":
            go_to(self._outbox, snapshot, name, self._aside(snapshot, name, below))
            self._next_s[name] = snapshot.now_s + 1.0
        else:
            self.problems.append(f"{name} is above {below} and not in GUIDED: fly it aside, then it lands")

    def _below(self, snapshot: Snapshot, name: str) -> Optional[str]:
        """A vehicle that this one would come down upon, flying or not."""
        if snapshot.vehicles[name].T_home_cam is None:
            return None  # before home is set they stand in a column
        here = snapshot.p_home_cam(name)
        for other in self._vehicles:
            if other == name or snapshot.vehicles[other].T_home_cam is None:
                continue
            offset = here - snapshot.p_home_cam(other)
            if offset[2] > 0 and np.linalg.norm(offset[:2]) < self._clear_m:
                return other
        return None

    def _aside(self, snapshot: Snapshot, name: str, below: str) -> np.ndarray:
        """T_home_cam at the same height, clear of everybody: away from who is below, else right, left, back, front."""
        here = snapshot.p_home_cam(name)
        known = [n for n in self._vehicles if n != name and snapshot.vehicles[n].T_home_cam is not None]
        others = [snapshot.p_home_cam(n) for n in known]
        away = here[:2] - snapshot.p_home_cam(below)[:2]
        directions = [np.array(d, float) for d in ((0, -1), (0, 1), (-1, 0), (1, 0))]
        if np.linalg.norm(away) > 0.3:
            directions.insert(0, away / np.linalg.norm(away))
        places = [here + 2.0 * self._clear_m * np.array([*d, 0.0]) for d in directions]
        room_m = [min(float(np.linalg.norm((p - o)[:2])) for o in others) for p in places]
        best = next((p for p, m in zip(places, room_m) if m > self._clear_m), places[int(np.argmax(room_m))])
        T_home_cam = level_camera(snapshot.vehicles[name].T_home_cam)
        return transforms.transform(T_home_cam[:3, :3], best)
