# SPDX-License-Identifier: Apache-2.0
"""Where a vehicle's camera is by what a map found of a picture of it.

A calibration by tags leaves an error of about half a degree in the heading of a vehicle's odometry in
home, 0.3 m at 35 m; a map in which one of its pictures takes part refines that pose to 0.01 degrees
(docs/lab/guidance.md#by-its-tags). What is wrong is where the odometry lies in home, so that the
same movement corrects all later poses: T_home_cam = C T_home_cam_told. From then on it drifts anew.
"""

from collections import deque
from dataclasses import dataclass
from typing import Deque, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_stereo.pose_covariance import carried
from fcsv_tracking.column.drift import Drift

_REFINED_M, _REFINED_RAD = 0.03, np.radians(0.05)  # of a refined pose, each axis
_LEVEL_RAD = np.radians(0.05)  # of a tracker's samples, each axis
_KEPT = 3000  # positions: a map takes half a minute, detections come at 5 Hz or more
_XYZ_YAW = (0, 1, 2, 5)


@dataclass(frozen=True)
class RefinedCamera:
    """What a map found of a picture of ``vehicle``: T_home_cam (4,4) as its tracker ``told`` it, and
    ``refined``."""

    vehicle: str
    stamp_s: float
    told: np.ndarray
    refined: np.ndarray


class MappedCamera:
    """The poses of one vehicle's camera, corrected by the newest map it took part in."""

    def __init__(self, profile: TrackerProfile = T265_PROFILE):
        self._profile = profile
        self._way: Deque[Tuple[float, np.ndarray]] = deque(maxlen=_KEPT)  # stamps, in its odometry
        self._found: Optional[RefinedCamera] = None
        self._drift: Optional[Drift] = None
        self._framed_s = -np.inf

    def framed(self, stamp_s: float) -> None:
        """Home was set, or the column calibrated: what a map found before is of other frames."""
        self._framed_s = max(self._framed_s, stamp_s)
        if self._found is not None and self._found.stamp_s < self._framed_s:
            self._found = None

    def refine(self, found: RefinedCamera) -> None:
        """A map refined a picture of it."""
        before = self._found
        if found.stamp_s < self._framed_s or before and found.stamp_s <= before.stamp_s:
            return
        self._found, self._drift = found, None

    def corrected(
        self, stamp_s: float, T_home_odom: np.ndarray, T_odom_cam: np.ndarray
    ) -> Optional[Tuple[np.ndarray, np.ndarray]]:
        """T_home_cam (4,4) of a picture and its covariance (6,6) as camera_pose has it; None where
        no map told. Pictures come in order: the way between them drifts."""
        p_odom_cam_m = T_odom_cam[:3, 3]
        self._way.append((stamp_s, p_odom_cam_m.copy()))
        if self._drift is not None:
            self._drift.add(stamp_s, p_odom_cam_m)
        if self._found is None:
            return None
        if self._drift is None:
            self._drift = self._drifted(self._found, T_home_odom)
        correction = self._found.refined @ transforms.invert(self._found.told)
        T_home_cam = correction @ T_home_odom @ T_odom_cam
        F = carried(T_home_cam[:3, 3] - self._found.refined[:3, 3])
        base = np.diag([_REFINED_M**2] * 3 + [_REFINED_RAD**2] * 3)
        # pictures tell no scale: both trackers err by theirs along the way from home
        p_m = self._found.refined[:3, 3]
        base[:3, :3] += 2.0 * self._profile.scale**2 * np.outer(p_m, p_m)
        C = F @ base @ F.T
        C[3:, 3:] += np.eye(3) * _LEVEL_RAD**2
        turn = np.eye(4)
        turn[:3, :3] = (correction @ T_home_odom)[:3, :3]
        C[np.ix_(_XYZ_YAW, _XYZ_YAW)] += turn @ self._drift.covariance @ turn.T
        return T_home_cam, C

    def _drifted(self, found: RefinedCamera, T_home_odom: np.ndarray) -> Drift:
        """Drift from the map's picture on; a way that was not heard of counts as straight."""
        drift = Drift(self._profile)
        p_odom_cam_m = transforms.apply(transforms.invert(T_home_odom), found.told[None, :3, 3])[0]
        drift.add(found.stamp_s, p_odom_cam_m)
        for stamp_s, p_m in self._way:
            if stamp_s > found.stamp_s:
                drift.add(stamp_s, p_m)
        return drift
