# SPDX-License-Identifier: Apache-2.0
"""Leads from disparity to depth, and from one view to another."""

from typing import Tuple, Union

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Cloud, Picture, Reference, as_rgb
from fcsv_stereo.rectify import RectifiedPair

_BAND = 256  # rows at a time: large pictures


def depth_from_disparity(pair: RectifiedPair, disparity: np.ndarray) -> np.ndarray:
    """z (m, NaN where none) in the reference's rectified view.

    Equation 2.5 with the component of the baseline along the axis (5.7), and with what it leaves
    out: cameras that are not exactly abreast (p_z) and principal points that differ. With x = (u -
    c)/f of the reference and x' = x - d/f of the other: z = (p - x' p_z) f / d.
    """
    i = pair.axis_index
    f = pair.K_reference[i, i]
    d = disparity - pair.infinity_px
    shape = disparity.shape
    u = np.broadcast_to(
        np.arange(shape[1])[None, :] if i == 0 else np.arange(shape[0])[:, None], shape
    )
    x_other = (u - pair.K_reference[i, 2]) / f - d / f
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (pair.baseline_m - x_other * pair.p_rect_other_m[2]) * f / d
        z[~((z > 0) & np.isfinite(z))] = np.nan
    return z.astype(np.float32)


def points_from_depth(depth: np.ndarray, K: np.ndarray, first_row: int = 0) -> np.ndarray:
    """Points (H,W,3) in the camera's frame; NaN where there is no depth. ``depth`` begins at a row
    of its picture."""
    v, u = np.indices(depth.shape, dtype=np.float32)
    v += np.float32(first_row)
    return np.stack(
        [(u - K[0, 2]) / K[0, 0] * depth, (v - K[1, 2]) / K[1, 1] * depth, depth], axis=-1
    )


def cloud_of(
    view: Union[Picture, Reference], depth: np.ndarray, sigma: np.ndarray, source: np.ndarray
) -> Cloud:
    """The points of a view at which there is a depth; ``depth``, ``sigma`` (m, NaN where none) and
    ``source`` (which pair) are HxW."""
    known = np.isfinite(depth)
    parts = [_points_home(view, depth, y, known) for y in range(0, len(depth), _BAND)]
    return Cloud(
        np.concatenate(parts),
        as_rgb(view.image)[known],
        sigma[known],
        source[known].astype(np.uint8),
    )


def _points_home(
    view: Union[Picture, Reference], depth: np.ndarray, y: int, known: np.ndarray
) -> np.ndarray:
    """(N,3) float32 of a band of rows from ``y`` on, where ``known`` (HxW bool)."""
    band = slice(y, y + _BAND)
    points_cam = points_from_depth(depth[band], view.camera.K, y)[known[band]]
    return transforms.apply(view.T_home_cam, points_cam).astype(np.float32)


def pixels_of(
    camera: PinholeCamera, T_home_cam: np.ndarray, points_home_m: np.ndarray
) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Says where points are: of points (N,3) in a picture: rows, columns (N,) int, 0 outside; depth
    (N,) m; bool (N,): which lie in it."""
    p_cam = transforms.apply(transforms.invert(T_home_cam), points_home_m.astype(float))
    u, v = np.rint(camera.project(p_cam)).T
    with np.errstate(invalid="ignore"):
        inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    rows, columns = (np.where(inside, x, 0).astype(int) for x in (v, u))
    return rows, columns, p_cam[:, 2], inside


def shown_share(camera: PinholeCamera, T_home_cam: np.ndarray, points_home_m: np.ndarray) -> float:
    """Share of points (N,3) of home that lie in a picture; something nearer may hide them."""
    return float(pixels_of(camera, T_home_cam, points_home_m)[3].mean())


def resample(
    points_home_m: np.ndarray, T_home_cam: np.ndarray, camera: PinholeCamera
) -> np.ndarray:
    """Depth (H,W, NaN) of points (N,3) of home as ``camera`` sees them: the nearest wins, single
    holes are closed."""
    rows, columns, z, inside = pixels_of(camera, T_home_cam, points_home_m)
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    np.minimum.at(depth, (rows[inside], columns[inside]), z[inside].astype(np.float32))
    return close_holes(depth)


def close_holes(depth: np.ndarray) -> np.ndarray:
    """Pixels without depth (inf) among at least five neighbours that agree get their median-like
    middle."""
    filled = np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)
    known = np.isfinite(depth).astype(np.float32)
    count = cv2.boxFilter(known, -1, (3, 3), normalize=False)
    mean = cv2.boxFilter(filled, -1, (3, 3), normalize=False) / np.maximum(count, 1.0)
    high = cv2.dilate(filled, np.ones((3, 3)))
    close = (known == 0) & (count >= 5) & (high < 1.1 * mean)
    out = np.where(known > 0, filled, np.nan)
    out[close] = mean[close]
    return out.astype(np.float32)
