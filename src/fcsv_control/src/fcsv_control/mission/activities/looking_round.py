# SPDX-License-Identifier: Apache-2.0
"""Looking round: vehicles that stand turn once about themselves, one after the other, while
everybody else holds.

What they see meanwhile is recorded as on the whole flight; no configuration is recorded. A turn is
never worth a landing: one that is not flown is left out, and the flight goes on.
"""

import math
from dataclasses import dataclass
from typing import List, Mapping, Optional, Sequence

import numpy as np

from fcsv_control.mission.activities.activity import Activity, Progress
from fcsv_control.mission.activities.stages import TURNS
from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.journey import go_to_body
from fcsv_control.mission.ways.places import body_set_point, heading_error_rad, heading_rad
from fcsv_geometry import rotations, transforms
from fcsv_geometry.missions.camera_places import mover_place
from fcsv_geometry.missions.look_round import LookRound
from fcsv_geometry.missions.mission import Mission, SettleBounds

_ORDER_EVERY_S = 0.2  # set-points: one that is lost on the radio is followed by the next
# so far behind its set-point it may be: an autopilot follows within a second
_LAG_RAD = math.radians(40.0)
_OFF_M = 0.5  # so far off its place it may be: it waits there until it is back
_LONGEST_STEP_S = 0.5  # after a pause of the mission's own process the set-point does not jump
_WHOLE_RAD = 2.0 * math.pi
_SAME_PLACE_M = 1.0  # from where everything is seen that was seen before


@dataclass(frozen=True)
class Turned:
    """A vehicle has turned at (or gave it up at) ``p_home_m`` (3)."""

    vehicle: str
    p_home_m: List[float]


def is_new(turned: Sequence[Turned], vehicle: str, p_home_m: np.ndarray) -> bool:
    """Whether a vehicle has turned nowhere within 1 m of a place (3,).

    >>> is_new([Turned("uav2", [0.0, -4.0, 0.0])], "uav2", np.array([0.0, -4.0, 0.3]))
    False
    """
    return all(
        t.vehicle != vehicle or math.dist(t.p_home_m, p_home_m.tolist()) > _SAME_PLACE_M
        for t in turned
    )


class Turn:
    """One vehicle's, about its own axis; ``step`` says whether it is over. ``T_home_cam``: its
    camera's place and the heading at which it ends. It begins at the heading that the vehicle has
    then."""

    def __init__(
        self,
        outbox: Outbox,
        name: str,
        T_home_cam: np.ndarray,
        how: LookRound,
        bounds: SettleBounds,
    ):
        self.name, self.p_home_m = name, T_home_cam[:3, 3]
        self._outbox, self._T_home_cam, self._bounds = outbox, T_home_cam, bounds
        self._most_radps, self._ramp_radps2 = (
            math.radians(how.rate_dps),
            math.radians(how.ramp_dps2),
        )
        # of the set-point, from the last heading on; 2 pi at the end
        self._angle_rad: Optional[float] = None
        self._rate_radps = 0.0
        self._now_s = self._moved_s = 0.0
        self._ordered_s = -math.inf
        self._order: Optional[Order] = None  # the last one
        self._end_ordered = False  # by the last one
        self.why = ""  # it was given up

    def step(self, snapshot: Snapshot) -> bool:
        """Move the set-point on; who does not follow is waited for, and at last sent back to its
        heading."""
        if self._angle_rad is None:
            self._begin(snapshot)
        now_s = snapshot.now_s
        dt_s, self._now_s = min(now_s - self._now_s, _LONGEST_STEP_S), now_s
        before = self._angle_rad
        self._advance(dt_s, self._behind(snapshot))
        self._moved_s = now_s if self._angle_rad > before else self._moved_s
        if self._angle_rad >= _WHOLE_RAD and self._stands(snapshot):
            return True
        if now_s - self._moved_s > self._bounds.timeout_s:
            self.why = "does not turn" if self._angle_rad < _WHOLE_RAD else "is not calm after it"
            self._set(snapshot, 0.0)
            return True
        if now_s - self._ordered_s >= _ORDER_EVERY_S - 1e-6 and not self._end_acknowledged:
            self._set(snapshot, self._angle_rad)
        return False

    def _begin(self, snapshot: Snapshot) -> None:
        off_rad = heading_rad(snapshot.vehicles[self.name].T_home_cam) - heading_rad(
            self._T_home_cam
        )
        self._angle_rad = rotations.wrap(off_rad)
        self._now_s = self._moved_s = snapshot.now_s

    def _advance(self, dt_s: float, wait: bool) -> None:
        left_rad = max(_WHOLE_RAD - self._angle_rad, 0.0)
        wanted = (
            0.0 if wait else min(self._most_radps, math.sqrt(2.0 * self._ramp_radps2 * left_rad))
        )
        step = self._ramp_radps2 * dt_s
        self._rate_radps = min(max(wanted, self._rate_radps - step), self._rate_radps + step)
        self._angle_rad = min(self._angle_rad + self._rate_radps * dt_s, _WHOLE_RAD)
        if _WHOLE_RAD - self._angle_rad < 1e-3:
            self._angle_rad, self._rate_radps = _WHOLE_RAD, 0.0

    def _behind(self, snapshot: Snapshot) -> bool:
        """Whether it is far off the set-point's heading, or off its place."""
        heading = heading_rad(snapshot.vehicles[self.name].T_home_cam)
        wanted = heading_rad(self._T_home_cam) + self._angle_rad
        return (
            abs(rotations.wrap(wanted - heading)) > _LAG_RAD
            or self._off_m(snapshot, self._angle_rad) > _OFF_M
        )

    def _stands(self, snapshot: Snapshot) -> bool:
        """Back at its heading, and calm; that it stands well enough for pictures is looked at
        thereafter."""
        view, b = snapshot.vehicles[self.name], self._bounds
        turned_back = heading_error_rad(view.T_home_cam, self._T_home_cam) < math.radians(
            b.heading_deg
        )
        calm = view.speed_mps < b.speed_mps and self._off_m(snapshot, _WHOLE_RAD) < _OFF_M
        return turned_back and calm and self._end_acknowledged and self._order.done

    @property
    def _end_acknowledged(self) -> bool:
        return self._end_ordered and not self._order.failed

    def _off_m(self, snapshot: Snapshot, angle_rad: float) -> float:
        """Measures how far off it is from where its camera is to be: it goes round the body's
        axis."""
        T_body_cam = snapshot.T_body_cam[self.name]
        T_home_cam = snapshot.T_home_odom[self.name] @ self._body(snapshot, angle_rad) @ T_body_cam
        return float(np.linalg.norm(snapshot.p_home_cam(self.name) - T_home_cam[:3, 3]))

    def _body(self, snapshot: Snapshot, angle_rad: float) -> np.ndarray:
        """T_odom_body at an angle of the turn: always at the same place."""
        T = body_set_point(
            self._T_home_cam, snapshot.T_home_odom[self.name], snapshot.T_body_cam[self.name]
        )
        return T @ transforms.from_xyz_yaw(np.zeros(3), angle_rad)

    def _set(self, snapshot: Snapshot, angle_rad: float) -> None:
        self._ordered_s, self._end_ordered = snapshot.now_s, angle_rad >= _WHOLE_RAD
        self._order = go_to_body(self._outbox, snapshot, self.name, self._body(snapshot, angle_rad))


