# SPDX-License-Identifier: Apache-2.0
"""All vehicles under one mocap: level from all of them, home, cameras in home, relative poses."""

from dataclasses import dataclass
from typing import Dict, Mapping, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.home import home_of
from fcsv_tracking.errors import HomeRefused, SampleRejected
from fcsv_tracking.mocap import equations
from fcsv_tracking.mocap.rules import TrackerRules
from fcsv_tracking.mocap.tracker import MocapTracker

_BODY_M = 0.15  # two vehicles cannot be nearer than this to each other
_AS_FAR = 6.0  # of that: a vehicle that seems further away is not in a place
_NOTICE_S = 0.3
_HOME_SIGMA_M, _HOME_SIGMA_RAD = 0.05, np.radians(1.0)


@dataclass(frozen=True)
class CameraPose:
    """T_home_cam of one vehicle; covariance (6,6) position (m) and rotation (rad) about home's
    axes."""

    stamp_s: float
    T_home_cam: np.ndarray
    covariance: np.ndarray


class MocapSystem:
    """A tracker per vehicle; level, home and relative poses from all. ``T_body_cam``: each
    vehicle's camera."""

    def __init__(self, T_body_cam: Mapping[str, np.ndarray], rules: Optional[TrackerRules] = None):
        self._T_body_cam = dict(T_body_cam)
        self.trackers: Dict[str, MocapTracker] = {n: MocapTracker(rules) for n in self._T_body_cam}
        self._T_home_mocap: Optional[np.ndarray] = None

    def add_mocap(self, name: str, now_s: float, stamp_s: float, p_M_D_m, q_M_D_xyzw) -> None:
        """A pose for one vehicle. Raises SampleRejected, also where another vehicle is in that
        place."""
        p = np.asarray(p_M_D_m, float)
        for other, tracker in self.trackers.items():
            if (
                other != name
                and self._is_at(tracker, p, now_s)
                and not self._is_at(self.trackers[name], p, now_s)
            ):
                self.trackers[name].counts.count("mocap: another vehicle's place")
                raise SampleRejected(
                    "another vehicle", f"mocap: the pose of {name} is where {other} is"
                )
        self.trackers[name].add_mocap(now_s, stamp_s, p_M_D_m, q_M_D_xyzw)

    def add_vehicle(
        self,
        name: str,
        now_s: float,
        stamp_s: float,
        p_O_D_m,
        q_O_D_xyzw,
        v_D_mps,
        gyro_radps,
        accel_mps2,
    ) -> None:
        """A packet of one vehicle's odometry and IMU; the velocity is in the body frame (REP 105's
        child frame)."""
        self.trackers[name].add_vehicle(
            now_s, stamp_s, p_O_D_m, q_O_D_xyzw, v_D_mps, gyro_radps, accel_mps2
        )

    @staticmethod
    def _is_at(tracker: MocapTracker, p_M: np.ndarray, now_s: float) -> bool:
        if tracker.filter is None:
            return False
        off = tracker.filter.state.p_M_D - p_M
        # NaN among them; asked for every frame, and far away as a rule
        if not off @ off < (_AS_FAR * _BODY_M) ** 2:
            return False
        known = tracker.guess(now_s)
        if known is None or now_s - known.stamp_s > _NOTICE_S:
            return False
        sigma_m = float(np.sqrt(np.trace(known.covariance[:3, :3]) / 3.0))
        return float(np.linalg.norm(known.T_M_D[:3, 3] - p_M)) < _BODY_M + 3.0 * min(
            sigma_m, _BODY_M
        )

    def level(self) -> Tuple[np.ndarray, float]:
        """R_M_W and its standard deviation (rad) of tilt (5.1). Raises GeometryError where no
        vehicle is anchored."""
        filters = [t.filter for t in self.trackers.values() if t.filter is not None]
        sigmas = [float(np.sqrt(np.trace(f.level_covariance()) / 2.0)) for f in filters]
        R_M_W = equations.level_horizon([f.state.R_M_O for f in filters], sigmas)
        return R_M_W, float(sum(s**-2.0 for s in sigmas)) ** -0.5

    def set_home(
        self, reference: str, now_s: float, R_M_W: Optional[np.ndarray] = None
    ) -> np.ndarray:
        """T_odom_home of the reference: its camera's place, level, its heading. Raises HomeRefused
        with the reason.

        ``R_M_W``: what counts as level; None: what is held for it now.
        """
        pose = self.trackers[reference].pose(now_s)
        if pose is None:
            raise HomeRefused(f"{reference} has no pose: {self.trackers[reference].absent_because}")
        sigma = np.sqrt(np.diag(pose.covariance))
        if sigma[:3].max() > _HOME_SIGMA_M or sigma[3:].max() > _HOME_SIGMA_RAD:
            raise HomeRefused(
                f"{reference}'s pose is known to {sigma[:3].max():.2f} m only: fly it into the mocap's view"
            )
        R_M_W = self.level()[0] if R_M_W is None else R_M_W
        T_M_W = transforms.transform(R_M_W, np.zeros(3))
        T_W_cam = transforms.invert(T_M_W) @ pose.T_M_D @ self._T_body_cam[reference]
        T_M_home = T_M_W @ home_of(T_W_cam)
        self._T_home_mocap = transforms.invert(T_M_home)
        return transforms.invert(pose.T_M_O) @ T_M_home

    @property
    def T_home_mocap(self) -> Optional[np.ndarray]:
        """None before home was set."""
        return self._T_home_mocap

    def camera(self, name: str, now_s: float) -> Optional[CameraPose]:
        """T_home_cam = T_home_M T_M_D T_D_C; None before home, and while the vehicle has no
        pose."""
        pose = self.trackers[name].pose(now_s)
        if pose is None or self._T_home_mocap is None:
            return None
        T_home_M, T_D_C = self._T_home_mocap, self._T_body_cam[name]
        covariance = equations.moved_covariance(
            pose.covariance, T_home_M[:3, :3], pose.T_M_D[:3, :3] @ T_D_C[:3, 3]
        )
        return CameraPose(pose.stamp_s, T_home_M @ pose.T_M_D @ T_D_C, covariance)

    def relative(self, a: str, b: str, now_s: float) -> Optional[Tuple[np.ndarray, np.ndarray]]:
        """T_Da_Db and its covariance (6,6) in Da's axes (5.3 and 5.4 are one where offsets are
        filtered)."""
        poses = [self.trackers[n].pose(now_s) for n in (a, b)]
        if any(p is None for p in poses):
            return None
        pa, pb = poses
        T = equations.relative_out_of_view(pa.T_M_O, pa.T_O_D, pb.T_M_O, pb.T_O_D)
        return T, equations.relative_covariance(pa.T_M_D, pa.covariance, pb.T_M_D, pb.covariance)
