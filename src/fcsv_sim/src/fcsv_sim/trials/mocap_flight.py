# SPDX-License-Identifier: Apache-2.0
"""A Tello's flight in and out of a V120 Duo's view, and every message of it in order of arrival; no
clock, no ROS.

The tracker stands on the ground and looks up at 45 degrees (thesis 5.7).
"""

import heapq
from dataclasses import dataclass, field
from typing import Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import rotations, transforms
from fcsv_sim.sensors.tello_sensors import TelloErrors, TelloSample, TelloSensors
from fcsv_sim.sensors.v120_duo import V120Duo, V120DuoErrors

STEP_HZ = 600.0  # a multiple of the cameras' 120 and of the topic's 200
TOPIC_HZ = 200.0
MOCAP_DELAY_S = 0.0085  # a frame's exposure to its pose on the topic, before the topic's own period
T_WORLD_MOCAP = transforms.from_xyz_rpy([0.0, 0.0, 0.3], np.radians([1.5, -45.0, 20.0]))


@dataclass(frozen=True)
class TrueTrack:
    """A vehicle's true motion at STEP_HZ: p (N,3), v (N,3), R (N,3,3), all in the world; t (N,)."""

    t_s: np.ndarray
    p: np.ndarray
    v: np.ndarray
    R: np.ndarray

    def pose(self, index: int) -> np.ndarray:
        return transforms.transform(self.R[index], self.p[index])

    def at(self, stamp_s: float) -> np.ndarray:
        """T_world_body between two steps."""
        x = (stamp_s - self.t_s[0]) * STEP_HZ
        i = int(np.clip(np.floor(x), 0, len(self.t_s) - 2))
        share = float(np.clip(x - i, 0.0, 1.0))
        R = self.R[i] @ rotations.exp(share * rotations.log(self.R[i].T @ self.R[i + 1]))
        return transforms.transform(R, (1.0 - share) * self.p[i] + share * self.p[i + 1])


@dataclass(frozen=True)
class MocapPose:
    """A message on the mocap's topic; ``seen`` and ``true_pose`` are for tests, nobody is told."""

    arrival_s: float
    T_M_D: np.ndarray
    seen: bool
    true_pose: bool


@dataclass(frozen=True)
class FlightErrors:
    """Holds the errors of both devices."""

    mocap: V120DuoErrors = field(default_factory=V120DuoErrors)
    tello: TelloErrors = field(default_factory=TelloErrors)


def fly(
    waypoints: Sequence[Tuple[float, float, float, float]],
    yaw_rad: float,
    seed: int,
    start_s: float,
) -> TrueTrack:
    """Stop-to-stop minimum-jerk legs through (x, y, z, seconds to get there), with the wander and
    the vibration of a small quadrotor, tilting as its acceleration asks."""
    random = np.random.default_rng([seed, 13])
    t = np.arange(0.0, sum(w[3] for w in waypoints[1:]), 1.0 / STEP_HZ)
    p = np.empty((len(t), 3))
    begun = 0.0
    for a, b in zip(waypoints, waypoints[1:]):
        leg = (t >= begun) & (t <= begun + b[3])
        s = (t[leg] - begun) / b[3]
        p[leg] = np.outer(1 - _minimum_jerk(s), a[:3]) + np.outer(_minimum_jerk(s), b[:3])
        begun += b[3]
    for axis in range(3):
        for hz in (0.17, 0.31, 0.53):
            p[:, axis] += 0.02 * np.sin(2 * np.pi * hz * t + random.uniform(0.0, 2 * np.pi))
    v = np.gradient(p, t, axis=0)
    a = np.gradient(v, t, axis=0)
    yaw = yaw_rad + np.radians(4.0) * np.sin(2 * np.pi * 0.05 * t + random.uniform(0.0, 2 * np.pi))
    R = attitudes(a + 0.25 * v, yaw) @ vibration(t, random)
    return TrueTrack(start_s + t, p, v, R)


def messages(
    truths: Dict[str, TrueTrack], errors: FlightErrors, seed: int, hidden=lambda _t_s: ()
) -> Iterator[tuple]:
    """(arrival s, vehicle, MocapPose or TelloSample) in order of arrival; ``hidden(t)`` names the
    occluded."""
    duo = V120Duo(errors.mocap, T_WORLD_MOCAP, seed)
    tellos = {n: TelloSensors(errors.tello, seed * 100 + i) for i, n in enumerate(truths)}
    waiting: List[tuple] = []
    frames: List[tuple] = []
    number = 0
    t_s = min((T.t_s for T in truths.values()), key=len)
    for k, now_s in enumerate(t_s):
        if k % int(STEP_HZ / 120.0) == 0:
            frames.append(
                (
                    now_s + MOCAP_DELAY_S,
                    duo.frame(now_s, {n: T.pose(k) for n, T in truths.items()}, hidden(now_s)),
                )
            )
        if k % int(STEP_HZ / TOPIC_HZ) == 0:
            while len(frames) > 1 and frames[1][0] <= now_s:
                frames.pop(0)
            for name, sight in frames[0][1].items() if frames[0][0] <= now_s else ():
                number += 1
                heapq.heappush(
                    waiting,
                    (
                        now_s,
                        number,
                        name,
                        MocapPose(now_s, sight.T_M_D, sight.seen, sight.true_pose),
                    ),
                )
            for name, truth in truths.items():
                for sample in tellos[name].advance(now_s, truth.pose(k), truth.v[k]):
                    number += 1
                    heapq.heappush(waiting, (sample.arrival_s, number, name, sample))
        while waiting and waiting[0][0] <= now_s:
            arrival_s, _, name, message = heapq.heappop(waiting)
            yield arrival_s, name, message


def deliver(tracker, message, now_s: Optional[float] = None) -> None:
    """A message into a MocapTracker, at ``now_s`` where that is later than its stamp. Raises
    SampleRejected."""
    now_s = message.arrival_s if now_s is None else now_s
    if isinstance(message, TelloSample):
        T = message.T_O_D
        tracker.add_vehicle(
            now_s,
            message.arrival_s,
            T[:3, 3],
            transforms.quaternion_xyzw(T),
            T[:3, :3].T @ message.v_O_mps,
            message.gyro_radps,
            message.accel_mps2,
        )
    else:
        T = message.T_M_D
        tracker.add_mocap(now_s, message.arrival_s, T[:3, 3], transforms.fast_quaternion_xyzw(T))


def _minimum_jerk(s: np.ndarray) -> np.ndarray:
    return 10 * s**3 - 15 * s**4 + 6 * s**5


def attitudes(a_world: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """R_world_body (N,3,3) of a body that tilts as its acceleration (N,3) asks and has a heading
    (N,)."""
    up = a_world + [0.0, 0.0, 9.81]
    z = up / np.linalg.norm(up, axis=1, keepdims=True)
    y = np.cross(z, np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1))
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=2)


def vibration(t: np.ndarray, random) -> np.ndarray:
    """Small rotations (N,3,3) of the airframe, 0.1 degrees rms."""
    r = np.zeros((len(t), 3))
    for hz in (23.0, 31.0, 47.0):
        r += (
            np.radians(0.1)
            * np.sqrt(2.0)
            / 3.0
            * np.sin(2 * np.pi * hz * t[:, None] + random.uniform(0.0, 2 * np.pi, 3))
        )
    return Rotation.from_rotvec(r).as_matrix()
