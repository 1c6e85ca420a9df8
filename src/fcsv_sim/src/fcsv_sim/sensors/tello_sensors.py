# SPDX-License-Identifier: Apache-2.0
"""A Tello's own odometry and IMU, as its log packets bring them over Wi-Fi: both in one packet,
late, and drifting.

The thesis measured 0.374 m after 20 m (5.2): the error grows by ``drift_share`` of the distance, in
a direction that changes over tens of metres, and heading wanders. Level is gravity's, with a
constant and a slow error.
"""

from dataclasses import dataclass
from typing import List, Optional

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.streams.flow import RateGate

_G = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class TelloErrors:
    """Standard deviations; ``drift`` scales all that grows with distance and time."""

    rate_hz: float = 20.0
    delay_s: float = 0.07  # truth to arrival
    # standard deviation of a constant that nobody knows, of either vehicle's link
    delay_offset_s: float = 0.015
    jitter_s: float = 0.006  # one-sided: a packet is never early
    loss: float = 0.01
    drift: float = 1.0
    drift_share: float = 0.0233  # rms per metre; 2 % of 20 m
    drift_length_m: float = 20.0
    heading_deg_per_sqrt_s: float = 0.03
    level_deg: float = 0.06
    attitude_noise_deg: float = 0.08  # correlated over half a second
    position_noise_m: float = 0.003
    velocity_noise_mps: float = 0.03
    resolution_mps: float = 0.01
    gyro_noise_radps: float = 0.01
    gyro_bias_radps: float = 0.004
    accel_noise_mps2: float = 0.15
    accel_bias_mps2: float = 0.04


@dataclass(frozen=True)
class TelloSample:
    """One packet. ``arrival_s`` is when it is heard; the truth it tells is of ``truth_s``, which
    nobody is told."""

    arrival_s: float
    truth_s: float
    T_O_D: np.ndarray
    v_O_mps: np.ndarray
    gyro_radps: np.ndarray
    accel_mps2: np.ndarray


class TelloSensors:
    """advance() with true poses in steps of a few milliseconds; a sample when one is due."""

    def __init__(self, errors: TelloErrors, seed: int):
        self._errors = e = errors
        self._random = random = np.random.default_rng([seed, 12])
        self._yaw = random.uniform(-np.pi, np.pi)
        self._R_level = Rotation.from_rotvec(
            [*np.radians(e.level_deg) / np.sqrt(2.0) * random.standard_normal(2), 0.0]
        ).as_matrix()
        self._drift = random.standard_normal(3) / np.sqrt(3.0)
        self._gyro_bias = e.gyro_bias_radps * random.standard_normal(3)
        self._accel_bias = e.accel_bias_mps2 * random.standard_normal(3)
        self._delay_s = e.delay_s + e.delay_offset_s * random.standard_normal()
        self._attitude_noise = np.zeros(3)
        self._p_O = np.zeros(3)
        self._before: Optional[tuple] = None
        self._gate = RateGate.bursting(errors.rate_hz)
        self._arrived_s = -np.inf

    def reset(self) -> None:
        """Switched off and on: its odometry begins anew."""
        self._p_O = np.zeros(3)
        self._yaw += self._random.uniform(0.5, 2.0)

    def advance(
        self, stamp_s: float, T_world_body: np.ndarray, v_world_mps: np.ndarray
    ) -> List[TelloSample]:
        """Gives at most one packet."""
        before, self._before = self._before, (stamp_s, T_world_body, np.array(v_world_mps))
        if before is None:
            self._gate.admit(stamp_s)
            return []
        dt_s = stamp_s - before[0]
        if dt_s <= 0.0:
            return []
        self._drive(dt_s, T_world_body[:3, 3] - before[1][:3, 3])
        if not self._gate.passes(stamp_s):
            return []
        sample = self._sample(stamp_s, dt_s, before)
        return [] if self._random.uniform() < self._errors.loss else [sample]

    def _drive(self, dt_s: float, step_m: np.ndarray) -> None:
        e, random = self._errors, self._random
        moved_m = float(np.linalg.norm(step_m))
        self._yaw += (
            e.drift
            * np.radians(e.heading_deg_per_sqrt_s)
            * np.sqrt(dt_s)
            * random.standard_normal()
        )
        keep = np.exp(-moved_m / e.drift_length_m)
        self._drift = keep * self._drift + np.sqrt((1.0 - keep**2) / 3.0) * random.standard_normal(
            3
        )
        self._p_O += self._R_O_world() @ step_m + e.drift * e.drift_share * moved_m * self._drift
        keep = np.exp(-dt_s / 0.5)
        noise = np.radians(e.attitude_noise_deg) * random.standard_normal(3)
        self._attitude_noise = keep * self._attitude_noise + np.sqrt(1.0 - keep**2) * noise

    def _sample(self, stamp_s: float, dt_s: float, before) -> TelloSample:
        e, random = self._errors, self._random
        _, T, v = self._before
        R_world_body, R_O_world = T[:3, :3], self._R_O_world()
        R = (
            self._R_level
            @ R_O_world
            @ R_world_body
            @ Rotation.from_rotvec(self._attitude_noise).as_matrix()
        )
        p = self._p_O + random.normal(0.0, e.position_noise_m, 3)
        # one odometry: what its position gains by drift, its velocity says, too
        v_O = R_O_world @ v + e.drift * e.drift_share * float(np.linalg.norm(v)) * self._drift
        v_O += random.normal(0.0, e.velocity_noise_mps, 3)
        gyro = Rotation.from_matrix(before[1][:3, :3].T @ R_world_body).as_rotvec() / dt_s
        accel = R_world_body.T @ ((v - before[2]) / dt_s - _G)
        arrival_s = stamp_s + self._delay_s + abs(random.normal(0.0, e.jitter_s))
        # packets do not overtake each other
        self._arrived_s = max(self._arrived_s + 1e-4, arrival_s)
        return TelloSample(
            self._arrived_s,
            stamp_s,
            transforms.transform(R, p),
            np.round(v_O / e.resolution_mps) * e.resolution_mps if e.resolution_mps else v_O,
            gyro + self._gyro_bias + random.normal(0.0, e.gyro_noise_radps, 3),
            accel + self._accel_bias + random.normal(0.0, e.accel_noise_mps2, 3),
        )

    def _R_O_world(self) -> np.ndarray:
        c, s = np.cos(self._yaw), np.sin(self._yaw)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
