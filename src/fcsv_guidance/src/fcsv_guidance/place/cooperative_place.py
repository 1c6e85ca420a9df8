# SPDX-License-Identifier: Apache-2.0
"""Where the robot is among vehicles that its gimbals see (thesis 4.1, the other way round).

Cooperative localization (Roumeliotis and Bekey 2002) in one extended Kalman filter: the robot's
wheels move the robot, each vehicle's own odometry moves the vehicle and drifts, and each sighting
ties two places together. While the robot stands, the filter learns how the vehicles drift; while it
drives, the vehicles tell where it went: it drives in steps (steps.py). A port: messages and
monotonic time in, a CooperativeState out. All is level: x, y (m) and yaw (rad) in home.
"""

import heapq
from collections import deque
from dataclasses import dataclass
from typing import Deque, Dict, List, Mapping, NamedTuple, Optional, Tuple, Union

import numpy as np

from fcsv_geometry import chi_squared, rotations, transforms
from fcsv_geometry.config import require_positive, require_within
from fcsv_guidance.clock import ahead_of_clock
from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.place.tracker import (
    GATES,
    STATES,
    LevelPlace,
    PlaceRules,
    PlaceState,
    moved_by_wheels,
)
from fcsv_guidance.place.wheels import WheelOdometry, WheelReader, between

_OF_VEHICLE = 5  # x, y, yaw, velocity of its drift along x and y
# wheels 0.24 m apart turn a robot by 4 degrees in a root metre where either slips by 3 %
_SMALL_ROBOT = PlaceRules(distance_noise_m=0.015, yaw_noise_radpm=0.07)


@dataclass(frozen=True)
class RobotStart(LevelPlace):
    """Where the robot stands when home is set."""


@dataclass(frozen=True)
class VehicleSighting:
    """A vehicle's body in the robot's level frame at a picture's stamp; ``covariance`` (3,3) of
    x, y (m), yaw (rad)."""

    stamp_s: float
    vehicle: str
    x_m: float
    y_m: float
    yaw_rad: float
    covariance: np.ndarray

    @classmethod
    def of_pose(
        cls, stamp_s: float, vehicle: str, T_robot_body: np.ndarray, covariance: np.ndarray
    ) -> "VehicleSighting":
        """The level part of a pose; ``covariance`` (6,6): position (m), rotation (rad), about the
        robot's axes. Height, roll and pitch do not matter to a robot on a level floor."""
        level = [0, 1, 5]
        C = np.asarray(covariance, float)[np.ix_(level, level)]
        yaw = transforms.yaw(T_robot_body)
        return cls(stamp_s, vehicle, float(T_robot_body[0, 3]), float(T_robot_body[1, 3]), yaw, C)


@dataclass(frozen=True)
class UntrackedOdometry:
    """Where a vehicle's own odometry says that it is, in a level frame of its own."""

    stamp_s: float
    vehicle: str
    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True)
class CooperativeRules:
    """Standard deviations, and what is believed. ``drift_mps``: of the velocity by which an
    odometry that only adds up velocities drifts, ``drift_change`` of its change in a root second;
    ``wander_m``: of a vehicle that has no odometry and holds, in a root second.

    Errors of one tag last while it is looked at: a sighting is used every ``sighting_s`` only, and
    never believed better than ``least_m`` and ``least_deg``. ``floor_deg``: by how much the robot's
    floor is not level; ``lag_s``: messages that come later than this are refused. Wheels stand that
    turn by less than ``stands`` (m, rad); a vehicle is seen that was sighted in the last ``seen_s``.
    """

    wheels: PlaceRules = _SMALL_ROBOT
    drift_mps: float = 0.03
    drift_change: float = 0.003
    odometry_noise_m: float = 0.015
    odometry_yaw_deg: float = 0.3
    wander_m: float = 0.1
    wander_deg: float = 2.0
    sighting_s: float = 0.2
    least_m: float = 0.01
    least_deg: float = 0.6
    floor_deg: float = 0.3
    gate: float = 0.999
    to_doubt: int = 5
    oldest_sighting_s: float = 5.0
    stands: float = 0.005
    seen_s: float = 1.0
    lag_s: float = 0.25

    def __post_init__(self):
        require_positive(self)
        require_within(self, *GATES, "gate")


