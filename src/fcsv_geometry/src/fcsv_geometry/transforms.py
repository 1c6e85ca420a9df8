# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms as 4x4 float64 arrays: ``T_a_b`` takes points of frame b to frame a, p_a = T_a_b
@ p_b.

Axes are REP 103 (x forward, y left, z up); optical frames are z forward, x right, y down.
"""

import math

import numpy as np

from fcsv_geometry import rotations
from fcsv_geometry.errors import GeometryError

#: Rotation from the optical frame (z forward) to the body-like frame (x forward) of the same
#: camera.
R_FLU_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_IDENTITY = np.eye(4)


def _scipy():
    """scipy's rotations, imported when first used: a flight link that starts anew in flight waits
    for no import."""
    from scipy.spatial import transform as module

    return module


def __getattr__(name: str):
    """``transforms.Rotation`` for those who average and interpolate (PEP 562): imported when first
    used, as above."""
    if name == "Rotation":
        return _scipy().Rotation
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def transform(R_a_b: np.ndarray, p_a_b: np.ndarray) -> np.ndarray:
    """T_a_b from a 3x3 rotation and the position of b's origin in a (m).

    >>> transform(np.eye(3), [1, 2, 3])[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    T_a_b = _IDENTITY.copy()
    T_a_b[:3, :3] = R_a_b
    T_a_b[:3, 3] = p_a_b
    return T_a_b


def invert(T_a_b: np.ndarray) -> np.ndarray:
    """T_b_a, by transposing the rotation.

    >>> T = from_xyz_rpy([1, 2, 3], [0.1, 0.2, 0.3])
    >>> np.allclose(T @ invert(T), np.eye(4))
    True
    """
    R_b_a = T_a_b[:3, :3].T
    return transform(R_b_a, -R_b_a @ T_a_b[:3, 3])


def apply(T_a_b: np.ndarray, p_b: np.ndarray) -> np.ndarray:
    """Points (..., 3) of frame b in frame a."""
    return p_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def from_xyz_rpy(p_a_b_m, rpy_rad) -> np.ndarray:
    """T_a_b from a position (m) and roll, pitch, yaw about fixed x, y, z (rad; REP 103, R = Rz Ry
    Rx).

    >>> np.allclose(from_xyz_rpy([0, 0, 0], [0, 0, np.pi / 2]) @ [1, 0, 0, 1], [0, 1, 0, 1])
    True
    """
    return transform(_scipy().Rotation.from_euler("xyz", rpy_rad).as_matrix(), p_a_b_m)


def from_xyz_yaw(p_a_b_m, yaw_rad: float) -> np.ndarray:
    """Four-degree-of-freedom T_a_b: a position (m) and a rotation about z alone (rad)."""
    return from_xyz_rpy(p_a_b_m, [0.0, 0.0, yaw_rad])


def from_xyz_quaternion(p_a_b_m, q_a_b_xyzw) -> np.ndarray:
    """T_a_b from a position (m) and a quaternion, normalised here.

    Raises GeometryError where either holds NaN or the quaternion's length is not near one.
    """
    (px, py, pz), (x, y, z, w) = map(float, p_a_b_m), map(float, q_a_b_xyzw)
    norm = math.hypot(x, y, z, w)
    if not math.isfinite(norm + px + py + pz):
        raise GeometryError(f"pose is not finite: position {p_a_b_m}, quaternion {q_a_b_xyzw}")
    if abs(norm - 1.0) > 0.01:
        raise GeometryError(f"quaternion {q_a_b_xyzw} has length {norm:.3g}, not 1")
    rows = rotations.rows_of_quaternion((x / norm, y / norm, z / norm, w / norm))
    return of_rows(rows, (px, py, pz))


def of_rows(rows, p_a_b_m) -> np.ndarray:
    """T_a_b from three rows of a rotation and a position (m), all in plain floats: in half of the
    time of transform().

    >>> of_rows(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (1.0, 2.0, 3.0))[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    x, y, z = p_a_b_m
    numbers = (a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0)
    return np.array(numbers).reshape(4, 4)


def quaternion_xyzw(T_a_b: np.ndarray) -> np.ndarray:
    """q_a_b (x, y, z, w) of the rotation, with w >= 0."""
    q = _scipy().Rotation.from_matrix(T_a_b[:3, :3]).as_quat()
    return q if q[3] >= 0 else -q


def fast_quaternion_xyzw(T_a_b: np.ndarray):
    """quaternion_xyzw() without scipy, for what runs hundreds of times a second; a tuple.

    >>> T = from_xyz_rpy([0, 0, 0], [3.0, -0.2, 2.5])
    >>> np.allclose(fast_quaternion_xyzw(T), quaternion_xyzw(T))
    True
    """
    return rotations.quaternion_of_matrix(T_a_b[:3, :3])


def rpy(T_a_b: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw (rad) about fixed x, y, z: the inverse of from_xyz_rpy."""
    return _scipy().Rotation.from_matrix(T_a_b[:3, :3]).as_euler("xyz")


def yaw(T_a_b: np.ndarray) -> float:
    """Heading (rad) of b's x axis in a's horizontal plane."""
    return math.atan2(T_a_b[1, 0], T_a_b[0, 0])


def level(T_a_b: np.ndarray) -> np.ndarray:
    """T_a_b with roll and pitch removed: same position, same heading of the x axis."""
    return from_xyz_yaw(T_a_b[:3, 3], yaw(T_a_b))


def rotation_angle(R_a: np.ndarray, R_b: np.ndarray) -> float:
    """Angle (rad) between two rotations; 3x3 or 4x4.

    >>> round(rotation_angle(np.eye(3), from_xyz_yaw([0, 0, 0], 0.1)), 6)
    0.1
    """
    return float(
        np.linalg.norm(_scipy().Rotation.from_matrix(R_a[:3, :3].T @ R_b[:3, :3]).as_rotvec())
    )


def interpolate(T_a_b0: np.ndarray, T_a_b1: np.ndarray, alpha: float) -> np.ndarray:
    """Between two poses: linear in position, spherical-linear in rotation; alpha 0 gives the
    first."""
    ends = _scipy().Rotation.from_matrix([T_a_b0[:3, :3], T_a_b1[:3, :3]])
    R = _scipy().Slerp([0.0, 1.0], ends)(alpha).as_matrix()
    return transform(R, (1.0 - alpha) * T_a_b0[:3, 3] + alpha * T_a_b1[:3, 3])


def require_rigid(T_a_b: np.ndarray, name: str) -> np.ndarray:
    """The array back as float64 where it is a finite 4x4 rigid transform; else GeometryError naming
    it."""
    T = np.asarray(T_a_b, float)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise GeometryError(f"{name} is not a finite 4x4 transform")
    if (
        not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-5)
        or np.linalg.det(T[:3, :3]) < 0
    ):
        raise GeometryError(
            f"the rotation of {name} is not a rotation (not orthonormal, or mirrored)"
        )
    return T
