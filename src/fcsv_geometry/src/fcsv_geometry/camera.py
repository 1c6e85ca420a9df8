# SPDX-License-Identifier: Apache-2.0
"""The pinhole camera with distortion ("plumb_bob", "rational_polynomial").

Pixel centres are at whole numbers.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Optional, Tuple

import cv2
import numpy as np

from fcsv_geometry.errors import GeometryError

COEFFICIENTS = (4, 5, 8, 12, 14)  # so many distortion coefficients OpenCV takes


@dataclass(frozen=True)
class PinholeCamera:
    """Intrinsics in pixels; ``distortion`` is k1, k2, p1, p2, k3, ... (OpenCV order), all zero for
    a pinhole.

    Raises GeometryError on non-finite values, a focal length that is not positive, an empty
    picture, or a number of distortion coefficients that OpenCV does not take. Whether a reader's
    values are plausible: ``intrinsics``.
    """

    width: int  # of the picture, px
    height: int  # of the picture, px
    fx: float  # focal length along the rows, px
    fy: float  # focal length across them, px
    cx: float  # principal point from the middle of the first pixel, px
    cy: float  # likewise
    # k1, k2, p1, p2, k3, ... as OpenCV has them
    distortion: Tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self):
        values = [self.fx, self.fy, self.cx, self.cy, *self.distortion]
        if not np.isfinite(values).all():
            raise GeometryError(f"camera intrinsics are not finite: {values}")
        if self.fx <= 0 or self.fy <= 0 or self.width < 1 or self.height < 1:
            raise GeometryError(
                f"camera has size {self.width}x{self.height}, focal length {self.fx}, {self.fy} px: not a camera"
            )
        if len(self.distortion) not in COEFFICIENTS:
            numbers = ", ".join(map(str, COEFFICIENTS))
            raise GeometryError(
                f"camera has {len(self.distortion)} distortion coefficients, not one of {numbers}"
            )

    @classmethod
    def from_fov(
        cls, width: int, height: int, horizontal_fov_rad: float, distortion=(0.0,) * 5
    ) -> "PinholeCamera":
        """Square pixels, principal point in the middle.

        >>> round(PinholeCamera.from_fov(640, 480, np.radians(56)).fx, 1)
        601.8
        """
        f = width / 2 / np.tan(horizontal_fov_rad / 2)
        return cls(width, height, f, f, (width - 1) / 2, (height - 1) / 2, tuple(distortion))

    @property
    def K(self) -> np.ndarray:
        """3x3 camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> "PinholeCamera":
        """The camera of its picture resized; pixel centres are at whole numbers.

        >>> PinholeCamera(640, 480, 600.0, 600.0, 319.5, 239.5).resized(320, 240).cx
        159.5
        """
        sx, sy = width / self.width, height / self.height
        cx, cy = (self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5
        return replace(
            self, width=width, height=height, fx=self.fx * sx, fy=self.fy * sy, cx=cx, cy=cy
        )

    def undistorted(self) -> "PinholeCamera":
        """The same camera without distortion: what the picture from undistort() belongs to."""
        return replace(self, distortion=(0.0,) * 5)

    def undistort(self, image: np.ndarray, interpolation: int = cv2.INTER_LINEAR) -> np.ndarray:
        """The picture as the undistorted camera would have taken it; pixels without a source
        (``blank()``) are 0."""
        if not any(self.distortion):
            return image
        return (
            cv2.undistort(image, self.K, np.array(self.distortion))
            if interpolation == cv2.INTER_LINEAR
            else (cv2.remap(image, *self._undistort_maps(), interpolation))
        )

    def blank(self) -> Optional[np.ndarray]:
        """HxW bool, read-only: pixels of the undistorted picture that the camera did not take; None
        where all are."""
        return _blank(replace(self, distortion=tuple(self.distortion)))

    def _undistort_maps(self):
        return cv2.initUndistortRectifyMap(
            self.K, np.array(self.distortion), None, self.K, (self.width, self.height), cv2.CV_32FC1
        )

    def project(self, p_cam: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points (N, 3) in the optical frame (m); NaN for points not in front."""
        p_cam = np.asarray(p_cam, float).reshape(-1, 3)
        if not len(p_cam):
            return np.empty((0, 2))  # OpenCV gives nothing
        uv, _ = cv2.projectPoints(
            p_cam, np.zeros(3), np.zeros(3), self.K, np.array(self.distortion)
        )
        uv = uv.reshape(-1, 2)
        uv[p_cam[:, 2] <= 0] = np.nan
        return uv

    def normalize(self, uv_px: np.ndarray) -> np.ndarray:
        """Undistorted x/z, y/z (N, 2) of pixels (N, 2)."""
        uv = np.ascontiguousarray(uv_px, dtype=float).reshape(-1, 1, 2)
        return cv2.undistortPoints(uv, self.K, np.array(self.distortion)).reshape(-1, 2)

    def rays(self, step: int = 1, rows: slice = slice(None)) -> np.ndarray:
        """Directions (height, width, 3), z = 1, optical frame, of every ``step``-th pixel's centre
        (distortion included), of these only some ``rows``."""
        across, down = (np.arange(0, n, step, dtype=float) for n in (self.width, self.height))
        u, v = np.meshgrid(across, down[rows])
        xy = self.normalize(np.stack([u, v], -1)).reshape(*u.shape, 2)
        return np.concatenate([xy, np.ones_like(xy[..., :1])], -1)


@lru_cache(maxsize=16)
def _blank(camera: PinholeCamera) -> Optional[np.ndarray]:
    if not any(camera.distortion):
        return None
    x, y = camera._undistort_maps()
    out = (x < 0) | (y < 0) | (x > camera.width - 1) | (y > camera.height - 1)
    out.setflags(write=False)
    return out if out.any() else None
