# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello's dynamics under the PID, with poses as trackers on the ground give them: late,
noisy, gapped."""

from dataclasses import dataclass
from pathlib import Path
from typing import List, Tuple

import numpy as np

from fcsv_control.tello.core import TelloCore
from fcsv_control.tello.messages import (
    FlightReport,
    GiveSticks,
    LandNow,
    LogReport,
    StayUp,
    TakeOffNow,
    TelloText,
)
from fcsv_control.tello.observer import Observer, ObserverRules
from fcsv_control.tello.pid import PidConfig, PositionPid, Sticks
from fcsv_control.tello.rules import TelloRules
from fcsv_geometry import config, transforms
from fcsv_geometry.rotations import wrap
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.tello.messages import TelloSticks as DroneSticks
from fcsv_sim.tello.vehicle import TelloDrone, TelloDroneParameters

STEP_OF_LINK_S = 0.04
CONFIG = Path(__file__).resolve().parents[2] / "config" / "tello"


@dataclass(frozen=True)
class Poses:
    """How a tracker sees: rate, delay and its spread (s), standard deviations (docs/lab/mocap.md,
    docs/lab/gimbal.md), and how often a gap of ``gap_s`` begins."""

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
            self._next_s = (
                now_s + 1.0 / k.rate_hz + (k.gap_s if random.uniform() < k.gap_share else 0.0)
            )
            noisy = transforms.from_xyz_rpy(
                T_world_body[:3, 3] + random.normal(0.0, k.sigma_m, 3),
                transforms.rpy(T_world_body) + np.radians(random.normal(0.0, k.sigma_deg, 3)),
            )
            self._under_way.append(
                (now_s + k.delay_s + abs(random.normal(0.0, k.jitter_s)), now_s, noisy)
            )
        arrived = [(stamp_s, T) for arrives_s, stamp_s, T in self._under_way if arrives_s <= now_s]
        self._under_way = [p for p in self._under_way if p[0] > now_s]
        return arrived


def drone(
    folder,
    seed: int,
    start_m=(0.0, 0.0),
    wind_mps: float = 0.5,
    bias_mps: float = 0.02,
    name: str = "tello1",
):
    """fcsv_sim's Tello but for its radio: sticks are lean angles, an axis that is let go brakes and
    is held by flow."""
    return TelloDrone(
        TelloDroneParameters(
            name, str(folder), seed, (*start_m, 0.0, 0.3), wind_mps=wind_mps, flow_bias_mps=bias_mps
        ),
        0.0,
    )


def give(tello: TelloDrone, now_s: float, s: Sticks) -> None:
    """As its link's sticks arrive."""
    tello.flight.on_command(now_s)
    tello.flight.sticks(
        now_s, DroneSticks(roll=-s.left, pitch=s.forward, throttle=s.up, yaw=-s.turn)
    )


