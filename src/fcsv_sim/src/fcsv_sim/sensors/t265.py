# SPDX-License-Identifier: Apache-2.0
"""A T265 tracking camera: where it believes to be, with the errors of its profile, which tracking need not assume.

Its odometry frame is level, begins where it was switched on, and has a yaw of its own; position
drifts by about 1 % of the distance, heading slowly; it may jump (the thesis saw 30 m at take-off).
"""

import math
from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.tracker import TrackerProfile

_TAKEOFF_HEIGHT_M = 0.3  # above the ground, where it may jump


class T265:
    """Turns true poses of the tracking camera into its odometry; altitude jumps by ``takeoff_jump_m`` at take-off."""

    def __init__(self, profile: TrackerProfile, T_body_t265: np.ndarray, seed: int, takeoff_jump_m: float = 0.0):
        self._profile = profile
        self.confidence = 3  # as its driver says: 0 failed, 1 low, 2 medium, 3 high
        self._T_body_t265 = T_body_t265
        self._random = np.random.default_rng([seed, 3])
        self._yaw_origin = self._random.uniform(-np.pi, np.pi)
        self._scale = 1.0 + self._random.normal(0.0, profile.scale)
        self._noise_sigma = np.repeat([profile.position_noise_m, np.radians(profile.attitude_noise_deg)], 3)
        level = np.radians(profile.level_deg) * self._random.standard_normal(2)
        self._R_level = rotations.exp(np.array([level[0], level[1], 0.0]))
        self._noise = np.zeros(6)
        self._p_before: Optional[np.ndarray] = None
        self._p_odom = np.zeros(3)
        self._heading_drift = 0.0
        self._jump_left_m = takeoff_jump_m
        self._start_z = 0.0
        self._stamp_s: Optional[float] = None

    def odometry(self, stamp_s: float, T_world_body: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """T_odom_t265 and the velocities (linear m/s, angular rad/s) in the pose frame, from the truth at a stamp."""
        T_world_t265 = T_world_body @ self._T_body_t265
        if self._p_before is None:
            self._p_before, self._start_z = T_world_t265[:3, 3].copy(), T_world_t265[2, 3]
            self._T_before, self._stamp_s = T_world_t265, stamp_s
        step = T_world_t265[:3, 3] - self._p_before
        self._p_before = T_world_t265[:3, 3].copy()
        self._drift(step)
        if self._jump_left_m and T_world_t265[2, 3] - self._start_z > _TAKEOFF_HEIGHT_M:
            self._p_odom[2] -= self._jump_left_m
            self._jump_left_m = 0.0
        dt_s = max(stamp_s - self._stamp_s, 1e-4)
        noise = self._coloured_noise(dt_s)
        R_odom_world = self._R_odom_world()
        R = self._R_level @ rotations.exp(noise[3:]) @ R_odom_world @ T_world_t265[:3, :3]
        T_odom_t265 = transforms.transform(R, self._p_odom + noise[:3])
        linear, angular = self._velocities(T_world_t265, dt_s)
        self._T_before, self._stamp_s = T_world_t265, stamp_s
        return T_odom_t265, linear, angular

    def _R_odom_world(self) -> np.ndarray:
        yaw = self._yaw_origin + self._heading_drift
        c, s = math.cos(yaw), math.sin(yaw)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def _drift(self, step: np.ndarray) -> None:
        root = math.sqrt(math.sqrt(step @ step))
        heading, *walk = self._random.standard_normal(4)
        self._heading_drift += math.radians(self._profile.heading_deg_per_sqrt_m) * root * heading
        walk = self._profile.walk_m_per_sqrt_m * root * np.array(walk)
        self._p_odom += self._R_odom_world() @ step * self._scale + walk

    def _coloured_noise(self, dt_s: float) -> np.ndarray:
        """First-order noise: neighbouring samples of a tracker are not independent."""
        keep = math.exp(-dt_s / self._profile.noise_correlation_s)
        fresh = math.sqrt(1 - keep**2) * self._noise_sigma
        self._noise = keep * self._noise + fresh * self._random.standard_normal(6)
        return self._noise

    def _velocities(self, T_world_t265: np.ndarray, dt_s: float):
        R = T_world_t265[:3, :3]
        linear = R.T @ (T_world_t265[:3, 3] - self._T_before[:3, 3]) / dt_s
        step = self._T_before[:3, :3].T @ R  # 5 ms: the skew part is the rotation vector
        return linear, 0.5 * np.array(
            [step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]]
        ) / dt_s
