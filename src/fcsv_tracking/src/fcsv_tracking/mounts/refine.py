# SPDX-License-Identifier: Apache-2.0
"""The mount of a camera or tag from all corners at once, weighed for what odometry and corners are
worth.

The odometry drifts while the vehicle is moved (a random walk over the path), so the errors of
neighbouring views go together; a plain sum of squares would take the drift for corner noise and
report too small an error.
"""

from dataclasses import dataclass
from typing import Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_tracking.errors import ExtrinsicsRefused
from fcsv_tracking.mounts.hand_eye import (
    PARTS,
    TagView,
    first_solution,
    predicted_T_cam_tag,
    require_motion,
)
from fcsv_tracking.tags import corner_points

_CHI2_8_MEDIAN, _CHI2_8_LIMIT = 7.34, 26.1  # as in link_solver
_STEP = 1e-6


@dataclass(frozen=True)
class MountRules:
    """Noise that is assumed (standard deviations), and what is good enough."""

    corner_noise_px: float = 0.2
    attitude_noise_deg: float = 0.1  # of the odometry and its interpolation, vehicle in the hand
    position_noise_m: float = 0.003
    least_views: int = 20
    least_turn_deg: float = 6.0  # rms, about two axes each
    most_position_std_m: float = 0.01
    most_rotation_std_deg: float = 0.4
    tracker: TrackerProfile = T265_PROFILE

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class MountSolution:
    """T_body_part (camera's optical or tag's frame) and T_odom_fixed (what stood still).

    ``covariance`` (6,6) is of a small displacement (m) and rotation (rad) about the part's own
    axes.
    """

    part: str
    T_body_part: np.ndarray
    T_odom_fixed: np.ndarray
    covariance: np.ndarray
    reprojection_rms_px: float
    used: int
    rejected: int

    @property
    def position_std_m(self) -> float:
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def rotation_std_deg(self) -> float:
        return float(np.degrees(np.sqrt(np.trace(self.covariance[3:, 3:]))))


def calibrate_mount(
    part: str, views: Sequence[TagView], rules: MountRules = MountRules()
) -> MountSolution:
    """Start by hand-eye, robust fit, views that do not fit left out, then all with their common
    errors.

    Raises ExtrinsicsRefused with the reason and what to do.
    """
    if part not in PARTS:
        raise ValueError(f"part: '{part}' is not one of {', '.join(PARTS)}")
    views = sorted(views, key=lambda v: v.stamp_s)
    _require_enough(views, len(views), rules)
    require_motion(views, rules.least_turn_deg)
    X, Z = first_solution(part, views)
    model = _MountModel(part, views, rules)
    X, Z = model.fit(X, Z, robust=True)[:2]
    chi2 = model.chi2(X, Z)
    scale = np.clip(np.median(chi2) / _CHI2_8_MEDIAN, 1.0, 25.0)
    kept = [v for v, c in zip(views, chi2) if c < _CHI2_8_LIMIT * scale]
    _require_enough(kept, len(views), rules)
    require_motion(kept, rules.least_turn_deg)
    model = _MountModel(part, kept, rules)
    X, Z, covariance = model.fit(X, Z, robust=False)
    rms_px = float(np.sqrt((model.residuals(X, Z) ** 2).sum(axis=1).mean() / 4.0))
    solution = MountSolution(
        part, X, Z, covariance[:6, :6], rms_px, len(kept), len(views) - len(kept)
    )
    _require_tight(solution, rules)
    return solution


def _require_enough(views: Sequence[TagView], of: int, rules: MountRules) -> None:
    if len(views) < rules.least_views:
        raise ExtrinsicsRefused(
            f"{len(views)} of {of} views of the tag are usable, {rules.least_views} are needed: move for half a minute "
            f"with the tag in view; check the tag's size and id, and that what should stand still did"
        )


def _require_tight(solution: MountSolution, rules: MountRules) -> None:
    if (
        solution.position_std_m > rules.most_position_std_m
        or solution.rotation_std_deg > rules.most_rotation_std_deg
    ):
        raise ExtrinsicsRefused(
            f"the {solution.part} is only known to {solution.position_std_m * 1e3:.1f} mm and "
            f"{solution.rotation_std_deg:.2f} deg (bounds {rules.most_position_std_m * 1e3:.0f} mm, "
            f"{rules.most_rotation_std_deg} deg): go nearer to the tag, turn further, take more views"
        )


