# SPDX-License-Identifier: Apache-2.0
"""What a ground model is made of: depth with sigma and kind, seen by one camera at a known
place."""

from dataclasses import dataclass, replace
from typing import Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_guidance.errors import GroundError
from fcsv_stereo.errors import InputError
from fcsv_stereo.map_files.reading import read_map_folder

#: m, of a camera from home's origin, and of a depth: points are float32, 1 mm there.
FARTHEST_M = 1e4


@dataclass(frozen=True)
class DepthView:
    """Depth of a pinhole picture: ``depth`` and ``sigma`` (H,W) m along the optical axis, NaN where
    none; ``kind`` (H,W) uint8 of ``fcsv_stereo.model.kinds``; ``K`` 3x3 px; ``T_home_cam`` 4x4;
    ``stamp_s`` NaN where nobody says it.

    Raises GroundError, which names the view, where these do not belong together or the pose is
    none.
    """

    name: str
    depth: np.ndarray
    sigma: np.ndarray
    kind: np.ndarray
    K: np.ndarray
    T_home_cam: np.ndarray
    stamp_s: float = float("nan")

    def __post_init__(self):
        for what in ("sigma", "kind"):
            if getattr(self, what).shape != self.depth.shape:
                raise GroundError(
                    f"{self.name}: {what} has shape {getattr(self, what).shape}, not {self.depth.shape}"
                )
        if self.depth.ndim != 2 or not np.isfinite(self.K).all():
            raise GroundError(f"{self.name}: depth is no picture, or its camera is not finite")
        if not (self.K[0, 0] > 0 and self.K[1, 1] > 0):
            raise GroundError(
                f"{self.name}: focal lengths of {self.K[0, 0]:g} and {self.K[1, 1]:g} px are no "
                "camera's; they are above 0"
            )
        try:
            transforms.require_rigid(self.T_home_cam, "T_home_cam")
        except GeometryError as error:
            raise GroundError(
                f"{self.name}: the pose of its camera cannot be used: {error}"
            ) from error
        if np.abs(self.T_home_cam[:3, 3]).max() > FARTHEST_M:
            raise GroundError(
                f"{self.name}: its camera is more than {FARTHEST_M:.0f} m from home's origin (UTM?), where no robot's "
                "map has coordinates; map it in a home near the robot"
            )

    def without(self, p_home_m: np.ndarray, radius_m: float) -> "DepthView":
        """The view without the pixels in which a ball about a place (3,) may be seen."""
        v, u = np.indices(self.depth.shape)
        hidden = self.hides(v, u, p_home_m, radius_m)
        if not hidden.any():
            return self
        return replace(self, kind=np.where(hidden, 0, self.kind).astype(self.kind.dtype))

    def hides(self, v, u, p_home_m: np.ndarray, radius_m: float) -> np.ndarray:
        """bool: whether a ball about a place (3,) may be seen in pixels at rows ``v`` and columns
        ``u`` (any shape)."""
        off_m = transforms.apply(transforms.invert(self.T_home_cam), p_home_m[None])[0]
        far_m, K = float(np.linalg.norm(off_m)), self.K
        rays = np.stack(
            [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(np.shape(u))], -1
        )
        cosine = rays @ off_m / np.maximum(np.linalg.norm(rays, axis=-1) * far_m, 1e-9)
        return cosine >= np.sqrt(max(0.0, 1.0 - min(1.0, radius_m / max(far_m, 1e-9)) ** 2))

    @property
    def camera(self) -> PinholeCamera:
        (height, width), K = self.depth.shape, self.K
        return PinholeCamera(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])


def require_different(views: Sequence[DepthView]) -> None:
    """Raises GroundError where two views show the same: a copy would count as a second witness."""
    for i, view in enumerate(views):
        for other in views[:i]:
            if np.array_equal(view.T_home_cam, other.T_home_cam) and np.array_equal(
                view.depth, other.depth, equal_nan=True
            ):
                raise GroundError(
                    f"{view.name}: is the same map as {other.name}, and tells nothing new; give each once"
                )


def read_map(folder) -> DepthView:
    """The depth view of a folder that ``map`` wrote. Raises GroundError naming folder and file."""
    try:
        read = read_map_folder(folder)
    except InputError as error:
        raise GroundError(str(error)) from error
    arrays = (read.depth, read.sigma, read.kind)
    return DepthView(str(folder), *arrays, read.K, read.T_home_cam, read.stamp_s)