class LookRoundAtPlaces(Activity):
    """Movers turn at their places (T_home_cam by vehicle), which ``where`` names; who has
    ``turned`` there already does not, and who turns is added to it."""

    stage = TURNS

    def __init__(
        self,
        mission: Mission,
        outbox: Outbox,
        places: Mapping[str, np.ndarray],
        where: str,
        turned: List[Turned],
    ):
        super().__init__()
        self._how, self._bounds, self._outbox = mission.look_round, mission.settle, outbox
        self._wanted = self._how is not None and self._how.places
        self._places, self._where, self._turned = places, where, turned
        self._turn: Optional[Turn] = None

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        places = self._now(snapshot) if self._wanted else {}
        left = self._left(places)
        if not left:
            return Progress.DONE
        name = left[0]
        if self._turn is None or self._turn.name != name:
            self._turn = Turn(self._outbox, name, places[name], self._how, self._bounds)
        self.detail = f"{name} looks round {self._where}"
        if self._turn.step(snapshot):
            if self._turn.why:
                self._notes.append(f"{name} {self._turn.why}: it did not look round {self._where}")
            self._leave_out()
        return Progress.UNDER_WAY if self._left(places) else Progress.DONE

    def _now(self, _snapshot: Snapshot) -> Mapping[str, np.ndarray]:
        return self._places

    def _left(self, places: Mapping[str, np.ndarray]) -> List[str]:
        """Who has still to turn, in this order."""
        return [n for n, T in places.items() if is_new(self._turned, n, T[:3, 3])]

    def _leave_out(self) -> bool:
        """The running turn is over, flown or not; whether there was one."""
        if self._turn is None:
            return False
        self._turned.append(Turned(self._turn.name, self._turn.p_home_m.tolist()))
        self._turn = None
        return True


class LookRoundInColumn(LookRoundAtPlaces):
    """All turn where they stand, with their headings of ``parked`` (T_home_cam): the reference at
    its place, the others where they are."""

    def __init__(
        self,
        mission: Mission,
        outbox: Outbox,
        parked: Mapping[str, np.ndarray],
        turned: List[Turned],
    ):
        super().__init__(mission, outbox, parked, "in the column", turned)
        self._wanted = self._how is not None and self._how.column
        self._reference = mission.reference

    def _now(self, snapshot: Snapshot) -> Mapping[str, np.ndarray]:
        places = {self._reference: self._places[self._reference]}
        for name, T_home_cam in self._places.items():
            here = transforms.transform(T_home_cam[:3, :3], snapshot.p_home_cam(name))
            places.setdefault(name, here)
        return places

    def skip(self) -> bool:
        return self._leave_out()


def turn_most_s(mission: Mission) -> float:
    """How long (s) a turn takes at most."""
    how = mission.look_round
    return 0.0 if how is None else 2.0 * how.turn_s + 2.0 * mission.settle.timeout_s


def turns_s(mission: Mission, indices: Sequence[int], in_column: int) -> float:
    """Time (s) that turns take: those at the places of ``indices``, and those of so many vehicles
    in the column."""
    how = mission.look_round
    if how is None:
        return 0.0
    turned: List[Turned] = []
    for i in indices if how.places else []:
        p_home_m, name = mover_place(mission, i)[:3, 3], mission.configurations[i].vehicle or ""
        if is_new(turned, name, p_home_m):
            turned.append(Turned(name, p_home_m.tolist()))
    return how.turn_s * (len(turned) + in_column * how.column)
