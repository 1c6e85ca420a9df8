# SPDX-License-Identifier: Apache-2.0
"""A rehearsed robot's place by the gimbals on it, which see two vehicles that hold, drift and follow
in steps; and where these hold so that the gimbals see one all along a way."""

from dataclasses import dataclass, replace
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.trajectory import Trajectory
from fcsv_guidance.cooperative_place import (
    CooperativeState,
    CooperativeTracker,
    RobotStart,
    VehicleSighting,
)
from fcsv_guidance.following import Polyline
from fcsv_guidance.place import LevelPlace, PlaceState, WheelOdometry
from fcsv_guidance.steps import DriveInSteps, MoveVehicle
from fcsv_sim.gimbal.reach import gimbal_problem
from fcsv_sim.robot.contact import TrueGround
from fcsv_sim.robot.drive import SimulatedRobot
from fcsv_sim.robot.gimbal_survey import SETUP, START_YAW_RAD, gimbal_seed
from fcsv_sim.robot.locator import RADIO_S, every
from fcsv_sim.trials.gimbal_evaluation import READ_HZ, GimbalLoop
from fcsv_sim.trials.robot_among_vehicles import Held, HeldVehicle
from fcsv_tracking.gimbal.config import Gimbal

_ODOMETRY_S, _ODOMETRY_LATE_S = 0.05, 0.06
# of where the robot is said to stand: home is what the gimbals see from there
_START_M, _START_RAD = 0.002, np.radians(0.1)
_HOLD_HEIGHT_M = 1.8  # above the ground
_AROUND_M, _STEP_M = 2.4, 0.4  # of the way, in which vehicles may hold, and the lattice there
_BESIDE_M = 0.6  # from the robot's way: nothing shall fall on it
_APART_M = 1.2
_PASS_M = 1.0  # off the robot and the other vehicle, of a vehicle that flies to its place
_BEST_M = 2.2  # level, from the robot: not steep, and 1.5 m before tags are too small
_NEAR_M, _FAR_M = 1.5, 3.7  # of a vehicle from the robot, level and in space: 0.3 m are drift's
_ALONG_M = 0.25
_AHEAD_M = 2.5  # of the way, beside which vehicles that follow hold
_SPARE_RAD = np.radians(8.0)  # to the limits of pan: half the picture


@dataclass(frozen=True)
class HoldPlaces:
    """Where each gimbal's vehicle holds; ``seen``: the share of the way along which a gimbal has
    its vehicle near enough, ``seen_twice``: both."""

    held: Tuple[Held, ...]
    seen: float
    seen_twice: float

    def in_words(self) -> str:
        """Says where they hold, and how much of the way they serve."""
        at = " and ".join(f"({h.x_m:.1f}, {h.y_m:.1f})" for h in self.held)
        return f"vehicles hold at {at} m: one seen along {self.seen:.0%}, both along {self.seen_twice:.0%} of the way"


def hold_places(
    way_m: np.ndarray,
    ground_z_m: float,
    gimbals: Sequence[Gimbal],
    yaw_rad: float = START_YAW_RAD,
    from_m: Sequence[Tuple[float, float]] = (),
) -> Optional[HoldPlaces]:
    """The places for two vehicles from which their gimbals see most of a way (N,2), world, and
    which both see from its start, where the robot stands with ``yaw_rad``; neither is above it.
    From ``from_m``, where they are now, they come there past the robot, and past the place where
    the other is now. None where there are none."""
    line = Polyline.of(np.asarray(way_m, float))
    along = line.at(np.append(np.arange(0.0, line.length_m, _ALONG_M), line.length_m))
    low, high = along.min(0) - _AROUND_M, along.max(0) + _AROUND_M
    axes = [np.arange(a, b, _STEP_M) for a, b in zip(low, high)]
    at = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    level = np.hypot(*(at[:, None] - along[None]).transpose(2, 0, 1))
    kept = level.min(1) >= _BESIDE_M
    at, level = at[kept], level[kept]
    eye_m = gimbals[0].geometry.base.xyz_m[2]
    away = np.hypot(level, _HOLD_HEIGHT_M - eye_m)
    sees = (away <= _FAR_M) & (level >= _NEAR_M) & _within_limits(at, along, gimbals[0])
    T_ground_world = transforms.invert(transforms.from_xyz_yaw([*along[0], ground_z_m], yaw_rad))
    bodies = [transforms.from_xyz_yaw([*xy, ground_z_m + _HOLD_HEIGHT_M], 0.0) for xy in at]
    able = [
        [i for i, T in enumerate(bodies) if not gimbal_problem(g, T_ground_world @ T)]
        for g in gimbals
    ]
    for k in range(len(from_m)):
        kept_off = along[0], from_m[1 - k]
        able[k] = [i for i in able[k] if all(_passes(from_m[k], at[i], o) for o in kept_off)]
    best, chosen, off_m = (-1.0, -1.0, 0.0), None, np.abs(level - _BEST_M).mean(1)
    for i in able[0]:
        js = [j for j in able[1] if np.hypot(*(at[i] - at[j])) >= _APART_M]
        if js:
            one, both = (f(sees[i], sees[js]).mean(1) for f in (np.logical_or, np.logical_and))
            k = np.lexsort((-off_m[js], both, one))[-1]
            found = float(one[k]), float(both[k]), -off_m[i] - off_m[js[k]]
            if found > best:
                best, chosen = found, (i, js[k])
    if chosen is None:
        return None
    z = ground_z_m + _HOLD_HEIGHT_M
    held = tuple(Held(float(at[i, 0]), float(at[i, 1]), z) for i in chosen)
    return HoldPlaces(held, *best[:2])


