# SPDX-License-Identifier: Apache-2.0
"""Equation 2.12 for two cameras that stand anyhow, such as a pair that is turned inward."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera


def depth_error(
    z_m: np.ndarray,
    xy: np.ndarray,
    T_ref_other: np.ndarray,
    other: PinholeCamera,
    disparity_error_px: float = 1.0,
) -> np.ndarray:
    """Error (m, ...) of depths ``z_m`` (...) along the reference's optical axis where the match in
    the other picture is ``disparity_error_px`` off along its epipolar line.

    ``xy`` (..., 2) are x/z, y/z of the pixels in the reference. On the other picture a point moves
    by |du/dz| px per metre of depth; the error is the inverse of that. For parallel cameras |du/dz|
    = b f / z², which is 2.12. Inward tilt changes it by the obliqueness of the rays, a few per
    cent; infinite where the depth does not move the match.

    >>> T = transforms.transform(np.eye(3), [8.0, 0.0, 0.0])
    >>> camera = PinholeCamera(640, 480, 602.0, 602.0, 319.5, 239.5)
    >>> round(float(depth_error(400.0, np.zeros(2), T, camera)), 1)
    33.2
    """
    z = np.asarray(z_m, float)[..., None]
    rays = np.concatenate(
        [np.asarray(xy, float), np.ones_like(np.asarray(xy, float)[..., :1])], axis=-1
    )
    T_other_ref = transforms.invert(T_ref_other)
    moved = rays @ T_other_ref[:3, :3].T  # per metre of depth
    p = z * moved + T_other_ref[:3, 3]
    depth = p[..., 2:3]
    du = (
        (moved[..., :2] * depth - p[..., :2] * moved[..., 2:3])
        / np.square(depth)
        * [other.fx, other.fy]
    )
    with np.errstate(divide="ignore"):
        return disparity_error_px / np.linalg.norm(du, axis=-1)
