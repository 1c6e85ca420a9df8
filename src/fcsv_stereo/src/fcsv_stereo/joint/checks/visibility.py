# SPDX-License-Identifier: Apache-2.0
"""What of a depth image another camera sees: where it lies there, and what hides what."""

from typing import Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint.tuning import FARTHEST_1_M, SHARED, VISIBILITY


def seen_from(
    depth: np.ndarray,
    camera: PinholeCamera,
    T_other_cam: np.ndarray,
    other: PinholeCamera,
    step: int = 1,
) -> Tuple[Tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Where each ``step``-th pixel of a depth image (HxW, m) lies in ``other`` (u, v: px), and its
    depth there."""
    v, u = np.indices(depth.shape, dtype=np.float32)[:, ::step, ::step]
    z = depth[::step, ::step]
    z = np.where(np.isfinite(z), z, np.float32(1.0 / FARTHEST_1_M)).astype(np.float32)
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1
    )
    p = (rays * z[..., None]) @ T_other_cam[:3, :3].T.astype(np.float32) + T_other_cam[
        :3, 3
    ].astype(np.float32)
    ahead = np.maximum(p[..., 2], 1e-6)
    at = other.fx * p[..., 0] / ahead + other.cx, other.fy * p[..., 1] / ahead + other.cy
    return (at[0].astype(np.float32), at[1].astype(np.float32)), p[..., 2].astype(np.float32)


def visible(
    uv: Tuple[np.ndarray, np.ndarray], z: np.ndarray, shape: Tuple[int, int], step: int = 1
) -> np.ndarray:
    """HxW bool, from ``seen_from``: inside the other picture of that shape, and nothing nearer lies
    before it there."""
    height, width = (-(-s // step) for s in shape)
    border = max(VISIBILITY.border_px // step, 1)
    u, v = (np.round(x / step) for x in uv)
    inside = (u >= border) & (v >= border) & (u < width - border) & (v < height - border) & (z > 0)
    at = v[inside].astype(np.int64) * width + u[inside].astype(np.int64)
    nearest = np.full(height * width, np.float32(np.inf))
    np.minimum.at(nearest, at, z[inside])
    nearest = cv2.erode(nearest.reshape(height, width), np.ones((3, 3), np.uint8)).ravel()
    out = np.zeros(z.shape, bool)
    out[inside] = z[inside] <= (1.0 + SHARED.one_surface) * nearest[at]
    return out
