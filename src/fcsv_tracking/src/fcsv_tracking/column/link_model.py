# SPDX-License-Identifier: Apache-2.0
"""What a camera should see of a tag, given the link between two odometry frames, and how wrong it
may be.

Unknowns x = (c, yaw): c is where the child's mean camera position m lies in the parent's odometry
frame, so T_Op_Oc = Trans(c) Rz(yaw) Trans(-m). About m the unknowns are nearly uncorrelated; about
odometry's origin, tens of metres away, yaw and position would be one.

Predicted corner = inv(T_Oc_C(t)) @ inv(T_Op_Oc) @ T_Op_A(t) @ corner: equation 6.1 read the other
way round. Residuals are in pixels.
"""

import copy
import math
from dataclasses import dataclass, replace
from typing import Sequence, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_tracking.column.detection import Detection
from fcsv_tracking.tags import corner_points

_SHARPEST_PX = 0.03  # no detector is better, however few corners agree by chance


@dataclass(frozen=True)
class LinkNoise:
    """Standard deviations. Attitude and clocks move the whole tag in the picture (0.5 to 1 px at
    3.5 m), while its size and shape are as sharp as the corners: both are weighed for what they
    are.

    What the trackers do is in their profile; the rest is what a calibration adds.
    """

    corner_noise_px: float = 0.15  # at most: the detections of a calibration show how much it is
    interpolation_deg: float = 0.07416  # of the child's attitude, to the picture's stamp
    interpolation_m: float = 0.003708  # of both positions, and of the clocks
    mount_level_deg: float = 0.03  # how level the tracker was taken to sit on the body
    # between the two machines: common to all detections, as far as the parent moves
    clock_s: float = 0.02
    tracker: TrackerProfile = T265_PROFILE

    def __post_init__(self):
        require_positive(self)

    @property
    def attitude_noise_deg(self) -> float:
        """Gives the noise of the child's odometry at a picture's stamp."""
        return math.hypot(self.tracker.attitude_noise_deg, self.interpolation_deg)

    @property
    def position_noise_m(self) -> float:
        """Gives the noise of either odometry at a picture's stamp."""
        return math.hypot(self.tracker.position_noise_m, self.interpolation_m)

    @property
    def level_deg(self) -> float:
        """Constant error of either vertical."""
        return math.hypot(self.tracker.level_deg, self.mount_level_deg)


