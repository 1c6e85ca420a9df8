# SPDX-License-Identifier: Apache-2.0
"""Where to look for tags in a large picture: first around the predicted place, then everywhere."""

import dataclasses
from typing import List, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_tracking.tags import TagDetector, TagObservation

_MARGIN_PX = 60
_LEAST_PX = 160  # half a window: smaller ones save nothing


@dataclasses.dataclass(frozen=True)
class ImageWindow:
    """Columns u0 to u1 and rows v0 to v1 of a picture (ends excluded)."""

    u0: int
    v0: int
    u1: int
    v1: int


def window_about(
    T_cam_ground: np.ndarray, p_ground_m: np.ndarray, radius_m: float, camera: PinholeCamera
) -> Optional[ImageWindow]:
    """Where a body of ``radius_m`` shows; None where it is not in the picture."""
    p_cam = transforms.apply(T_cam_ground, p_ground_m)
    if p_cam[2] <= radius_m:
        return None
    (u, v), half = camera.project(p_cam)[0], camera.fx * radius_m / p_cam[2] + _MARGIN_PX
    half = max(half, _LEAST_PX)
    u0, v0 = max(0, int(u - half)), max(0, int(v - half))
    u1, v1 = min(camera.width, int(u + half) + 1), min(camera.height, int(v + half) + 1)
    return (
        ImageWindow(u0, v0, u1, v1) if u1 - u0 > _LEAST_PX / 2 and v1 - v0 > _LEAST_PX / 2 else None
    )


def look(
    detector: TagDetector, gray: np.ndarray, camera: PinholeCamera, window: Optional[ImageWindow]
) -> Tuple[List[TagObservation], bool]:
    """Observations, and whether the whole picture was looked at: without a window, or where it held
    no tag.

    The corners are of the whole picture in either case. Raises TagError as TagDetector.detect().
    """
    if window is not None and gray.shape == (camera.height, camera.width):
        w = window
        part = dataclasses.replace(
            camera, width=w.u1 - w.u0, height=w.v1 - w.v0, cx=camera.cx - w.u0, cy=camera.cy - w.v0
        )
        found = detector.detect(gray[window.v0 : window.v1, window.u0 : window.u1], part)
        if found:
            shift = np.array([window.u0, window.v0])
            return [dataclasses.replace(o, corners_px=o.corners_px + shift) for o in found], False
    return detector.detect(gray, camera), True
