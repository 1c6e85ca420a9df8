# SPDX-License-Identifier: Apache-2.0
"""Equations 5.1 to 5.4 of the thesis in T_a_b notation: M mocap, W level, O odometry, D body, a and
b two vehicles.

What was corrected. 5.1 and 5.2 take ``M -> D`` as the pose of D in M (T_M_D), 5.3 as its inverse
(then, and only then, R_M->D2 R'_M->D1 and T_M->D2 - R T_M->D1 are a relative pose); one notation
serves both here. 5.2 turns either odometry's position by the common R_W->M, which holds only where
both odometries began with the same heading: each has its own R_M_O here, whose vertical is 5.1's.
5.4 subtracts the offsets that 5.2 adds, applies R_W->M to one of the two vehicles alone, and takes
both attitudes to be of one odometry frame. tests/fcsv_tracking/test_mocap_equations.py proves these
on truth and shows where the printed ones fail.
"""

from typing import Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError

#: How near to the vertical the lens may look before its heading means nothing.
_LEAST_HORIZONTAL = 0.1


def odometry_axes(R_M_D: np.ndarray, R_O_D: np.ndarray) -> np.ndarray:
    """R_M_O (3,3) = R_M_D R_O_D': how the odometry's level axes stand in M (5.1 for one vehicle,
    transposed)."""
    return R_M_D @ R_O_D.T


def level_horizon(R_M_Os: Sequence[np.ndarray], sigmas_rad: Sequence[float]) -> np.ndarray:
    """R_M_W (3,3) from what several vehicles hold to be level, weighed by their standard deviations
    (5.1).

    The verticals are averaged, not whole rotations: headings of odometries differ by where they
    were switched on. x of W is the lens's direction, level (5.6: the heading of the ground
    station). Raises GeometryError where there is none.

    >>> np.allclose(level_horizon([np.eye(3), transforms.from_xyz_yaw([0, 0, 0], 1.0)[:3, :3]], [1.0, 1.0]), np.eye(3))
    True
    """
    if not R_M_Os:
        raise GeometryError("no vehicle says what is level: fly one into the mocap's view")
    up = sum(R[:, 2] / sigma**2 for R, sigma in zip(R_M_Os, sigmas_rad))
    up = up / np.linalg.norm(up)
    forward = np.array([1.0, 0.0, 0.0]) - up[0] * up
    length = float(np.linalg.norm(forward))
    if length < _LEAST_HORIZONTAL:
        raise GeometryError(
            "the mocap looks straight up or down, so its direction is no heading: tilt it"
        )
    forward = forward / length
    return np.stack([forward, np.cross(up, forward), up], axis=1)


def offset(T_M_D: np.ndarray, T_O_D: np.ndarray) -> np.ndarray:
    """T_M_O (4,4): the offset that is saved while the vehicle is in view; its position is 5.2 with
    R_M_O for R_W->M."""
    return T_M_D @ transforms.invert(T_O_D)


def relative_in_view(T_M_Da: np.ndarray, T_M_Db: np.ndarray) -> np.ndarray:
    """T_Da_Db (4,4) from two poses by the tracker (5.3)."""
    return transforms.invert(T_M_Da) @ T_M_Db


def relative_out_of_view(
    T_M_Oa: np.ndarray, T_Oa_Da: np.ndarray, T_M_Ob: np.ndarray, T_Ob_Db: np.ndarray
) -> np.ndarray:
    """T_Da_Db (4,4) from saved offsets and odometry (5.4); exact in view too, where offsets are
    fresh."""
    return transforms.invert(T_M_Oa @ T_Oa_Da) @ (T_M_Ob @ T_Ob_Db)


def moved_covariance(covariance: np.ndarray, R_a_M: np.ndarray, p_M_arm: np.ndarray) -> np.ndarray:
    """(6,6) of a point carried on a body's arm (m, M's axes), in a's axes, from the body's (6,6) in
    M's."""
    x, y, z = p_M_arm
    J = np.eye(6)
    J[:3, 3:] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.kron(np.eye(2), R_a_M)
    return turn @ J @ covariance @ J.T @ turn.T


def relative_covariance(
    T_M_Da: np.ndarray, C_a: np.ndarray, T_M_Db: np.ndarray, C_b: np.ndarray
) -> np.ndarray:
    """(6,6) of T_Da_Db in Da's axes, of two independent poses with (6,6) in M's axes."""
    R_Da_M = T_M_Da[:3, :3].T
    arm = T_M_Db[:3, 3] - T_M_Da[:3, 3]
    return moved_covariance(C_a, R_Da_M, arm) + moved_covariance(C_b, R_Da_M, np.zeros(3))
