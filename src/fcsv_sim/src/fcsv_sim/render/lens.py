# SPDX-License-Identifier: Apache-2.0
"""Rays of a camera's pixels for rendering, also of lenses whose distortion OpenCV's own inversion
does not invert."""

from typing import Iterator, Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.errors import SimulationError

# of a picture that is rendered in flight: 2.6 s of a core at 1920 x 1080 (2026-11-28)
MOST_PIXELS = 1920 * 1200
_LEAST_SIDE_PX = 120
# share of the picture without rays; corners of a webcam's calibration have up to 0.5 %
_MOST_DARK = 0.03
# by so much a ray's pixel may differ from its own: below it a ray stays as OpenCV gives it
_EXACT_PX = 1e-3
_STEPS = 30  # of Newton's method, which doubles its digits with each
# of the way from the axis to a ray, where the model must not fold
_ALONG = np.linspace(0.1, 1.0, 10)
_CHUNK = 1 << 16  # pixels at once: derivatives take 120 bytes of each


def directions(camera: PinholeCamera) -> Tuple[np.ndarray, np.ndarray]:
    """Directions (H,W,3), z = 1, optical frame, of all pixels' centres, and (H,W) bool: those that
    have a ray.

    A polynomial of distortion that folds reaches no further than its fold: pixels beyond it have
    none, and their direction is the axis.
    """
    found = camera.rays()
    flat, seen = found.reshape(-1, 3), np.ones(camera.height * camera.width, bool)
    if not any(camera.distortion):
        return found, seen.reshape(camera.height, camera.width)
    for part in _chunks(len(flat)):
        uv = _pixels(camera, part)
        with np.errstate(all="ignore"):
            off_px = np.linalg.norm(camera.project(flat[part]) - uv, axis=1)
        wrong = np.flatnonzero(~(off_px <= _EXACT_PX)) + part.start
        if len(wrong):
            flat[wrong, :2], seen[wrong] = _inverted(camera, _pixels(camera, wrong))
    flat[~seen] = [0.0, 0.0, 1.0]
    return found, seen.reshape(camera.height, camera.width)


def require_can_be_rendered(camera: PinholeCamera) -> None:
    """Raises SimulationError that says what of a camera cannot be simulated, and what to do."""
    size = f"{camera.width}x{camera.height}"
    if camera.width * camera.height > MOST_PIXELS:
        raise SimulationError(
            f"pictures of {size} take too long to render in flight ({MOST_PIXELS / 1e6:.1f} Mpx at most): calibrate "
            "the camera at a smaller size, or divide size, fx, fy, cx, cy by one factor"
        )
    if min(camera.width, camera.height) < _LEAST_SIDE_PX:
        raise SimulationError(
            f"pictures of {size} are too small to map: {_LEAST_SIDE_PX} px a side at least"
        )
    dark = 1.0 - float(directions(camera)[1].mean())
    if dark > _MOST_DARK:
        raise SimulationError(
            f"distortion {[float(f'{d:.4g}') for d in camera.distortion]} folds: {dark:.0%} of the pixels have no ray; "
            "calibrate anew with the board in the corners, or with rational_polynomial (8 coefficients)"
        )


def _chunks(count: int) -> Iterator[slice]:
    return (slice(k, min(k + _CHUNK, count)) for k in range(0, count, _CHUNK))


def _pixels(camera: PinholeCamera, which) -> np.ndarray:
    """Places (N, 2) of pixels that are counted row by row."""
    numbers = np.arange(which.start, which.stop) if isinstance(which, slice) else which
    return np.column_stack([numbers % camera.width, numbers // camera.width]).astype(float)


def _inverted(camera: PinholeCamera, uv_px: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """x/z, y/z (N, 2) by Newton's method on the distortion, and (N,) bool: it has such a ray.

    From the pixel itself it comes nearer from one side only, as long as distortion grows evenly to
    the border.
    """
    xy = (uv_px - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    for _ in range(_STEPS):
        seen, J = _projected(camera, xy)
        determinant = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        off = uv_px - seen
        with np.errstate(all="ignore"):
            dx = (J[:, 1, 1] * off[:, 0] - J[:, 0, 1] * off[:, 1]) / determinant
            dy = (J[:, 0, 0] * off[:, 1] - J[:, 1, 0] * off[:, 0]) / determinant
        step = np.column_stack([dx, dy])
        good = np.isfinite(step).all(axis=1) & (determinant > 0)
        if not good.any() or np.abs(off[good]).max() < _EXACT_PX / 10.0:
            break
        xy[good] += step[good]
    with np.errstate(all="ignore"):
        reached = np.linalg.norm(_projected(camera, xy)[0] - uv_px, axis=1) < _EXACT_PX
    unfolded = np.ones(len(xy), bool)
    for share in _ALONG:
        J = _projected(camera, share * xy)[1]
        unfolded &= J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0] > 0
    return xy, reached & unfolded


def _projected(camera: PinholeCamera, xy: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) of rays (N, 2), and how they change with them (N, 2, 2)."""
    seen, J = [], []
    for part in _chunks(len(xy)):
        points = np.column_stack([xy[part], np.ones(len(xy[part]))])
        uv, jacobian = cv2.projectPoints(
            points, np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion)
        )
        seen.append(uv.reshape(-1, 2))
        J.append(jacobian[:, 3:5].reshape(-1, 2, 2))  # by x and y of a shift: z is 1
    return np.concatenate(seen), np.concatenate(J)