class LinkModel:
    """All detections of one tag by one camera, in order of time, as arrays."""

    def __init__(self, detections: Sequence[Detection], noise: LinkNoise):
        self.noise = noise
        self.focal_px = np.array([d.focal_px for d in detections])
        self.measured = np.stack([d.corners_normalized for d in detections])  # (N, 4, 2)
        T_Op_A = np.stack([d.T_odom_tag for d in detections])
        T_Oc_C = np.stack([d.T_odom_cam for d in detections])
        corners = np.stack([corner_points(d.size_m) for d in detections])
        self.p_Op = np.einsum("nij,nkj->nki", T_Op_A[:, :3, :3], corners) + T_Op_A[:, None, :3, 3]
        self.p_Op_A = T_Op_A[:, :3, 3]
        self.R_C_Oc = T_Oc_C[:, :3, :3].transpose(0, 2, 1)
        self.p_Oc_C = T_Oc_C[:, :3, 3]
        self.mean_Oc_C = self.p_Oc_C.mean(axis=0)
        self.v_Op_A = _velocities(np.array([d.stamp_s for d in detections]), self.p_Op_A)
        self._paths_m = [_path_to_end(self.p_Op_A), _path_to_end(self.p_Oc_C)]

    def __len__(self) -> int:
        return len(self.focal_px)

    def subset(self, keep: np.ndarray) -> "LinkModel":
        """The model of some of the detections, with the same unknowns and paths."""
        part = copy.copy(self)
        for name in ("focal_px", "measured", "p_Op", "p_Op_A", "R_C_Oc", "p_Oc_C", "v_Op_A"):
            setattr(part, name, getattr(self, name)[keep])
        part._paths_m = [path_m[keep] for path_m in self._paths_m]
        return part

    def with_measured_corners(self, x: np.ndarray) -> "LinkModel":
        """The same, with the corners' noise as the tags' shapes show it at x, where that is less
        than was assumed.

        What the tag's place in each picture explains is taken off first: attitude, clocks, the walk
        of odometry.
        """
        r = self.residuals(x)[..., None]
        by_place = self._projection_jacobian(self._in_camera(x)[1]).reshape(len(self), 8, 3)
        shape = r - by_place @ (np.linalg.pinv(by_place) @ r)
        measured_px = float(np.sqrt((shape**2).sum() / (5 * len(self) - 1)))
        same = copy.copy(self)
        corner_px = min(self.noise.corner_noise_px, max(_SHARPEST_PX, measured_px))
        same.noise = replace(self.noise, corner_noise_px=corner_px)
        return same

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """(N, 8) px: predicted minus measured corners."""
        p_C = self._in_camera(x)[1]
        difference = p_C[..., :2] / p_C[..., 2:] - self.measured
        return (difference * self.focal_px[:, None, None]).reshape(len(self), 8)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """(N, 8, 4) of residuals with respect to x."""
        q, p_C = self._in_camera(x)
        d_point = self._projection_jacobian(p_C)  # with respect to q
        J_c = -d_point @ rotations.turn_about_z(-x[3])
        minus_z_cross_q = np.stack([q[..., 1], -q[..., 0], np.zeros_like(q[..., 0])], axis=-1)
        J_yaw = d_point @ minus_z_cross_q[..., None]
        return np.concatenate([J_c, J_yaw], axis=-1).reshape(len(self), 8, 4)

    def covariance(self, x: np.ndarray) -> np.ndarray:
        """(8N, 8N) px^2 of the residuals: corners, common shifts, and the walk of both odometries
        back from the end.

        The walk is nought at the last detection, so the link is estimated for the end of the
        calibration, when it begins to be used.
        """
        n = len(self)
        p_C = self._in_camera(x)[1]
        # with respect to the child's position, negative
        d_point = self._projection_jacobian(p_C).reshape(n, 8, 3)
        C = np.zeros((n, 8, n, 8))
        for path_m, B in zip(self._paths_m, (d_point @ rotations.turn_about_z(-x[3]), -d_point)):
            walk_m2 = self.noise.tracker.walk_m_per_sqrt_m**2 * np.minimum(
                path_m[:, None], path_m[None, :]
            )
            C += np.einsum("ij,iak,jbk->iajb", walk_m2, B, B, optimize=True)
        late = self._by_clock(x, d_point)
        C += np.einsum("ia,jb->iajb", late, late)
        i = np.arange(n)
        C[i, :, i, :] += self._own_noise(p_C)
        return C.reshape(8 * n, 8 * n)

    def blocks(self, x: np.ndarray) -> np.ndarray:
        """(N, 8, 8) px^2: each detection's own covariance, the diagonal of covariance()."""
        p_C = self._in_camera(x)[1]
        d_point = self._projection_jacobian(p_C).reshape(len(self), 8, 3)
        walk_m2 = self.noise.tracker.walk_m_per_sqrt_m**2 * (self._paths_m[0] + self._paths_m[1])
        late = self._by_clock(x, d_point)
        own = self._own_noise(p_C) + late[:, :, None] * late[:, None, :]
        return own + walk_m2[:, None, None] * d_point @ d_point.transpose(0, 2, 1)

    def _by_clock(self, x: np.ndarray, d_point: np.ndarray) -> np.ndarray:
        """(N, 8) px that one standard deviation of the clocks' difference moves the tag in the
        picture."""
        return self.noise.clock_s * np.einsum(
            "nak,nk->na", d_point @ rotations.turn_about_z(-x[3]), self.v_Op_A
        )

    def drift_covariance(self, x: np.ndarray) -> np.ndarray:
        """(4, 4) of x that no number of detections averages away: level errors, heading drift."""
        range_m = np.linalg.norm(self._in_camera(x)[1], axis=-1).mean()
        level_m = np.radians(self.noise.level_deg) * range_m * np.sqrt(2.0)
        heading = np.radians(self.noise.tracker.heading_deg_per_sqrt_m)
        path_m = float(sum(path.max() for path in self._paths_m))
        return np.diag([0.0, 0.0, level_m**2, heading**2 * path_m])

    def link(self, x: np.ndarray, covariance: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """T_Op_Oc and the covariance (4, 4) of its x, y, z, yaw, from x and its covariance."""
        arm = rotations.turn_about_z(x[3]) @ self.mean_Oc_C
        J = np.eye(4)
        J[:2, 3] = [arm[1], -arm[0]]
        return transforms.from_xyz_yaw(x[:3] - arm, x[3]), J @ covariance @ J.T

    def _own_noise(self, p_C: np.ndarray) -> np.ndarray:
        """(N, 8, 8) px^2 of corners, and of what moves all four together."""
        range_m = p_C[..., 2].mean(axis=1)
        noise = self.noise
        shift_px = self.focal_px * np.hypot(
            np.radians(noise.attitude_noise_deg), noise.position_noise_m / range_m
        )
        common = np.tile(np.eye(2), (4, 4))
        return noise.corner_noise_px**2 * np.eye(8) + (shift_px**2)[:, None, None] * common

    def _in_camera(self, x: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Corners (N, 4, 3) relative to the child's mean camera position, in its odometry's axes;
        and in the camera."""
        # row vectors: Rz(-yaw) from the left
        q = (self.p_Op - x[:3]) @ rotations.turn_about_z(x[3])
        return q, np.einsum(
            "nij,nkj->nki", self.R_C_Oc, q + (self.mean_Oc_C - self.p_Oc_C)[:, None]
        )

    def _projection_jacobian(self, p_C: np.ndarray) -> np.ndarray:
        """(N, 4, 2, 3) px per metre in the child's odometry axes."""
        x, y, z = p_C[..., 0], p_C[..., 1], p_C[..., 2]
        D = np.zeros((*p_C.shape[:2], 2, 3))
        D[..., 0, 0] = D[..., 1, 1] = 1.0 / z
        D[..., 0, 2], D[..., 1, 2] = -x / z**2, -y / z**2
        return self.focal_px[:, None, None, None] * D @ self.R_C_Oc[:, None]


def _velocities(stamps_s: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(N, 3) by differences between neighbouring detections; nought where there is one alone."""
    if len(p) < 2 or (np.diff(stamps_s) <= 0).any():
        return np.zeros_like(p)
    return np.gradient(p, stamps_s, axis=0)


def _path_to_end(p: np.ndarray) -> np.ndarray:
    """Distance (N,) still moved after each of the positions."""
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    return np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