@dataclass(frozen=True)
class CooperativeState:
    """The robot's place, and those of the bodies of vehicles that were seen since the start, by
    name. ``stood_s``: so long the wheels have stood; ``drift_sigma_mps``: how well the drift is
    known of the vehicle that is seen now and known worst, inf where none is seen; ``unseen_s``:
    since when one of them was not seen."""

    robot: PlaceState
    vehicles: Mapping[str, LevelPlace]
    stood_s: float = 0.0
    drift_sigma_mps: float = np.inf
    unseen_s: float = 0.0


Message = Union[RobotStart, WheelOdometry, UntrackedOdometry, VehicleSighting]


class _Tracked(NamedTuple):
    """A vehicle in the state: where its part begins, when it was moved last, and its odometry
    then."""

    at: int
    moved_s: float
    odometry: Optional[UntrackedOdometry]


class CooperativeTracker:
    """Weighs wheels, odometries and sightings in the order of their stamps, ``lag_s`` late; what
    the wheels did since is added to what is given out."""

    def __init__(self, rules: CooperativeRules = CooperativeRules()):
        self._rules, self._bound = rules, chi_squared.quantile(rules.gate, 3)
        self._queue: List[Tuple[float, int, Message]] = []
        self._count = 0
        self._used, self._refused, self._why = 0, 0, ""
        self._reader = WheelReader(rules.wheels.wheels)
        self._begin(None)

    def _begin(self, start: Optional[RobotStart]) -> None:
        self._x, self._P = np.zeros(STATES), np.zeros((STATES, STATES))
        self._until_s = -np.inf if start is None else start.stamp_s
        self._begun = start is not None
        self._wheels: Optional[WheelOdometry] = None
        self._moved: Optional[WheelOdometry] = None  # the first reading of where they are now
        self._newest: Deque[WheelOdometry] = deque(maxlen=200)
        self._vehicles: Dict[str, _Tracked] = {}
        self._odometry: Dict[str, UntrackedOdometry] = {}
        self._sighted_s: Dict[str, float] = {}
        self._in_a_row = 0
        if start is not None:
            w = self._rules.wheels
            self._x[:3] = start.x_m, start.y_m, start.yaw_rad
            self._P[:3, :3] = start.covariance
            self._P[3, 3], self._P[4, 4] = w.distance_scale**2, w.turn_scale**2
            self._P[5, 5] = w.curve_radpm**2

    def receive(self, now_s: float, message: Message) -> None:
        """A message came. Raises TypeError where its type is not known; one that is not finite,
        comes too late or lies in the future is refused."""
        if not isinstance(message, (RobotStart, WheelOdometry, UntrackedOdometry, VehicleSighting)):
            raise TypeError(f"a robot among vehicles does not know {type(message).__name__}")
        if ahead_of_clock(now_s, self._until_s):  # the clock was set back
            self._queue.clear()
            self._reader = WheelReader(self._rules.wheels.wheels)
            self._begin(None)
        if isinstance(message, WheelOdometry):
            self._receive_wheels(now_s, message)
            return
        refusal = _refusal(now_s, message)
        if refusal:
            self._refuse(refusal)
        elif isinstance(message, RobotStart):
            self._begin(message)
        elif message.stamp_s < self._until_s:
            self._refuse("a message came too late")
        else:
            self._put(message)

    def _receive_wheels(self, now_s: float, raw: WheelOdometry) -> None:
        wheels = self._reader.read(now_s, raw)
        if self._reader.refusal:
            self._refuse(self._reader.refusal)
        elif raw.stamp_s < self._until_s:
            self._refuse("wheel odometry came too late")
        elif wheels is not None:
            self._why = self._reader.jump or self._why
            self._put(wheels)
            self._newest.append(wheels)

    def _put(self, message: Message) -> None:
        self._count += 1
        heapq.heappush(self._queue, (message.stamp_s, self._count, message))

    def step(self, now_s: float) -> CooperativeState:
        """The robot as of its last wheels, the vehicles as of ``lag_s`` before."""
        while self._queue and self._queue[0][0] <= now_s - self._rules.lag_s:
            self._process(heapq.heappop(self._queue)[2])
        stood_s = 0.0 if self._moved is None else self._until_s - self._moved.stamp_s
        drift_mps, seen_s = self._drift_sigma_mps(now_s), self._sighted_s.values()
        unseen_s = now_s - min(seen_s, default=now_s)
        return CooperativeState(self._robot(now_s), self._places(), stood_s, drift_mps, unseen_s)

    def _robot(self, now_s: float) -> PlaceState:
        reason = self._unknown(now_s)
        if reason:
            return PlaceState(None, reason, np.inf, self._used, self._refused, self._why)
        x, P, at = self._x[:STATES], self._P[:STATES, :STATES], self._wheels
        for wheels in self._newest:
            if wheels.stamp_s > at.stamp_s:
                x, F, Q = moved_by_wheels(x, at, wheels, self._rules.wheels, self._reader)
                P, at = F @ P @ F.T + Q, wheels
        sigma_m = float(np.sqrt(P[0, 0] + P[1, 1]))
        place = RobotPlace(
            at.stamp_s, float(x[0]), float(x[1]), rotations.wrap(float(x[2])), sigma_m
        )
        return PlaceState(place, "", float(np.sqrt(P[2, 2])), self._used, self._refused, self._why)

    def _unknown(self, now_s: float) -> str:
        """Why the robot's place is not known; empty where it is."""
        if not self._begun:
            return "nobody has said where the robot begins: set home while it stands"
        if self._wheels is None:
            return "no wheel odometry has come"
        if self._in_a_row >= self._rules.to_doubt:
            return f"{self._in_a_row} sightings in a row contradict the wheels"
        if not self._sighted_s:
            return "no vehicle has been seen"
        age_s = now_s - max(self._sighted_s.values())
        return f"no vehicle seen for {age_s:.0f} s" if age_s > self._rules.oldest_sighting_s else ""

    def _places(self) -> Dict[str, LevelPlace]:
        found = {}
        for name, vehicle in self._vehicles.items():
            own = slice(vehicle.at, vehicle.at + 3)
            x, y, yaw = map(float, self._x[own])
            found[name] = LevelPlace(
                vehicle.moved_s, x, y, rotations.wrap(yaw), self._P[own, own].copy()
            )
        return found

    def _drift_sigma_mps(self, now_s: float) -> float:
        seen = [n for n, at_s in self._sighted_s.items() if now_s - at_s < self._rules.seen_s]
        parts = [slice(self._vehicles[n].at + 3, self._vehicles[n].at + 5) for n in seen]
        found = [float(np.linalg.eigvalsh(self._P[part, part])[-1]) for part in parts]
        return float(np.sqrt(max(found))) if found else np.inf

    # ---- the filter ------------------------------------------------------------------------------

    def _process(self, message: Message) -> None:
        if not self._begun or message.stamp_s < self._until_s:
            return
        self._until_s = message.stamp_s
        if isinstance(message, WheelOdometry):
            self._on_wheels(message)
        elif isinstance(message, UntrackedOdometry):
            self._on_odometry(message)
        else:
            self._on_sighting(message)

    def _on_wheels(self, wheels: WheelOdometry) -> None:
        if self._wheels is not None:
            x, F, Q = moved_by_wheels(
                self._x[:STATES], self._wheels, wheels, self._rules.wheels, self._reader
            )
            self._move(slice(0, STATES), x, F, Q)
        self._wheels, at = wheels, self._moved or wheels
        off_m = float(np.hypot(wheels.x_m - at.x_m, wheels.y_m - at.y_m))
        if max(off_m, abs(rotations.wrap(wheels.yaw_rad - at.yaw_rad))) > self._rules.stands:
            at = wheels
        self._moved = at

    def _on_odometry(self, odometry: UntrackedOdometry) -> None:
        self._odometry[odometry.vehicle] = odometry
        vehicle = self._vehicles.get(odometry.vehicle)
        if vehicle is not None:
            self._move_vehicle(odometry.vehicle, odometry.stamp_s, odometry)

    def _move_vehicle(
        self, name: str, until_s: float, odometry: Optional[UntrackedOdometry]
    ) -> None:
        """The vehicle moves by its odometry and drift; without odometry it holds and wanders."""
        at, since_s, before = self._vehicles[name]
        dt_s = until_s - since_s
        own = slice(at, at + _OF_VEHICLE)
        x, F, Q = _moved_vehicle(self._x[own], dt_s, before, odometry, self._rules)
        self._move(own, x, F, Q)
        self._vehicles[name] = _Tracked(at, until_s, odometry or before)

    def _move(self, part: slice, x: np.ndarray, F: np.ndarray, Q: np.ndarray) -> None:
        """The state where one part of it has moved."""
        self._x[part] = x
        self._P[part] = F @ self._P[part]
        self._P[:, part] = self._P[:, part] @ F.T
        self._P[part, part] += Q

    def _on_sighting(self, seen: VehicleSighting) -> None:
        if self._wheels is None:
            return
        last_s = self._sighted_s.get(seen.vehicle, -np.inf)
        if seen.stamp_s - last_s < self._rules.sighting_s:
            return
        self._wheels_until(seen.stamp_s)
        R = self._noise(seen)
        if seen.vehicle not in self._vehicles:
            self._meet(seen, R)
        elif not self._update(seen, R):
            return
        self._sighted_s[seen.vehicle], self._used = seen.stamp_s, self._used + 1

    def _wheels_until(self, stamp_s: float) -> None:
        """The robot at a picture's stamp: between two readings of its wheels."""
        later = next((m for m in self._newest if m.stamp_s >= stamp_s), None)
        if later is not None and later.stamp_s > self._wheels.stamp_s:
            self._on_wheels(between(self._wheels, later, stamp_s))

    def _noise(self, seen: VehicleSighting) -> np.ndarray:
        r = self._rules
        floor_m = np.radians(r.floor_deg) * float(np.hypot(seen.x_m, seen.y_m))
        least = [r.least_m**2 + floor_m**2] * 2 + [np.radians(r.least_deg) ** 2]
        return np.asarray(seen.covariance, float) + np.diag(least)

    def _meet(self, seen: VehicleSighting, R: np.ndarray) -> None:
        """A vehicle that is seen for the first time stands where it is seen from the robot."""
        at, size = len(self._x), len(self._x) + _OF_VEHICLE
        yaw = self._x[2]
        turn = _turn(yaw)
        rel = np.array([seen.x_m, seen.y_m, seen.yaw_rad])
        x, P = np.zeros(size), np.zeros((size, size))
        x[:at], P[:at, :at] = self._x, self._P
        x[at : at + 3] = self._x[:3] + turn @ rel
        J = np.zeros((3, at))
        J[:, :3] = np.eye(3)
        J[:2, 2] = _across(turn[:2, :2] @ rel[:2])
        P[at : at + 3, :at] = J @ self._P
        P[:at, at : at + 3] = P[at : at + 3, :at].T
        P[at : at + 3, at : at + 3] = J @ self._P @ J.T + turn @ R @ turn.T
        P[at + 3, at + 3] = P[at + 4, at + 4] = self._rules.drift_mps**2
        self._x, self._P = x, P
        odometry = self._odometry.get(seen.vehicle)
        self._vehicles[seen.vehicle] = _Tracked(at, seen.stamp_s, odometry)

    def _update(self, seen: VehicleSighting, R: np.ndarray) -> bool:
        """Joseph's form, which keeps the covariance positive; whether the sighting was used."""
        vehicle = self._vehicles[seen.vehicle]
        if seen.stamp_s > vehicle.moved_s and vehicle.odometry is None:
            self._move_vehicle(seen.vehicle, seen.stamp_s, None)
        H, expected = _expected(self._x, vehicle.at)
        off = np.array([seen.x_m, seen.y_m, seen.yaw_rad]) - expected
        off[2] = rotations.wrap(float(off[2]))
        S = H @ self._P @ H.T + R
        d2 = float(off @ np.linalg.solve(S, off))
        if d2 > self._bound:
            self._in_a_row += 1
            self._refuse(f"a sighting of {seen.vehicle} lies {np.sqrt(d2):.1f} sigma away")
            return False
        self._in_a_row = 0
        K = np.linalg.solve(S, H @ self._P).T
        keep = np.eye(len(self._x)) - K @ H
        self._x = self._x + K @ off
        self._P = keep @ self._P @ keep.T + K @ R @ K.T
        return True

    def _refuse(self, why: str) -> None:
        self._refused, self._why = self._refused + 1, why


