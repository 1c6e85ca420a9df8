# SPDX-License-Identifier: Apache-2.0
"""A T265 tracking camera: where it believes to be, with the errors of its profile, which tracking
need not assume.

Its odometry frame is level, begins where it was switched on, and has a yaw of its own; position
drifts by about 1 % of the distance, heading slowly; it may jump (the thesis saw 30 m at take-off).
"""

import math
from typing import Iterator, Optional, Tuple

import numba
import numpy as np

from fcsv_geometry import rotations
from fcsv_geometry.vehicles.tracker import TrackerProfile

_TAKEOFF_HEIGHT_M = 0.3  # above the ground, where it may jump


@numba.njit(cache=True)
def _exp(x, y, z):
    """rotations.exp()"""
    angle2 = x * x + y * y + z * z
    angle = math.sqrt(angle2)
    a, b = (
        (1.0, 0.5) if angle < 1e-6 else (math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2)
    )
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    R[1, 0], R[1, 1], R[1, 2] = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
    R[2, 0], R[2, 1], R[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)
    return R


@numba.njit(cache=True)
def _times(A, B, n):
    """The product of the first n rows and columns, without BLAS, whose call takes longer than these
    few numbers."""
    product = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for k in range(n):
                product[i, j] += A[i, k] * B[k, j]
    return product


@numba.njit(cache=True)
def _sample(
    T_world_body,
    T_body_t265,
    T_before,
    dt_s,
    yaw_rad,
    p_odom,
    noise,
    drawn,
    R_level,
    sigma,
    profile,
    sample,
):
    """Yaw of the next sample; fills ``sample``, T_odom_t265 (4, 4) and the twist (6,), linear and
    angular, and moves T_before, p_odom and noise along. (To return arrays takes longer.)

    The position drifts with the way flown and the heading with its root; the noise is of first
    order, because neighbouring samples of a tracker are not independent.
    """
    (scale, heading_rad, walk_m, correlation_s), (T_odom_t265, twist) = profile, sample
    T = _times(T_world_body, T_body_t265, 4)
    step = T[:3, 3] - T_before[:3, 3]
    root = math.sqrt(math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2))
    yaw_rad += heading_rad * root * drawn[0]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    R_odom_world = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    p_odom[0] += (c * step[0] - s * step[1]) * scale + walk_m * root * drawn[1]
    p_odom[1] += (s * step[0] + c * step[1]) * scale + walk_m * root * drawn[2]
    p_odom[2] += step[2] * scale + walk_m * root * drawn[3]
    keep = math.exp(-dt_s / correlation_s)
    for k in range(6):
        noise[k] = keep * noise[k] + math.sqrt(1.0 - keep**2) * sigma[k] * drawn[4 + k]
    R_noisy = _times(_times(R_level, _exp(noise[3], noise[4], noise[5]), 3), R_odom_world, 3)
    T_odom_t265[3, :] = (0.0, 0.0, 0.0, 1.0)
    T_odom_t265[:3, :3] = _times(R_noisy, T, 3)
    T_odom_t265[:3, 3] = p_odom + noise[:3]
    for k in range(3):
        twist[k] = (T[0, k] * step[0] + T[1, k] * step[1] + T[2, k] * step[2]) / dt_s
    turn = _times(T_before.T, T, 3)  # a few ms: the skew part is the rotation vector
    skew = np.array((turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]))
    T_before[:], twist[3:] = T, 0.5 * skew / dt_s
    return yaw_rad


def _drawn(random: np.random.Generator) -> Iterator[np.ndarray]:
    """(10,) of a standard normal for each sample, drawn three seconds ahead."""
    while True:
        yield from random.standard_normal((100, 10))


class T265:
    """Turns true poses of the tracking camera into its odometry; altitude jumps by
    ``takeoff_jump_m`` at take-off."""

    def __init__(
        self,
        profile: TrackerProfile,
        T_body_t265: np.ndarray,
        seed: int,
        takeoff_jump_m: float = 0.0,
    ):
        self.confidence = 3  # as its driver says: 0 failed, 1 low, 2 medium, 3 high
        self._T_body_t265 = T_body_t265
        random = np.random.default_rng([seed, 3])
        # of the world in the odometry frame; it drifts
        self._yaw_rad = random.uniform(-np.pi, np.pi)
        scale = 1.0 + random.normal(0.0, profile.scale)
        self._noise_sigma = np.repeat(
            [profile.position_noise_m, np.radians(profile.attitude_noise_deg)], 3
        )
        level = np.radians(profile.level_deg) * random.standard_normal(2)
        self._draws = _drawn(random)
        self._R_level = rotations.exp(np.array([level[0], level[1], 0.0]))
        self._noise = np.zeros(6)
        heading_rad = math.radians(profile.heading_deg_per_sqrt_m)
        self._profile_numbers = (
            scale,
            heading_rad,
            profile.walk_m_per_sqrt_m,
            profile.noise_correlation_s,
        )
        self._p_odom = np.zeros(3)
        self._T_before = np.eye(4)  # T_world_t265 of the last sample
        self._jump_left_m = takeoff_jump_m
        self._start_z = 0.0
        self._stamp_s: Optional[float] = None

    def odometry(
        self, stamp_s: float, T_world_body: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """T_odom_t265 and the velocities (linear m/s, angular rad/s) in the pose frame, from the
        truth at a stamp."""
        if self._stamp_s is None:
            self._T_before[:] = T_world_body @ self._T_body_t265
            self._start_z, self._stamp_s = self._T_before[2, 3], stamp_s
        dt_s = max(stamp_s - self._stamp_s, 1e-4)
        self._stamp_s = stamp_s
        T_odom_t265, twist = np.empty((4, 4)), np.empty(6)
        self._yaw_rad = _sample(
            T_world_body,
            self._T_body_t265,
            self._T_before,
            dt_s,
            self._yaw_rad,
            self._p_odom,
            self._noise,
            next(self._draws),
            self._R_level,
            self._noise_sigma,
            self._profile_numbers,
            (T_odom_t265, twist),
        )
        if self._jump_left_m and self._T_before[2, 3] - self._start_z > _TAKEOFF_HEIGHT_M:
            self._p_odom[2] -= self._jump_left_m
            T_odom_t265[2, 3] -= self._jump_left_m
            self._jump_left_m = 0.0
        return T_odom_t265, twist[:3], twist[3:]
