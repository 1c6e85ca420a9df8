# SPDX-License-Identifier: Apache-2.0
"""One picture of a depth camera, with its pose; which of its pixels count, and which pictures of a
flight."""

from dataclasses import dataclass, replace
from typing import Dict, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.near.sensor import DepthSensor

#: A pixel whose depth lies between those of its neighbours by more than so many standard deviations
#: on either side is of neither surface: matching windows that lie across an edge give such depths.
_BETWEEN = 4.0
#: A vehicle that stands sees the same again and again, with matches that are wrong in the same way.
_EVERY_S, _MOVED_M, _TURNED_RAD = 1.0, 0.15, float(np.radians(4.0))


@dataclass(frozen=True)
class DepthFrame:
    """``depth_m`` (H,W) float32 along the optical axis, NaN where there is none, of a ``camera``
    without distortion.

    ``covariance`` (6, 6) is of the pose in home (pose_covariance). Raises InputError where the
    sizes differ.
    """

    vehicle: str
    stamp_s: float
    depth_m: np.ndarray
    camera: PinholeCamera
    T_home_cam: np.ndarray
    covariance: np.ndarray

    def __post_init__(self):
        if self.depth_m.shape != (self.camera.height, self.camera.width):
            height, width = self.depth_m.shape[:2]
            sizes = f"{width}x{height}, its camera {self.camera.width}x{self.camera.height}"
            raise InputError(f"depth of {self.vehicle} at {self.stamp_s:.3f} is {sizes}")

    @classmethod
    def of_millimetres(
        cls,
        vehicle: str,
        stamp_s: float,
        depth_mm: np.ndarray,
        camera: PinholeCamera,
        T_home_cam: np.ndarray,
        covariance: np.ndarray,
    ) -> "DepthFrame":
        """Makes a frame from (H,W) uint16 in mm, 0 where there is none, as a ``camera`` with
        distortion took it (REP 118)."""
        depth_m = depth_mm.astype(np.float32) / 1000.0
        if depth_m.shape == (camera.height, camera.width):
            depth_m = camera.undistort(depth_m, cv2.INTER_NEAREST)
        depth_m = np.where(depth_m > 0.0, depth_m, np.float32(np.nan))
        return cls(vehicle, stamp_s, depth_m, camera.undistorted(), T_home_cam, covariance)

    def believed(self, sensor: DepthSensor) -> np.ndarray:
        """(H,W) float32: depth inside the sensor's range and of one surface, NaN elsewhere."""
        depth = np.where(sensor.in_range(self.depth_m), self.depth_m, np.float32(np.nan))
        known = np.isfinite(depth)
        nearest = cv2.erode(np.where(known, depth, np.float32(np.inf)), np.ones((3, 3)))
        farthest = cv2.dilate(np.where(known, depth, np.float32(-np.inf)), np.ones((3, 3)))
        with np.errstate(invalid="ignore"):
            step = _BETWEEN * sensor.noise_m(depth)
            between = (depth - nearest > step) & (farthest - depth > step)
        depth[between] = np.nan
        return depth

    def without(self, places_home_m: Sequence[np.ndarray], radius_m: float) -> "DepthFrame":
        """The frame without what lies within a radius of places (3,) in home: other vehicles are
        not of the map."""
        if not len(places_home_m):
            return self
        T_cam_home = transforms.invert(self.T_home_cam)
        points, gone = (
            self.camera.rays() * self.depth_m[..., None],
            np.zeros(self.depth_m.shape, bool),
        )
        for place in places_home_m:
            p_cam = T_cam_home[:3, :3] @ place + T_cam_home[:3, 3]
            with np.errstate(invalid="ignore"):
                gone |= ((points - p_cam) ** 2).sum(axis=-1) < radius_m**2
        return (
            replace(self, depth_m=np.where(gone, np.float32(np.nan), self.depth_m))
            if gone.any()
            else self
        )

    def pose_variance_m2(self, depth_m: np.ndarray) -> np.ndarray:
        """(H,W): variance per axis (mean of three) of where the pose puts the points of ``depth_m``
        (H,W) in home.

        An error (d, w) of the pose moves a point by d + w x arm.
        """
        arm = (self.camera.rays() * depth_m[..., None]) @ self.T_home_cam[:3, :3].T
        C_pp, C_pw, C_ww = self.covariance[:3, :3], self.covariance[:3, 3:], self.covariance[3:, 3:]
        skew = np.array([C_pw[1, 2] - C_pw[2, 1], C_pw[2, 0] - C_pw[0, 2], C_pw[0, 1] - C_pw[1, 0]])
        turned = np.trace(C_ww) * (arm**2).sum(-1) - np.einsum("...i,ij,...j", arm, C_ww, arm)
        return np.maximum((np.trace(C_pp) + 2.0 * arm @ skew + turned) / 3.0, 0.0)


class Thinning:
    """Which frames of each vehicle show something else than its last one, or come a second after
    it."""

    def __init__(self):
        self._last: Dict[str, Tuple[float, np.ndarray]] = {}

    def takes(self, vehicle: str, stamp_s: float, T_home_cam: np.ndarray) -> bool:
        """Whether the next frame counts; those of one vehicle come in order of time."""
        worth = self._differs(self._last.get(vehicle), stamp_s, T_home_cam)
        if worth:
            self._last[vehicle] = stamp_s, T_home_cam
        return worth

    @staticmethod
    def _differs(
        last: Optional[Tuple[float, np.ndarray]], stamp_s: float, T_home_cam: np.ndarray
    ) -> bool:
        if last is None or stamp_s - last[0] >= _EVERY_S:
            return True
        moved_m = np.linalg.norm(T_home_cam[:3, 3] - last[1][:3, 3])
        return bool(
            moved_m >= _MOVED_M or transforms.rotation_angle(last[1], T_home_cam) >= _TURNED_RAD
        )
