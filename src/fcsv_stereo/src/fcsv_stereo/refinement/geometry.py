# SPDX-License-Identifier: Apache-2.0
"""Two-view geometry on rays: epipolar error with its derivative, a robust pose of a pair, inverse
depth.

The pair's pose is T_a_b; rays are (N, 3) with z = 1, in a's or b's optical frame.
"""

from dataclasses import dataclass
from typing import Optional, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms


@dataclass(frozen=True)
class PairPrior:
    """T_a_b with standard deviations per axis: of its rotation (rad, b's axes) and position (m, a's
    axes).

    Where the pictures' ``covariance`` is known, (6, 6) of rotation and position in b's axes, they
    are its largest.
    """

    T_a_b: np.ndarray
    rotation_rad: float
    position_m: float
    covariance: Optional[np.ndarray] = None

    @property
    def information(self) -> np.ndarray:
        """6 diagonal entries, rotation first."""
        return 1.0 / np.repeat([self.rotation_rad, self.position_m], 3) ** 2

    @property
    def full_covariance(self) -> np.ndarray:
        """(6, 6) of rotation and position in b's axes, the pictures' own where it is known."""
        return np.diag(1.0 / self.information) if self.covariance is None else self.covariance


def epipolar_error(
    T_a_b: np.ndarray, rays_a: np.ndarray, rays_b: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Distance (N,) of b's ray from a's epipolar line, at z = 1 in b (rad to first order), and its
    derivative (N, 6).

    Derivative to [rotation in b's axes, position in a's axes].
    """
    R, t = T_a_b[:3, :3], T_a_b[:3, 3]
    b_in_a, a_in_b = rays_b @ R.T, rays_a @ R
    normal = _cross(rays_a, t)
    line = normal @ R
    l, m, n = line.T
    scale = 1.0 / np.maximum(np.hypot(l, m), 1e-12)
    error = (normal * b_in_a).sum(1) * scale
    J = np.hstack([_cross(rays_b, line), _cross(b_in_a, rays_a)]) * scale[:, None]
    # the line's length changes too: without this the baseline would shrink to nothing
    x, y, z = a_in_b.T
    stretch = np.column_stack(
        [n * m, -n * l, 0 * n, np.column_stack([z * m, -z * l, y * l - x * m]) @ R.T]
    )
    return error, J - (error * scale**2)[:, None] * stretch


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """np.cross() of (N, 3) with (N, 3) or (3,), in a third of its time."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]).T


def fit_pair(
    prior: PairPrior,
    rays_a: np.ndarray,
    rays_b: np.ndarray,
    focal_px: float,
    band_px: float,
    noise_px: float,
    start: Optional[np.ndarray] = None,
) -> Tuple[np.ndarray, np.ndarray]:
    """T_a_b that most rays agree with, and the epipolar errors (N,) px under it.

    Gauss-Newton on Geman-McClure weights whose width shrinks from the band to the noise (graduated
    non-convexity, Yang et al. 2020), with the prior; from ``start``, where that is not the prior's
    own pose.
    """
    T_a_b = (prior.T_a_b if start is None else start).copy()
    width_px, information = band_px, prior.information
    for _ in range(20):
        error, J = epipolar_error(T_a_b, rays_a, rays_b)
        error, J = error * focal_px, J * focal_px
        weight = (width_px**2 / (width_px**2 + error**2)) ** 2 / noise_px**2
        offset = prior_offset(prior, T_a_b)
        H = (J * weight[:, None]).T @ J + np.diag(information)
        step = np.linalg.solve(H, -(J.T @ (weight * error) + information * offset))
        T_a_b = moved(T_a_b, step)
        if width_px <= 3.0 * noise_px and np.abs(step[:3]).max() < 1e-6:
            break
        width_px = max(width_px / 1.5, 3.0 * noise_px)
    return T_a_b, epipolar_error(T_a_b, rays_a, rays_b)[0] * focal_px


def moved(T_a_b: np.ndarray, step: np.ndarray) -> np.ndarray:
    """T_a_b after a step [rotation in b's axes, position in a's axes]."""
    return transforms.transform(T_a_b[:3, :3] @ cv2.Rodrigues(step[:3])[0], T_a_b[:3, 3] + step[3:])


def prior_offset(prior: PairPrior, T_a_b: np.ndarray) -> np.ndarray:
    """[rotation in b's axes, position in a's axes] from the prior to T_a_b."""
    rotation = cv2.Rodrigues(prior.T_a_b[:3, :3].T @ T_a_b[:3, :3])[0].ravel()
    return np.r_[rotation, T_a_b[:3, 3] - prior.T_a_b[:3, 3]]


def inverse_depth(
    T_a_b: np.ndarray, rays_a: np.ndarray, rays_b: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Inverse depth (N,) 1/m along a's rays from b's, and how far b's ray moves with it (N,) m: the
    parallax.

    Least squares of b's error in the frame parallel to a, signed: rays that diverge give a negative
    one.
    """
    t = T_a_b[:3, 3]
    b_in_a = rays_b @ T_a_b[:3, :3].T
    b_in_a = b_in_a / np.where(np.abs(b_in_a[:, 2:]) < 1e-6, 1e-6, b_in_a[:, 2:])
    # a - rho t is parallel to b_in_a: ax - rho tx = bx (1 - rho tz)
    along = t[:2] - b_in_a[:, :2] * t[2]
    size = np.maximum((along**2).sum(1), 1e-18)
    return (along * (rays_a[:, :2] - b_in_a[:, :2])).sum(1) / size, np.sqrt(size)


def project(T_a_b: np.ndarray, rays_a: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Rays (N, 3) in b, z = 1, of points on a's rays at inverse depths (N,); NaN behind b."""
    p = (rays_a - rho[:, None] * T_a_b[:3, 3]) @ T_a_b[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(p[:, 2:] > 1e-6, p / p[:, 2:], np.nan)