class LinkedTello:
    """The link's core over a simulated Tello of fcsv_sim: flight data at 10 Hz, its log at 20 Hz,
    the tracker's poses, and what can go wrong with each. The frame is the world's."""

    def __init__(
        self, folder, seed: int, start_m=(0.0, 0.0), kind: Poses = MOCAP, name: str = "tello1"
    ):
        self.tello, self.now_s = drone(folder, seed, start_m, name=name), 0.0
        self.pid = config.load(CONFIG / "velocity.yaml", PidConfig)
        self.core = TelloCore(name, self.pid, TelloRules())
        self._seen, self._ticks = SeenPoses(kind, seed), 0
        self.battery_share, self.wifi, self.tracked, self.seen_off_m = 0.9, True, True, np.zeros(3)
        self.said: List[str] = []
        self.land_orders = self.lost_orders = 0

    @property
    def p_m(self) -> np.ndarray:
        return self.tello.body.position_m

    def off_m(self, target: np.ndarray) -> float:
        """From a target, by the truth."""
        return float(np.linalg.norm(self.p_m - target[:3, 3]))

    def run(self, seconds: float, target=None) -> float:
        """For some time, with a set-point repeated; the largest distance (m) from it."""
        until_s, worst = self.now_s + seconds, 0.0
        while self.now_s < until_s - 1e-9:
            self.step(target)
            worst = worst if target is None else max(worst, self.off_m(target))
        return worst

    def step(self, target=None) -> None:
        self.now_s += STEP_OF_LINK_S
        self._ticks += 1
        self.tello.advance_to(self.now_s)
        T = self.tello.body.T_world_body
        if self.wifi:
            self._downlink(T)
        for stamp_s, seen in self._seen.take(self.now_s, T):
            if self.tracked:
                seen[:3, 3] += self.seen_off_m
                self.core.pose(self.now_s, stamp_s, seen)
        if target is not None:
            self.core.set_point(target)
        self.core.step(self.now_s)
        for output in self.core.outgoing():
            self._do(output)

    def _downlink(self, T: np.ndarray) -> None:
        if self._ticks % 2 == 0:
            own = transforms.from_xyz_yaw(T[:3, 3] - [4.0, 2.0, 0.0], transforms.yaw(T))
            v_body = T[:3, :3].T @ self.tello.body.velocity_mps
            self.core.log(self.now_s, LogReport(own, v_body))
        if self._ticks % 3 == 0:
            self.core.flight(
                self.now_s,
                FlightReport(self.tello.flight.flying, float(T[2, 3]), self.battery_share),
            )

    def _do(self, output) -> None:
        if isinstance(output, TelloText):
            self.said.append(output.text)
        self.land_orders += isinstance(output, LandNow)
        if not self.wifi:
            return
        if isinstance(output, GiveSticks):
            give(self.tello, self.now_s, output.sticks)
        elif isinstance(output, TakeOffNow):
            self.tello.flight.take_off()
        elif isinstance(output, LandNow):
            self.tello.flight.land()
        elif isinstance(output, StayUp) and self.lost_orders:
            self.lost_orders -= 1
        elif isinstance(output, StayUp):
            self.tello.flight.cancel_landing()

    def guided(self, target: np.ndarray, altitude_m: float = 1.5) -> None:
        """Off the ground, into GUIDED, at a target."""
        self.run(1.0)
        self.core.take_off(self.now_s, altitude_m)
        self.run(8.0)
        self.core.set_mode(self.now_s, Mode.GUIDED)
        self.run(10.0, target)


@dataclass
class Flown:
    """Errors against the truth at each step: distance (m) and heading (deg), and the sticks."""

    time_s: np.ndarray
    off_m: np.ndarray
    off_deg: np.ndarray
    sticks: List[Sticks]


def fly(
    tello: TelloDrone,
    kind: Poses,
    gains: PidConfig,
    target: np.ndarray,
    seconds: float,
    seed: int = 1,
    predict: bool = True,
) -> Flown:
    """Off the ground and towards one target. Without ``predict`` the pose is taken as if it were of
    now."""
    observer, pid = Observer(ObserverRules(), gains.sticks), PositionPid(gains)
    seen, now_s, sticks, rows = SeenPoses(kind, seed), 0.0, Sticks(), []
    tello.flight.take_off()
    while now_s < seconds:
        now_s += STEP_OF_LINK_S
        give(tello, now_s, sticks)
        tello.advance_to(now_s)
        T = tello.body.T_world_body
        observer.step(now_s, sticks)
        for stamp_s, seen_T in seen.take(now_s, T):
            observer.pose(now_s, stamp_s if predict else now_s, seen_T)
        if observer.known and now_s > 4.0:
            sticks = pid.sticks(STEP_OF_LINK_S, observer.T_odom_body, observer.v_mps, target)
        off_deg = abs(np.degrees(wrap(transforms.yaw(T) - transforms.yaw(target))))
        rows.append((now_s, np.linalg.norm(T[:3, 3] - target[:3, 3]), off_deg, sticks))
    time_s, off_m, off_deg, given = zip(*rows)
    return Flown(np.array(time_s), np.array(off_m), np.array(off_deg), list(given))
