# SPDX-License-Identifier: Apache-2.0
"""Which way a camera looks, as three angles and as a rotation; and how much of a picture another
camera sees, too."""

import math
from typing import Tuple

import numpy as np

from fcsv_console.model.facts import CameraPoseReport
from fcsv_console.model.mission_file import Optics
from fcsv_geometry.missions.sweep import AXES

_GRID = (48, 36)  # pixels that are asked: a share is then right to about 1 %


def looks(R_home_cam: np.ndarray) -> Tuple[float, float, float]:
    """(heading, pitch, roll) in rad of an optical frame (x right, y down, z forward): to the left,
    up, right side down.

    >>> angles = (0.4, -0.2, 0.1)
    >>> bool(np.allclose(looks(rotation(*angles)), angles))
    True
    """
    x, y, z = (float(v) for v in R_home_cam[:, 2])
    heading, pitch = math.atan2(y, x), math.asin(max(-1.0, min(1.0, z)))
    level = rotation(heading, pitch, 0.0)
    right = R_home_cam[:, 0]
    return heading, pitch, math.atan2(float(right @ level[:, 1]), float(right @ level[:, 0]))


def rotation(heading_rad: float, pitch_rad: float, roll_rad: float) -> np.ndarray:
    """R_home_cam (3, 3) of a camera that looks so.

    >>> bool(np.allclose(rotation(0.0, 0.0, 0.0), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
    True
    """
    ch, sh, cp, sp = (
        math.cos(heading_rad),
        math.sin(heading_rad),
        math.cos(pitch_rad),
        math.sin(pitch_rad),
    )
    forward, right = np.array([ch * cp, sh * cp, sp]), np.array([sh, -ch, 0.0])
    down = np.cross(forward, right)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    return np.column_stack([cr * right + sr * down, cr * down - sr * right, forward])


def rotation_of(place: CameraPoseReport) -> np.ndarray:
    """R_home_cam (3, 3)."""
    return rotation(place.heading_rad, place.pitch_rad, place.roll_rad)


def seen_by_both(
    reference: CameraPoseReport, moving: CameraPoseReport, z_m: float, optics: Optics
) -> float:
    """Share (0..1) of the reference picture whose points at depth ``z_m`` the moving camera sees,
    by both places."""
    wide, high = _GRID
    u = (np.arange(wide) + 0.5) / wide * optics.width - optics.width / 2.0
    v = (np.arange(high) + 0.5) / high * optics.height - optics.height / 2.0
    uu, vv = (m.ravel() for m in np.meshgrid(u, v))
    f_u, f_v = (optics.focal_along(axis) for axis in AXES)
    p_ref = np.column_stack([uu / f_u, vv / f_v, np.ones(uu.size)]) * z_m
    p_home = p_ref @ rotation_of(reference).T + np.array(reference.p_home_m)
    p = (p_home - np.array(moving.p_home_m)) @ rotation_of(moving)
    z = np.maximum(p[:, 2], 1e-6)
    inside = (p[:, 2] > 0) & (np.abs(p[:, 0]) * f_u <= z * optics.width / 2.0)
    return float(np.mean(inside & (np.abs(p[:, 1]) * f_v <= z * optics.height / 2.0)))