def _passes(a_m: Tuple[float, float], b_m: np.ndarray, other_m: np.ndarray) -> bool:
    """Whether straight on from ``a_m`` to ``b_m`` a vehicle keeps off ``other_m`` by _PASS_M, or
    comes no nearer to it than it is."""
    line = np.linspace(a_m, b_m, 12) - other_m
    return bool(np.hypot(*line.T).min() >= min(_PASS_M, float(np.hypot(*line[0])) - 0.05))


def _within_limits(at: np.ndarray, along: np.ndarray, gimbal: Gimbal) -> np.ndarray:
    """(N,M) bool: whether the gimbal of a robot that drives through ``along`` (M,2) can turn to
    places ``at`` (N,2), with the heading with which it comes, and that with which it leaves."""
    steps = np.diff(along, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    off = at[:, None] - along[None]
    bearings = np.arctan2(off[..., 1], off[..., 0])
    most = np.radians(min(np.abs(gimbal.geometry.pan_limits_deg))) - _SPARE_RAD
    able = np.ones(bearings.shape, bool)
    for heading in (np.append(headings[:1], headings), np.append(headings, headings[-1:])):
        able &= np.cos(bearings - heading) >= np.cos(most)
    return able


class GimbalPlaces:
    """Gimbals on the robot watch vehicles that hold, and follow along ``way_m`` (N,2) in steps (System
    I); a RobotLocator. The first sights are taken while the robot stands, as long as ``settle_s``."""

    settle_s = 6.0

    def __init__(
        self,
        gimbals: Sequence[Gimbal],
        held: Sequence[Held],
        true: TrueGround,
        start: Tuple[float, float, float],
        place_seed: int,
        seed: int,
        longest_s: float,
        way_m: np.ndarray,
    ):
        self._gimbals, self._line = gimbals, Polyline.of(np.asarray(way_m, float))
        self._ground_z_m = held[0].z_m - _HOLD_HEIGHT_M
        self._way = _TrueWay(true, start)
        names = [g.vehicle for g in gimbals]
        self._vehicles: Dict[str, HeldVehicle] = {
            name: HeldVehicle(h, longest_s + 1.0, 10 * seed + k, 0.0)
            for k, (name, h) in enumerate(zip(names, held))
        }
        self._loops: Dict[str, GimbalLoop] = {}
        for k, gimbal in enumerate(gimbals):
            seen_from = _SeenFromRobot(self._way, self._vehicles[gimbal.vehicle])
            own = gimbal_seed(place_seed, k)
            self._loops[gimbal.vehicle] = GimbalLoop(gimbal, seen_from, own, SETUP, 0.0)
        self._tracker, self._steps = CooperativeTracker(), DriveInSteps(self._choose)
        sigma = np.array([_START_M, _START_M, _START_RAD])
        off = sigma * np.random.default_rng([seed, 33]).standard_normal(3)
        x, y, yaw = map(float, np.array(start) + off)
        self._tracker.receive(0.0, RobotStart(0.0, x, y, yaw, np.diag(sigma**2)))
        self._tick, self._wheels = 0, WheelOdometry(0.0, 0.0, 0.0, 0.0)

    def sense(self, now_s: float, machine: SimulatedRobot) -> Iterable[Tuple[float, object]]:
        """Sightings, and what the vehicles' odometries say: (arrival, message)."""
        self._way.add(now_s, machine.x_m, machine.y_m, machine.yaw_rad)
        found: List[Tuple[float, object]] = []
        w = self._wheels
        wheels = w.stamp_s, transforms.from_xyz_yaw([w.x_m, w.y_m, 0.0], w.yaw_rad)
        while self._tick / READ_HZ < now_s - 1e-9:
            tick_s = self._tick / READ_HZ
            for name, loop in self._loops.items():
                for _, pose in loop.step(tick_s, wheels).heard:
                    if pose is not None:
                        seen = VehicleSighting.of_pose(
                            pose.stamp_s, name, pose.T_G_D, pose.covariance
                        )
                        found.append((tick_s + RADIO_S, seen))
            self._tick += 1
        self._wheels = machine.odometry()
        if every(now_s, _ODOMETRY_S):
            for name, vehicle in self._vehicles.items():
                found.append((now_s + _ODOMETRY_LATE_S, vehicle.odometry(name, now_s)))
        return found

    def receive(self, now_s: float, message: object) -> None:
        """A message arrived."""
        self._tracker.receive(now_s, message)

    def step(self, now_s: float) -> PlaceState:
        """The place as of now."""
        state = self._tracker.step(now_s)
        advice = self._steps.step(now_s, state)
        if advice.move is not None:
            self._send(now_s, advice.move, state.vehicles[advice.move.vehicle])
        return replace(state.robot, hold=advice.hold)

    def _choose(self, state: CooperativeState) -> Dict[str, Tuple[float, float]]:
        """The places beside the next part of the way; none where there are none."""
        place, names = state.robot.place, [gimbal.vehicle for gimbal in self._gimbals]
        if not all(name in state.vehicles for name in names):
            return {}
        along = np.arange(0.0, self._line.length_m, 0.1)
        off_m = np.hypot(*(self._line.at(along) - [place.x_m, place.y_m]).T)
        at_m = along[int(np.argmin(off_m))]
        ahead = self._line.at(np.linspace(at_m, at_m + _AHEAD_M, 12))
        way_m = np.vstack([[place.x_m, place.y_m], ahead])
        now_m = [(state.vehicles[n].x_m, state.vehicles[n].y_m) for n in names]
        found = hold_places(way_m, self._ground_z_m, self._gimbals, place.yaw_rad, now_m)
        return {} if found is None else {n: (h.x_m, h.y_m) for n, h in zip(names, found.held)}

    def _send(self, now_s: float, move: MoveVehicle, believed: LevelPlace) -> None:
        """Sends a vehicle its way, turned into the frame of its odometry."""
        way_m = np.array([move.x_m - believed.x_m, move.y_m - believed.y_m])
        vehicle = self._vehicles[move.vehicle]
        said = vehicle.odometry(move.vehicle, now_s)
        vehicle.fly(now_s + RADIO_S, way_m, said.yaw_rad - believed.yaw_rad)


class _TrueWay:
    """Where the robot truly was, and how it stood on the ground."""

    def __init__(self, true: TrueGround, start: Tuple[float, float, float]):
        self._true, self._poses = true, Trajectory(np.inf)
        self._poses.add(0.0, true.T_world_robot(*start))

    def add(self, stamp_s: float, x_m: float, y_m: float, yaw_rad: float) -> None:
        """It is there now."""
        self._poses.add(stamp_s, self._true.T_world_robot(x_m, y_m, yaw_rad))

    def at(self, stamp_s: float) -> np.ndarray:
        """T_world_robot; it stands before the first step, and after the last."""
        return self._poses.at(float(np.clip(stamp_s, *self._poses.span_s)))


class _SeenFromRobot:
    """A vehicle as the robot's frame has it."""

    def __init__(self, way: _TrueWay, vehicle: HeldVehicle):
        self._way, self._vehicle = way, vehicle

    def at(self, stamp_s: float) -> np.ndarray:
        """T_G_D."""
        return transforms.invert(self._way.at(stamp_s)) @ self._vehicle.T_world_body(stamp_s)
