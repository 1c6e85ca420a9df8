# SPDX-License-Identifier: Apache-2.0
"""All gimbals of a ground robot: home, cameras in home, relative poses; the odometry frame of every
vehicle is G."""

from dataclasses import dataclass
from typing import Dict, Mapping, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.home import home_of
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.errors import HomeRefused
from fcsv_tracking.gimbal.equations import relative_pose
from fcsv_tracking.gimbal.tracker import GimbalTracker, GroundPose
from fcsv_tracking.mocap.equations import moved_covariance, relative_covariance

_FRESH_S = 0.5
_HOME_SIGMA_M, _HOME_SIGMA_RAD = 0.05, np.radians(3.0)


@dataclass(frozen=True)
class CameraInHome:
    """T_home_cam of one vehicle; covariance (6,6) position (m) and rotation (rad) about home's
    axes."""

    stamp_s: float
    T_home_cam: np.ndarray
    covariance: np.ndarray


class GimbalSystem:
    """A tracker per vehicle, and home and relative poses from all of them. ``T_body_cam``: each
    vehicle's own camera.

    ``trackers`` may grow later: one needs its camera's intrinsics to begin.
    """

    def __init__(self, trackers: Mapping[str, GimbalTracker], T_body_cam: Mapping[str, np.ndarray]):
        self.trackers: Dict[str, GimbalTracker] = dict(trackers)
        self._T_body_cam = dict(T_body_cam)
        self._tracks = {n: Trajectory(gap_s=0.15, keep_s=3.0) for n in self._T_body_cam}
        self.T_home_ground: Optional[np.ndarray] = None

    def add(self, name: str, pose: GroundPose) -> Optional[CameraInHome]:
        """A new pose of a vehicle; its camera in home, None before home is set."""
        track = self._tracks[name]
        # only after the clock was set back: trackers keep the order
        if not track.add(pose.stamp_s, pose.T_G_D):
            self._tracks[name] = Trajectory(gap_s=0.15, keep_s=3.0)
            self._tracks[name].add(pose.stamp_s, pose.T_G_D)
        return self.camera(name, pose)

    def camera(self, name: str, pose: GroundPose) -> Optional[CameraInHome]:
        """T_home_cam = T_home_G T_G_D T_D_C; None before home."""
        if self.T_home_ground is None:
            return None
        T_home_G, T_D_C = self.T_home_ground, self._T_body_cam[name]
        covariance = moved_covariance(
            pose.covariance, T_home_G[:3, :3], pose.T_G_D[:3, :3] @ T_D_C[:3, 3]
        )
        return CameraInHome(pose.stamp_s, T_home_G @ pose.T_G_D @ T_D_C, covariance)

    def body_at(self, name: str, stamp_s: float) -> np.ndarray:
        """T_G_D interpolated to a stamp. Raises PoseUnavailable: never beyond the newest, nor
        through a silence."""
        return self._tracks[name].at(stamp_s)

    def set_home(self, reference: str, now_s: float) -> np.ndarray:
        """T_ground_home: the reference's camera's place, level, its heading. Raises HomeRefused
        with the reason."""
        pose = self.trackers[reference].latest if reference in self.trackers else None
        if pose is None or now_s - pose.stamp_s > _FRESH_S:
            raise HomeRefused(
                f"{reference} is not seen: fly it in front of its gimbal, its tags towards the camera"
            )
        sigma = np.sqrt(np.diag(pose.covariance))
        if sigma[:3].max() > _HOME_SIGMA_M or sigma[3:].max() > _HOME_SIGMA_RAD:
            raise HomeRefused(
                f"{reference} is known to {sigma[:3].max():.3f} m and {np.degrees(sigma[3:].max()):.1f} deg only: "
                "bring it nearer, or turn it so that two tags are seen"
            )
        T_G_home = home_of(pose.T_G_D @ self._T_body_cam[reference])
        self.T_home_ground = transforms.invert(T_G_home)
        return T_G_home

    def relative(self, a: str, b: str, stamp_s: float) -> Optional[Tuple[np.ndarray, np.ndarray]]:
        """T_Da_Db (4.1) at a stamp and its covariance (6,6) in Da's axes; None where either was not
        seen then."""
        try:
            T_a, T_b = self.body_at(a, stamp_s), self.body_at(b, stamp_s)
        except PoseUnavailable:
            return None
        C_a, C_b = (self.trackers[n].latest.covariance for n in (a, b))
        return relative_pose(T_a, np.eye(4), T_b, np.eye(4)), relative_covariance(
            T_a, C_a, T_b, C_b
        )
