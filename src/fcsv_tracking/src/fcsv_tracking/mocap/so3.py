# SPDX-License-Identifier: Apache-2.0
"""Rotation vectors: what the filter's Jacobians are made of (Solà, "A micro Lie theory", 2018, eq. 143 to 147)."""

import math

import numpy as np


def skew(v: np.ndarray) -> np.ndarray:
    """(3,3) with skew(v) @ w = v x w.

    >>> skew(np.array([0.0, 0.0, 1.0])) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    """
    x, y, z = v[0], v[1], v[2]
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp(v: np.ndarray) -> np.ndarray:
    """Rotation (3,3) of a rotation vector (rad).

    >>> np.allclose(exp(np.array([0.0, 0.0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0])
    True
    """
    x, y, z = float(v[0]), float(v[1]), float(v[2])
    angle2 = x * x + y * y + z * z
    angle = math.sqrt(angle2)
    a, b = (1.0, 0.5) if angle < 1e-6 else (math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2)
    # written out: the filter asks for it several times a frame
    return np.array([
        [1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y],
        [b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x],
        [b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)],
    ])  # fmt: skip


def log(R: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) (rad) of a rotation; the inverse of exp() up to a half turn.

    >>> np.allclose(log(exp(np.array([0.1, -2.0, 0.3]))), [0.1, -2.0, 0.3])
    True
    >>> np.allclose(abs(log(np.diag([-1.0, 1.0, -1.0]))), [0, np.pi, 0])
    True
    """
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = math.sqrt(v @ v)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        return v * (angle / sine)
    if cosine > 0.0:
        return v
    axis = np.sqrt(np.maximum(0.5 * (np.diag(R) + 1.0), 0.0))  # a half turn: the sign is free, the products are not
    k = int(np.argmax(axis))
    return angle * np.where((R[k] + R[:, k] < 0) & (np.arange(3) != k), -axis, axis)


def inverse_right_jacobian(v: np.ndarray) -> np.ndarray:
    """J with log(exp(v) exp(dv)) = v + J dv to first order."""
    angle = math.sqrt(v @ v)
    K = skew(v)
    if angle < 1e-6:
        return np.eye(3) + 0.5 * K
    return np.eye(3) + 0.5 * K + (1.0 / angle**2 - (1.0 + math.cos(angle)) / (2.0 * angle * math.sin(angle))) * (K @ K)
