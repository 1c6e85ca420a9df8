# SPDX-License-Identifier: Apache-2.0
"""Where the rig's cameras were at a picture's stamp, and how far away what they look at is."""

from dataclasses import dataclass

import numpy as np

from fcsv_geometry import transforms
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.angles import AngleTrack
from fcsv_tracking.gimbal.geometry import Angles
from fcsv_tracking.tilting.rig import TiltAngles, TiltingRig
from fcsv_tracking.tilting.servos import TiltReading

_STILL_DEGPS = 1.0  # a pixel of smear in 0.1 s
_MIDDLE = 1.0 / 3.0  # of the picture's width and height: what is looked at
_NEAR_PERCENTILE = 20.0  # of depths there: the thing, and not what is behind it
_LEAST_PIXELS = 30


@dataclass(frozen=True)
class PosedCamera:
    """T_rig_cam (4x4) and its covariance (6, 6: position m, rotation rad, about the rig's axes)."""

    T_rig_cam: np.ndarray
    covariance: np.ndarray


class RigPoses:
    """Angles over time. Cameras that turn have no pose that is worth a picture."""

    def __init__(self, rig: TiltingRig):
        self._rig, self._track = rig, AngleTrack()

    def add(self, reading: TiltReading) -> None:
        """Raises SampleRejected where it is not finite or not newer."""
        self._track.add(reading.stamp_s, Angles(*reading.angles))

    @property
    def newest_s(self) -> float:
        """Stamp of the newest reading; minus infinity before the first."""
        return self._track.newest_s

    def latest(self, side: str) -> np.ndarray:
        """T_rig_cam by the newest reading. Raises PoseUnavailable before the first."""
        return self._rig.T_rig_cam(side, TiltAngles(*self._track.latest()))

    def at(self, side: str, stamp_s: float) -> PosedCamera:
        """A camera at a stamp. Raises SampleRejected where it turned then, PoseUnavailable where no
        readings are."""
        angles, rates = self._track.at(stamp_s)
        fastest_degps = float(np.degrees(np.abs(rates).max()))
        if fastest_degps > _STILL_DEGPS:
            raise SampleRejected("turning", f"the rig turned at {fastest_degps:.1f} deg/s")
        at = TiltAngles(*angles)
        return PosedCamera(self._rig.T_rig_cam(side, at), self._rig.covariance(side, at))


def looked_at_m(rig: TiltingRig, T_rig_left: np.ndarray, depth: np.ndarray) -> float:
    """Distance (m) from the rig's middle of what is in the middle of the left picture, by its depth
    (H,W, m, NaN).

    The picture may be a resized one. Raises SampleRejected where too little of the middle has a
    depth.
    """
    height, width = depth.shape
    rows, columns = (
        slice(int(n * (1 - _MIDDLE) / 2), int(n * (1 + _MIDDLE) / 2)) for n in (height, width)
    )
    middle = depth[rows, columns]
    known = np.isfinite(middle) & (middle > 0)
    if known.sum() < _LEAST_PIXELS:
        raise SampleRejected(
            "no depth", f"{int(known.sum())} pixels of the picture's middle have a depth"
        )
    rays = rig.left.camera.undistorted().resized(width, height).rays()[rows, columns][known]
    points = transforms.apply(T_rig_left, rays * middle[known][:, None])
    return float(np.percentile(points[:, 0], _NEAR_PERCENTILE))