class _MountModel:
    """Residuals (N,8) px of all views, and their covariance."""

    def __init__(self, part: str, views: Sequence[TagView], rules: MountRules):
        self._part, self._rules = part, rules
        self._A = np.stack([v.T_odom_body for v in views])
        self._measured = np.stack([v.corners_normalized for v in views])
        self._focal_px = np.array([v.focal_px for v in views])
        points = np.stack([corner_points(v.size_m) for v in views])
        self._points = np.concatenate([points, np.ones_like(points[..., :1])], axis=-1)
        steps_m = np.linalg.norm(np.diff(self._A[:, :3, 3], axis=0), axis=1)
        self._path_m = np.concatenate([[0.0], np.cumsum(steps_m)])

    def residuals(self, X: np.ndarray, Z: np.ndarray, A: np.ndarray = None) -> np.ndarray:
        T = predicted_T_cam_tag(self._part, self._A if A is None else A, X, Z)
        p = np.einsum("nij,nkj->nki", T, self._points)
        # a start that puts the tag behind the camera stays finite
        depth = np.maximum(p[..., 2:3], 1e-3)
        return ((p[..., :2] / depth - self._measured) * self._focal_px[:, None, None]).reshape(
            len(T), 8
        )

    def fit(
        self, X0: np.ndarray, Z0: np.ndarray, robust: bool
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """X, Z and the covariance (12,12) of both; two rounds, since the weights depend on the
        solution."""
        covariance = np.full((12, 12), np.nan)
        for _ in range(2):
            W = np.linalg.inv(
                np.linalg.cholesky(self._own(X0, Z0) if robust else self._whole(X0, Z0))
            )

            def whitened(d, X0=X0, Z0=Z0, W=W):
                r = self.residuals(X0 @ _small(d[:6]), Z0 @ _small(d[6:]))
                return (W @ r[..., None]).ravel() if robust else W @ r.ravel()

            options = {"loss": "soft_l1", "f_scale": 2.0} if robust else {}
            result = least_squares(
                whitened, np.zeros(12), jac="3-point", x_scale="jac", max_nfev=60, **options
            )
            X0, Z0 = X0 @ _small(result.x[:6]), Z0 @ _small(result.x[6:])
            if not robust:
                chi2_per_dof = 2.0 * result.cost / (self._measured.size - 12)
                covariance = np.linalg.pinv(result.jac.T @ result.jac) * max(1.0, chi2_per_dof)
        return X0, Z0, covariance

    def chi2(self, X: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """(N,) of each view by its own covariance."""
        L = np.linalg.cholesky(self._own(X, Z))
        return (np.linalg.solve(L, self.residuals(X, Z)[..., None]) ** 2).sum(axis=(1, 2))

    def _by_body(self, X: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """(N,8,6) px per displacement (m, odometry's axes) and rotation (rad, likewise) of the
        body."""
        columns = []
        for k in range(6):
            d = np.zeros(6)
            d[k] = _STEP
            sides = []
            for sign in (1.0, -1.0):
                moved = self._A.copy()
                moved[:, :3, 3] += sign * d[:3]
                moved[:, :3, :3] = (
                    Rotation.from_rotvec(sign * d[3:]).as_matrix() @ self._A[:, :3, :3]
                )
                sides.append(self.residuals(X, Z, moved))
            columns.append((sides[0] - sides[1]) / (2 * _STEP))
        return np.stack(columns, axis=-1)

    def _own(self, X: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """(N,8,8) px^2: corners, and the body's pose without the walk's common part."""
        J, rules = self._by_body(X, Z), self._rules
        sigma2 = np.repeat(
            [rules.position_noise_m**2, np.radians(rules.attitude_noise_deg) ** 2], 3
        )
        middle_m = np.abs(self._path_m - self._path_m.mean())
        walk_m2 = rules.tracker.walk_m_per_sqrt_m**2 * middle_m
        walk = walk_m2[:, None, None] * (J[..., :3] @ J[..., :3].transpose(0, 2, 1))
        return rules.corner_noise_px**2 * np.eye(8) + (J * sigma2) @ J.transpose(0, 2, 1) + walk

    def _whole(self, X: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """(8N,8N) px^2 with the walks of position and heading along the path."""
        J, rules, n = self._by_body(X, Z), self._rules, len(self._A)
        sigma2 = np.repeat(
            [rules.position_noise_m**2, np.radians(rules.attitude_noise_deg) ** 2], 3
        )
        common_m = np.minimum(self._path_m[:, None], self._path_m[None, :])
        position = np.einsum(
            "ij,iak,jbk->iajb",
            rules.tracker.walk_m_per_sqrt_m**2 * common_m,
            J[..., :3],
            J[..., :3],
            optimize=True,
        )
        heading2 = np.radians(rules.tracker.heading_deg_per_sqrt_m) ** 2
        heading = np.einsum(
            "ij,ia,jb->iajb", heading2 * common_m, J[..., 5], J[..., 5], optimize=True
        )
        C, i = position + heading, np.arange(n)
        C[i, :, i, :] += rules.corner_noise_px**2 * np.eye(8) + (J * sigma2) @ J.transpose(0, 2, 1)
        return C.reshape(8 * n, 8 * n)


def _small(d: np.ndarray) -> np.ndarray:
    """A transform of a displacement (3) and a rotation vector (3)."""
    return transforms.transform(Rotation.from_rotvec(d[3:]).as_matrix(), d[:3])