def _moved_vehicle(
    x: np.ndarray,
    dt_s: float,
    before: Optional[UntrackedOdometry],
    after: Optional[UntrackedOdometry],
    rules: CooperativeRules,
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A vehicle's part of the state after ``dt_s``, its Jacobian and noise (5,5)."""
    new, F = np.array(x), np.eye(_OF_VEHICLE)
    Q = np.diag([0.0, 0.0, 0.0, 1.0, 1.0]) * rules.drift_change**2 * dt_s
    F[0, 3] = F[1, 4] = dt_s
    new[:2] += dt_s * x[3:5]
    if before is None or after is None:
        Q[0, 0] = Q[1, 1] = rules.wander_m**2 * dt_s
        Q[2, 2] = np.radians(rules.wander_deg) ** 2 * dt_s
        return new, F, Q
    moved = _turn(x[2] - before.yaw_rad)[:2, :2] @ [after.x_m - before.x_m, after.y_m - before.y_m]
    new[:2] += moved
    new[2] += rotations.wrap(after.yaw_rad - before.yaw_rad)
    F[:2, 2] = _across(moved)
    Q[0, 0] = Q[1, 1] = rules.odometry_noise_m**2 * float(np.hypot(*moved))
    Q[2, 2] = np.radians(rules.odometry_yaw_deg) ** 2 * dt_s
    return new, F, Q


def _expected(x: np.ndarray, at: int) -> Tuple[np.ndarray, np.ndarray]:
    """The sighting's Jacobian (3, len(x)) and what it should be: the vehicle in the robot's
    frame."""
    back = _turn(-x[2])
    away = x[at : at + 2] - x[:2]
    rel = back[:2, :2] @ away
    H = np.zeros((3, len(x)))
    H[:2, :2], H[:2, at : at + 2] = -back[:2, :2], back[:2, :2]
    H[:2, 2] = -_across(rel)
    H[2, 2], H[2, at + 2] = -1.0, 1.0
    return H, np.array([rel[0], rel[1], x[at + 2] - x[2]])


def _turn(yaw_rad: float) -> np.ndarray:
    """(3,3) that turns x and y by an angle and keeps a yaw."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _across(v: np.ndarray) -> np.ndarray:
    """How (2,) moves with a turn: its derivative to the angle."""
    return np.array([-v[1], v[0]])


def _refusal(now_s: float, message: Message) -> str:
    """Why a message cannot be used whatever the filter says; empty where it can."""
    what = type(message).__name__
    numbers = [message.stamp_s, message.x_m, message.y_m, message.yaw_rad]
    C = getattr(message, "covariance", None)
    if not np.isfinite(numbers).all():
        return f"a {what} is not finite"
    if C is not None:
        C = np.asarray(C, float)
        if C.shape != (3, 3) or not np.isfinite(C).all() or not np.allclose(C, C.T):
            return f"a {what} has a covariance that is none"
        least = np.linalg.eigvalsh(C)[0]
        if least < 0.0 or (least <= 0.0 and isinstance(message, VehicleSighting)):
            return f"a {what} has a covariance that is none"
    ahead = ahead_of_clock(now_s, message.stamp_s)
    return ahead and f"a {what} {ahead}"
