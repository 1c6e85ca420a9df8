# SPDX-License-Identifier: Apache-2.0
"""Quaternions (x, y, z, w) as tuples of floats, for loops in which array overhead would dominate."""

import math
from typing import Tuple

Vector = Tuple[float, float, float]
Quaternion = Tuple[float, float, float, float]


def multiply(q_a_b: Quaternion, q_b_c: Quaternion) -> Quaternion:
    """q_a_c.

    >>> multiply((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 1.0, 0.0))
    (0.0, 0.0, 0.0, -1.0)
    """
    x0, y0, z0, w0 = q_a_b
    x1, y1, z1, w1 = q_b_c
    return (
        w0 * x1 + x0 * w1 + y0 * z1 - z0 * y1,
        w0 * y1 - x0 * z1 + y0 * w1 + z0 * x1,
        w0 * z1 + x0 * y1 - y0 * x1 + z0 * w1,
        w0 * w1 - x0 * x1 - y0 * y1 - z0 * z1,
    )


def conjugate(q_a_b: Quaternion) -> Quaternion:
    """q_b_a."""
    return (-q_a_b[0], -q_a_b[1], -q_a_b[2], q_a_b[3])


def rotate(q_a_b: Quaternion, v_b: Vector) -> Vector:
    """A vector of frame b in frame a.

    >>> [round(c, 12) for c in rotate((0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), (1.0, 0.0, 0.0))]
    [0.0, 1.0, 0.0]
    """
    x, y, z, w = q_a_b
    vx, vy, vz = v_b
    cx, cy, cz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * cx + y * cz - z * cy,
        vy + w * cy + z * cx - x * cz,
        vz + w * cz + x * cy - y * cx,
    )


def from_yaw(yaw_rad: float) -> Quaternion:
    return (0.0, 0.0, math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad))


def yaw(q_a_b: Quaternion) -> float:
    """Heading (rad) of b's x axis in a's horizontal plane."""
    x, y, z, w = q_a_b
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def tilt_between(q_a_b: Quaternion, q_a_c: Quaternion) -> float:
    """Angle (rad) between a's vertical as b and as c see it: what a rotation about the vertical cannot explain."""
    up_b = rotate(conjugate(q_a_b), (0.0, 0.0, 1.0))
    up_c = rotate(conjugate(q_a_c), (0.0, 0.0, 1.0))
    dot = sum(a * b for a, b in zip(up_b, up_c))
    return math.acos(min(1.0, max(-1.0, dot)))


def wrap(angle_rad: float) -> float:
    """The same angle in -pi..pi."""
    return math.remainder(angle_rad, 2.0 * math.pi)
