# SPDX-License-Identifier: Apache-2.0
"""A robot that drives past two vehicles which hold, located by the gimbals on it (thesis 4.1):
pictures or corners, detector, trackers, servos, wheels and odometries in simulated time, and every
place that comes out against the truth."""

import heapq
from dataclasses import dataclass, field
from functools import partial
from typing import Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.place.cooperative_place import (
    CooperativeRules,
    CooperativeTracker,
    Message,
    RobotStart,
    UntrackedOdometry,
    VehicleSighting,
)
from fcsv_guidance.place.tracker import WheelOdometry
from fcsv_guidance.robot import Robot
from fcsv_sim.robot.drive import SimulatedRobot, WheelFlaws
from fcsv_sim.trials.gimbal_evaluation import START_S, Setup, follow
from fcsv_tracking.gimbal.config import Gimbal

_STEP_S = 0.02
_WHEELS_S, _ODOMETRY_S, _ODOMETRY_LATE_S = 0.04, 0.05, 0.06
_REACHED_M, _AHEAD_M = 0.1, 0.4


@dataclass(frozen=True)
class Held:
    """How a vehicle holds: by flow whose speed is off by ``flow_bias_mps`` per axis (standard
    deviation), in gusts. Its odometry knows of the gusts, not of the bias."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float = 0.0
    flow_bias_mps: float = 0.02
    gust_m: float = 0.08
    gust_s: float = 2.5
    odometry_m: float = 0.01  # in a root second
    odometry_yaw_deg: float = 0.1  # in a root second
    lean_deg: float = 1.5
    flow_scale: float = 0.03  # standard deviation of true over measured way
    speed_mps: float = 0.4  # of a vehicle that is sent elsewhere


@dataclass(frozen=True)
class Drive:
    """Where the robot goes (x, y in m, from the origin on), how fast, and how long it stands
    first."""

    points_m: Tuple[Tuple[float, float], ...] = ((2.0, 0.5), (4.0, -0.5), (6.0, 0.0))
    speed_mps: float = 0.3
    stands_s: float = 6.0
    start_m: float = 0.005  # standard deviation of where it is said to stand
    start_deg: float = 0.3


@dataclass
class JudgedPlace:
    """One place that was given out: errors in home (m, degrees), what it said of them, and how far
    each vehicle was."""

    stamp_s: float
    error_m: float
    error_deg: float
    sigma_m: float
    sigma_deg: float
    distances_m: Tuple[float, ...]


@dataclass
class DriveOutcome:
    """All that one drive gave."""

    judged: List[JudgedPlace] = field(default_factory=list)
    unknown: int = 0
    way_m: float = 0.0
    drifted_m: Tuple[float, ...] = ()


class _Ground:
    """The robot's true poses, evenly in time; between them by a straight line."""

    def __init__(self, poses: np.ndarray):
        self._poses = poses  # (N,3) x, y, yaw without jumps of a turn

    def at(self, stamp_s: float) -> Tuple[float, float, float]:
        place = np.clip((stamp_s - START_S) / _STEP_S, 0.0, len(self._poses) - 1.001)
        i = int(place)
        x, y, yaw = self._poses[i] + (place - i) * (self._poses[i + 1] - self._poses[i])
        return float(x), float(y), float(yaw)

    def T_world_ground(self, stamp_s: float) -> np.ndarray:
        x, y, yaw = self.at(stamp_s)
        return transforms.from_xyz_yaw([x, y, 0.0], yaw)


