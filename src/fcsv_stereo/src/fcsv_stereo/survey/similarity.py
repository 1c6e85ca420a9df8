# SPDX-License-Identifier: Apache-2.0
"""Similarities as gtsam's Similarity3, whose tangent is (rotation, translation, logarithm of the
scale).

``S_a_b`` takes points of frame b to frame a: p_a = s (R p_b + t).
"""

from typing import Tuple

import gtsam
import numpy as np

TANGENT = 7
ROTATION, TRANSLATION, LOG_SCALE = slice(0, 3), slice(3, 6), 6


def of_pose(T_a_b: np.ndarray, scale: float = 1.0) -> gtsam.Similarity3:
    """S_a_b with b's axes and origin at ``T_a_b`` (4x4, m) and b's lengths ``scale`` times longer
    in a."""
    return gtsam.Similarity3(gtsam.Rot3(T_a_b[:3, :3]), T_a_b[:3, 3] / scale, scale)


def matrix(S_a_b: gtsam.Similarity3) -> np.ndarray:
    """4x4 of S_a_b with p_a = M p_b.

    >>> matrix(of_pose(np.eye(4), 2.0)).diagonal().tolist()
    [2.0, 2.0, 2.0, 1.0]
    """
    M = np.eye(4)
    M[:3, :3] = S_a_b.scale() * S_a_b.rotation().matrix()
    M[:3, 3] = place(S_a_b)
    return M


def numbers(S_a_b: gtsam.Similarity3) -> Tuple[list, list, float]:
    """Rotation, translation, scale: plain numbers that are S to the last bit (``of_numbers``)."""
    return (
        S_a_b.rotation().matrix().tolist(),
        np.asarray(S_a_b.translation()).tolist(),
        S_a_b.scale(),
    )


def of_numbers(R_a_b: list, t_a_b: list, scale: float) -> gtsam.Similarity3:
    """The similarity of ``numbers``."""
    return gtsam.Similarity3(gtsam.Rot3(np.array(R_a_b)), np.array(t_a_b), scale)


def place(S_a_b: gtsam.Similarity3) -> np.ndarray:
    """(3,) b's origin in a (m)."""
    return S_a_b.scale() * np.asarray(S_a_b.translation())


def rotation(S_a_b: gtsam.Similarity3) -> np.ndarray:
    """R_a_b, 3x3."""
    return S_a_b.rotation().matrix()


def apply(S_a_b: gtsam.Similarity3, p_b: np.ndarray) -> np.ndarray:
    """Points (N, 3) of b in a."""
    return S_a_b.scale() * (p_b @ rotation(S_a_b).T + np.asarray(S_a_b.translation()))


def between(S_x_a: gtsam.Similarity3, S_x_b: gtsam.Similarity3) -> gtsam.Similarity3:
    """S_a_b.

    >>> a, b = of_pose(np.eye(4), 2.0), of_pose(np.eye(4), 3.0)
    >>> round(between(a, b).scale(), 6)
    1.5
    """
    return S_x_a.inverse().compose(S_x_b)


def fit(p_a: np.ndarray, p_b: np.ndarray) -> np.ndarray:
    """(K, 4, 4) least-squares similarities M with p_a = M p_b of K sets (K, N, 3) of points
    (Umeyama 1991)."""
    mean_a, mean_b = p_a.mean(1, keepdims=True), p_b.mean(1, keepdims=True)
    a, b = p_a - mean_a, p_b - mean_b
    U, D, Vt = np.linalg.svd(np.einsum("kni,knj->kij", a, b))
    sign = np.ones_like(D)
    sign[:, 2] = np.sign(np.linalg.det(U @ Vt))
    R = (U * sign[:, None, :]) @ Vt
    scale = (D * sign).sum(1) / np.maximum((b**2).sum((1, 2)), 1e-12)
    M = np.tile(np.eye(4), (len(R), 1, 1))
    M[:, :3, :3] = scale[:, None, None] * R
    M[:, :3, 3] = mean_a[:, 0] - np.einsum("kij,kj->ki", M[:, :3, :3], mean_b[:, 0])
    return M


def of_matrix(M_a_b: np.ndarray) -> gtsam.Similarity3:
    """S_a_b of a 4x4 whose upper part is a scaled rotation."""
    scale = float(np.cbrt(np.linalg.det(M_a_b[:3, :3])))
    return of_pose(
        np.vstack([np.column_stack([M_a_b[:3, :3] / scale, M_a_b[:3, 3]]), [0.0, 0.0, 0.0, 1.0]]),
        scale,
    )
