# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello's dynamics under the PID, with poses as trackers on the ground give them: late, noisy, with gaps."""

from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from fcsv_control.tello.observer import Observer, ObserverRules
from fcsv_control.tello.pid import ATTITUDE, PidConfig, PositionPid, Sticks
from fcsv_geometry import transforms
from fcsv_geometry.rotations import wrap
from fcsv_sim.autopilot.controller import Controller
from fcsv_sim.vehicles.dynamics import STEP_S, Quadrotor
from fcsv_sim.vehicles.tello import SimulatedTello, TelloParameters, tello_airframe
from fcsv_sim.vehicles.vehicle import yaw_of

STEP_OF_LINK_S = 0.04


@dataclass(frozen=True)
class Poses:
    """How a tracker sees: rate, delay and its spread (s), standard deviations (docs/mocap.md, docs/gimbal.md), and how
    often a gap of ``gap_s`` begins."""

    rate_hz: float
    delay_s: float
    jitter_s: float
    sigma_m: float
    sigma_deg: float
    gap_share: float = 0.0
    gap_s: float = 0.0


MOCAP = Poses(20.0, 0.11, 0.01, 0.0018, 0.3)
GIMBALS = Poses(8.0, 0.13, 0.03, 0.006, 0.67, gap_share=0.1, gap_s=0.4)


class SeenPoses:
    """take() at each moment; poses that have arrived, as (stamp_s, T)."""

    def __init__(self, kind: Poses, seed: int):
        self._kind, self._random = kind, np.random.default_rng([seed, 77])
        self._next_s, self._under_way = 0.0, []  # type: float, List[Tuple[float, float, np.ndarray]]

    def take(self, now_s: float, T_world_body: np.ndarray) -> List[Tuple[float, np.ndarray]]:
        k, random = self._kind, self._random
        if now_s >= self._next_s:
            self._next_s = now_s + 1.0 / k.rate_hz + (k.gap_s if random.uniform() < k.gap_share else 0.0)
            noisy = transforms.from_xyz_rpy(
                T_world_body[:3, 3] + random.normal(0.0, k.sigma_m, 3),
                transforms.rpy(T_world_body) + np.radians(random.normal(0.0, k.sigma_deg, 3)),
            )
            self._under_way.append((now_s + k.delay_s + abs(random.normal(0.0, k.jitter_s)), now_s, noisy))
        arrived = [(stamp_s, T) for arrives_s, stamp_s, T in self._under_way if arrives_s <= now_s]
        self._under_way = [p for p in self._under_way if p[0] > now_s]
        return arrived


class VelocityPlant:
    """fcsv_sim's Tello: holds the velocity of its sticks by a flow sensor that is off."""

    def __init__(self, folder, seed: int, wind_mps: float, flow_bias_mps: float):
        self.tello = SimulatedTello(
            TelloParameters("tello1", str(folder), seed, (0.0, 0.0, 0.0, 0.3), wind_mps, flow_bias_mps), 0.0
        )
        self.tello.take_off()
        self.tello.advance_to(0.2)
        now_s = 0.0
        while self.tello.mode != "FLY":
            now_s += 0.1
            self.tello.advance_to(now_s)
        self.now_s = now_s

    @property
    def T_world_body(self) -> np.ndarray:
        return self.tello.body.T_world_body

    def advance(self, now_s: float, asked: np.ndarray, turn_rps: float) -> None:
        self.tello.stick(now_s, asked, turn_rps)
        self.tello.advance_to(now_s)
        self.now_s = now_s


class AttitudePlant:
    """The same airframe without flow: roll and pitch sticks are lean angles, and the wind takes it away."""

    def __init__(self, _folder, seed: int, wind_mps: float, _bias: float):
        self._body = Quadrotor(tello_airframe(), transforms.from_xyz_yaw([0.0, 0.0, 1.0], 0.3), seed, wind_mps)
        self._controller, self.now_s = Controller(self._body.hover_thrust), 0.0
        self._state = self._body.advance((0.0, 0.0, 0.0, self._body.hover_thrust), 1)[-1]

    @property
    def T_world_body(self) -> np.ndarray:
        return self._body.T_world_body

    def advance(self, now_s: float, asked: np.ndarray, turn_rps: float) -> None:
        while self.now_s < now_s - 1e-9:
            forward, left, up = asked
            yaw_of(self._state)
            command = self._controller.to_lean(
                -np.arctan2(left, 9.81), np.arctan2(forward, 9.81), turn_rps, up, float(self._state[5]), 0.01
            )
            self._state = self._body.advance(command, int(round(0.01 / STEP_S)))[-1]
            self.now_s += 0.01


@dataclass
class Flown:
    """Errors against the truth at each step: distance (m) and heading (deg), and the sticks."""

    time_s: np.ndarray
    off_m: np.ndarray
    off_deg: np.ndarray
    sticks: List[Sticks]


def fly(
    plant, kind: Poses, config: PidConfig, target: np.ndarray, seconds: float, seed: int = 1, predict: bool = True
) -> Flown:
    """Towards one target for some time. Without ``predict`` the pose is taken as if it were of now."""
    leans = config.command == ATTITUDE
    observer, pid, seen = Observer(ObserverRules(), leans), PositionPid(config), SeenPoses(kind, seed)
    begun_s, now_s, sticks, rows = plant.now_s, plant.now_s, Sticks(), []
    while now_s - begun_s < seconds:
        now_s += STEP_OF_LINK_S
        asked, turn_rps = pid.asked(sticks)
        plant.advance(now_s, asked, turn_rps)
        observer.step(now_s, asked, turn_rps)
        for stamp_s, T in seen.take(now_s, plant.T_world_body):
            observer.pose(now_s, stamp_s if predict else now_s, T)
        if observer.known:
            sticks = pid.sticks(STEP_OF_LINK_S, observer.T_odom_body, observer.v_mps, target)
        T = plant.T_world_body
        off_deg = abs(np.degrees(wrap(transforms.yaw(T) - transforms.yaw(target))))
        rows.append((now_s - begun_s, np.linalg.norm(T[:3, 3] - target[:3, 3]), off_deg, sticks))
    time_s, off_m, off_deg, given = zip(*rows)
    return Flown(np.array(time_s), np.array(off_m), np.array(off_deg), list(given))