class HeldVehicle:
    """A vehicle that holds in the world from ``start_s`` on, and what its odometry says."""

    def __init__(self, held: Held, duration_s: float, seed: int, start_s: float = START_S):
        self._start_s = start_s
        random = np.random.default_rng([seed, 31])
        n = int(duration_s / _STEP_S) + 2
        t = _STEP_S * np.arange(n)
        self._held = held
        bias = held.flow_bias_mps * random.standard_normal(2)
        keep = np.exp(-_STEP_S / held.gust_s)
        gusts = _walk(random, n, keep, held.gust_m * np.sqrt(1.0 - keep**2), 3)
        lean = np.radians(held.lean_deg) * _walk(random, n, 0.97, np.sqrt(1 - 0.97**2), 2)
        swing = np.radians(1.5) * np.sin(0.4 * t + random.uniform(0.0, 6.28))
        self._xyz = np.array([held.x_m, held.y_m, held.z_m]) + gusts
        self._xyz[:, :2] += t[:, None] * bias
        self._rpy = np.column_stack([lean, held.yaw_rad + swing])
        root = np.sqrt(_STEP_S)
        off = np.cumsum(root * held.odometry_m * random.standard_normal((n, 2)), axis=0)
        off_yaw = np.cumsum(root * np.radians(held.odometry_yaw_deg) * random.standard_normal(n))
        self._turn_rad = float(random.uniform(-np.pi, np.pi))
        said = (gusts[:, :2] + off) @ rotations.turn_about_z(self._turn_rad)[:2, :2].T
        self._said = np.column_stack([said, swing + off_yaw])
        self.drifted_m = float(np.linalg.norm(bias) * duration_s)
        self._scale = 1.0 + held.flow_scale * random.standard_normal()

    def T_world_body(self, stamp_s: float) -> np.ndarray:
        place = np.clip((stamp_s - self._start_s) / _STEP_S, 0.0, len(self._xyz) - 1.001)
        i, share = int(place), place - int(place)
        xyz = self._xyz[i] + share * (self._xyz[i + 1] - self._xyz[i])
        return transforms.from_xyz_rpy(
            xyz, self._rpy[i] + share * (self._rpy[i + 1] - self._rpy[i])
        )

    def fly(self, now_s: float, way_m: np.ndarray, turned_rad: float) -> None:
        """It flies ``way_m`` (2,) from now on by its odometry, in a frame that is believed to be
        turned by ``turned_rad`` against that."""
        i = int(np.ceil((now_s - self._start_s) / _STEP_S))
        own = rotations.turn_about_z(turned_rad)[:2, :2] @ way_m
        length_m = float(np.hypot(*own))
        steps_m = self._held.speed_mps * _STEP_S * np.arange(len(self._said) - i)
        ramp = np.clip(steps_m / max(length_m, 1e-6), 0.0, 1.0)[:, None]
        # what its odometry takes for its heading is off by what its yaw drifted
        off_rad = self._turn_rad + self._said[i, 2] - self._rpy[i, 2]
        true = self._scale * rotations.turn_about_z(-off_rad)[:2, :2] @ own
        self._said[i:, :2] += ramp * own
        self._xyz[i:, :2] += ramp * true

    def odometry(self, name: str, stamp_s: float) -> UntrackedOdometry:
        """What it says of its way, in a frame of its own with a heading of its own."""
        i = int(round((stamp_s - self._start_s) / _STEP_S))
        x, y, yaw = self._said[i]
        return UntrackedOdometry(stamp_s, name, float(x), float(y), float(yaw + self._turn_rad))


class _FromRobot:
    """A vehicle as the robot's frame has it."""

    def __init__(self, ground: _Ground, vehicle: HeldVehicle):
        self._ground, self._vehicle = ground, vehicle

    def at(self, stamp_s: float) -> np.ndarray:
        """T_G_D."""
        T_world_ground = self._ground.T_world_ground(stamp_s)
        return transforms.invert(T_world_ground) @ self._vehicle.T_world_body(stamp_s)


def drive(
    robot: Robot,
    gimbals: Sequence[Gimbal],
    vehicles: Sequence[Held],
    seed: int,
    plan: Drive = Drive(),
    setup: Optional[Setup] = None,
    rules: Optional[CooperativeRules] = None,
) -> DriveOutcome:
    """One drive past vehicles that hold, one gimbal for each; somebody who sees the truth
    steers. Without a ``setup`` no pictures are drawn: corners have the noise that the detector
    leaves on drawn ones."""
    setup, rules = setup or Setup(corners_px=0.05), rules or CooperativeRules()
    ground, wheels = _driven(robot, plan, seed)
    duration_s = wheels[-1].stamp_s - START_S
    held = {
        g.vehicle: HeldVehicle(v, duration_s, 10 * seed + k)
        for k, (g, v) in enumerate(zip(gimbals, vehicles))
    }
    outcome = DriveOutcome(drifted_m=tuple(v.drifted_m for v in held.values()))
    tracker = CooperativeTracker(rules)
    tracker.receive(START_S, _start(ground, plan, seed))
    messages = _messages(gimbals, ground, held, wheels, seed, setup, duration_s)
    next_s, last = START_S + 2.0, ground.at(START_S)
    for arrival_s, message in messages:
        while next_s < arrival_s:
            state = tracker.step(next_s).robot
            if state.place is None:
                outcome.unknown += 1
            else:
                outcome.judged.append(_judged(state, ground, held))
            here = ground.at(next_s)
            outcome.way_m += float(np.hypot(here[0] - last[0], here[1] - last[1]))
            last, next_s = here, next_s + 0.1
        tracker.receive(arrival_s, message)
    return outcome


def _driven(robot: Robot, plan: Drive, seed: int) -> Tuple[_Ground, List[WheelOdometry]]:
    """The way to the last point."""
    random = np.random.default_rng([seed, 32])
    body = SimulatedRobot(robot, (0.0, 0.0, 0.0), WheelFlaws.drawn(random), seed)
    poses, wheels, ahead, yaw = [], [], list(plan.points_m), 0.0
    step = 0
    while ahead and step < 30000:
        now_s = _STEP_S * step
        if now_s > plan.stands_s:
            body.command(now_s, _towards(body, ahead[0], plan.speed_mps))
        body.step(now_s)
        yaw += float(np.arctan2(np.sin(body.yaw_rad - yaw), np.cos(body.yaw_rad - yaw)))
        poses.append((body.x_m, body.y_m, yaw))
        if step % int(round(_WHEELS_S / _STEP_S)) == 0:
            said = body.odometry()
            wheels.append(WheelOdometry(START_S + now_s, said.x_m, said.y_m, said.yaw_rad))
        if np.hypot(body.x_m - ahead[0][0], body.y_m - ahead[0][1]) < _REACHED_M:
            ahead.pop(0)
        step += 1
    return _Ground(np.array(poses)), wheels


def _towards(body: SimulatedRobot, point: Tuple[float, float], speed_mps: float) -> DriveCommand:
    bearing = np.arctan2(point[1] - body.y_m, point[0] - body.x_m) - body.yaw_rad
    bearing = float(np.arctan2(np.sin(bearing), np.cos(bearing)))
    return DriveCommand(speed_mps * max(0.0, np.cos(bearing)), 1.2 * bearing)


def _start(ground: _Ground, plan: Drive, seed: int) -> RobotStart:
    sigma = np.array([plan.start_m, plan.start_m, np.radians(plan.start_deg)])
    x, y, yaw = np.array(ground.at(START_S)) + sigma * np.random.default_rng(
        [seed, 33]
    ).standard_normal(3)
    return RobotStart(START_S, float(x), float(y), float(yaw), np.diag(sigma**2))


def _messages(
    gimbals, ground: _Ground, held: Dict[str, HeldVehicle], wheels, seed, setup, duration_s
) -> Iterator[Tuple[float, Message]]:
    """(arrival, message) in the order of arrival."""
    found: List[Tuple[float, int, Message]] = [
        (w.stamp_s + 0.005, k, w) for k, w in enumerate(wheels)
    ]
    for k, gimbal in enumerate(gimbals):
        vehicle = held[gimbal.vehicle]
        seen_from = _FromRobot(ground, vehicle)
        run = follow(
            gimbal, seen_from, duration_s - 0.5, 10 * seed + k, setup, partial(_newest, wheels)
        )
        for arrival_s, pose in run.given:
            seen = VehicleSighting.of_pose(
                pose.stamp_s, gimbal.vehicle, pose.T_G_D, pose.covariance
            )
            found.append((arrival_s, len(found), seen))
        for n in range(int((duration_s - 0.5) / _ODOMETRY_S)):
            said = vehicle.odometry(gimbal.vehicle, START_S + n * _ODOMETRY_S)
            found.append((said.stamp_s + _ODOMETRY_LATE_S, len(found), said))
    heapq.heapify(found)
    while found:
        arrival_s, _, message = heapq.heappop(found)
        yield arrival_s, message


def _newest(wheels: Sequence[WheelOdometry], now_s: float) -> Tuple[float, np.ndarray]:
    """(stamp, T_O_G) of what the wheels said last."""
    w = wheels[int(np.clip((now_s - START_S - 0.005) / _WHEELS_S, 0, len(wheels) - 1))]
    return w.stamp_s, transforms.from_xyz_yaw([w.x_m, w.y_m, 0.0], w.yaw_rad)


def _judged(state, ground: _Ground, held: Dict[str, HeldVehicle]) -> JudgedPlace:
    place = state.place
    x, y, yaw = ground.at(place.stamp_s)
    turned = np.degrees(np.arctan2(np.sin(place.yaw_rad - yaw), np.cos(place.yaw_rad - yaw)))
    away = [
        float(np.linalg.norm(v.T_world_body(place.stamp_s)[:3, 3] - [x, y, 0.4]))
        for v in held.values()
    ]
    return JudgedPlace(
        place.stamp_s,
        float(np.hypot(place.x_m - x, place.y_m - y)),
        float(turned),
        place.sigma_m,
        float(np.degrees(state.yaw_sigma_rad)),
        tuple(away),
    )


def _walk(random: np.random.Generator, n: int, keep: float, step: float, size: int) -> np.ndarray:
    """(n, size): what decays to ``keep`` from step to step, and is pushed by ``step``."""
    pushes = random.standard_normal((n, size))
    found = np.zeros((n, size))
    for k in range(1, n):
        found[k] = keep * found[k - 1] + step * pushes[k]
    return found
