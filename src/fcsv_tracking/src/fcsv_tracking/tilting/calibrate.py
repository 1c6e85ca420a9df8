# SPDX-License-Identifier: Apache-2.0
"""Axes and mounts of a tilting rig from views of a board of tags: one adjustment of all of them.

Unknown: both axes (direction and place, four numbers each), the right camera at angle zero (six;
its turn about the axis is the servo's zero), the board at every station, and every angle, which is
only read to a tick. The left camera at angle zero is where the file has it: that fixes the rig's
frame.
"""

from dataclasses import dataclass, replace
from typing import Dict, List, Sequence, Tuple

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_tracking.errors import CalibrationRefused
from fcsv_tracking.tilting.board import SideBoardView
from fcsv_tracking.tilting.rig import SIDES, RigSigma, TiltAngles, TiltAxis, TiltingRig

_SHARED = 14  # left axis (4), right axis (4), right camera (rotation, position)
_STEP = 1e-6
_OUTLIER_SIGMAS = 5.0
# of the largest eigenvalue of the scaled normal matrix: what is smaller is not observed
_LEAST_SHARE = 1e-9


@dataclass(frozen=True)
class TiltRules:
    """Noise of corners that is assumed, and what is good enough."""

    corner_noise_px: float = 0.15
    least_views: int = 6  # of each side
    least_spread_deg: float = 10.0  # of each side's angles
    # of the right camera against the left one, per axis, anywhere inside the limits
    most_rotation_deg: float = 0.1
    most_position_m: float = 0.001

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class TiltSolution:
    """The rig with what was found and how well it is known; ``covariance`` (14, 14) is of what the
    module names, in its order: axes (m, rad), the right camera's small rotation and displacement in
    the rig's axes."""

    rig: TiltingRig
    covariance: np.ndarray
    rms_px: float
    used: int
    rejected: int


def calibrate(
    rig: TiltingRig, views: Sequence[SideBoardView], rules: TiltRules = TiltRules()
) -> TiltSolution:
    """Start from the rig's file, fit robustly, leave out corners that do not fit, fit again, say
    how good it is.

    Raises CalibrationRefused with the reason and what to do.
    """
    _require_views(rig, views, rules)
    model = _Model(rig, views, rules)
    x = model.fit(model.start(), robust=True)
    rejected = model.leave_out(x)
    x = model.fit(x, robust=False)
    residuals = model.corner_residuals(x)
    covariance = _covariance(model, x)
    found = model.rig_of(x)
    rotation_deg, position_m = _spread(rig, model, x, covariance)
    if rotation_deg > rules.most_rotation_deg or position_m > rules.most_position_m:
        raise CalibrationRefused(
            f"the right camera is only known to {rotation_deg:.3f} deg and {position_m * 1e3:.2f} mm (bounds "
            f"{rules.most_rotation_deg} deg, {rules.most_position_m * 1e3:g} mm): take more views, at more angles"
        )
    found = replace(found, known=RigSigma(rotation_deg, position_m, rig.known.reading_deg))
    rms_px = float(np.sqrt((residuals**2).mean()))
    return TiltSolution(found, covariance, rms_px, len(residuals) // 2, rejected)


def _require_views(rig: TiltingRig, views: Sequence[SideBoardView], rules: TiltRules) -> None:
    """What no adjustment could find is refused in words."""
    seen: Dict[str, List[SideBoardView]] = {
        side: [v for v in views if v.side == side] for side in SIDES
    }
    for side, own in seen.items():
        if len(own) < rules.least_views:
            raise CalibrationRefused(
                f"the {side} camera sees the board in {len(own)} pictures, {rules.least_views} are needed: "
                "check the board's size and ids"
            )
        spread = np.degrees(np.ptp([v.angle_rad for v in own]))
        if spread < rules.least_spread_deg:
            raise CalibrationRefused(
                f"the {side} camera's angles span {spread:.1f} deg, {rules.least_spread_deg:g} are needed to tell its "
                "axis: turn it through all of its range"
            )
    shared = {v.station for v in seen["left"]} & {v.station for v in seen["right"]}
    if not shared:
        raise CalibrationRefused(
            "no station is seen by both cameras: how they lie to each other cannot be known; place the board where "
            "both see it"
        )


class _Model:
    """Residuals of corners (px over their noise) and of angles (over a reading's), and their
    derivatives.

    Parameters: 14 that are shared, six of the board at each station (rotation, place), one of each
    view's angle.
    """

    def __init__(self, rig: TiltingRig, views: Sequence[SideBoardView], rules: TiltRules):
        self.rig, self._views, self._rules = rig, list(views), rules
        self._stations = sorted({v.station for v in views})
        self._station = np.array([self._stations.index(v.station) for v in views])
        self._right = np.array([v.side == "right" for v in views])
        self._angle = np.array([v.angle_rad for v in views])
        self._view = np.repeat(np.arange(len(views)), [len(v.points_m) for v in views])
        self._points = np.concatenate([v.points_m for v in views])
        self._measured = np.concatenate([v.corners_normalized for v in views])
        self._focal_px = np.array([v.focal_px for v in views])[self._view]
        self._kept = np.ones(len(self._view), bool)
        self._T_rig_board = np.array([self._first_board(s) for s in self._stations])
        self._across = [_perpendicular(getattr(rig, side).axis.unit) for side in SIDES]

    def start(self) -> np.ndarray:
        """Zero: all parameters are small changes of the first guess."""
        return np.zeros(_SHARED + 6 * len(self._stations) + len(self._views))

    def _first_board(self, station: str) -> np.ndarray:
        """T_rig_board by the view of a station with the most corners."""
        best = max((v for v in self._views if v.station == station), key=lambda v: len(v.points_m))
        found, rvec, tvec = cv2.solvePnP(best.points_m, best.corners_normalized, np.eye(3), None)
        if not found or tvec[2, 0] <= 0:
            raise CalibrationRefused(
                f"{best.name or station}: the tags' corners are no view of the board"
            )
        T_cam_board = transforms.transform(cv2.Rodrigues(rvec)[0], tvec.ravel())
        return getattr(self.rig, best.side).T_rig_cam(best.angle_rad) @ T_cam_board

    def rig_of(self, x: np.ndarray) -> TiltingRig:
        """The rig with the shared parameters."""
        axes = []
        for k, side in enumerate(SIDES):
            axis, across = getattr(self.rig, side).axis, self._across[k]
            p = x[4 * k : 4 * k + 4]
            unit = Rotation.from_rotvec(across.T @ p[:2]).apply(axis.unit)
            place = np.asarray(axis.xyz_m, float) + across.T @ p[2:]
            axes.append(TiltAxis(tuple(map(float, place)), tuple(map(float, unit))))
        T = self.rig.right.mount.T_body_part.copy()
        T[:3, :3] = Rotation.from_rotvec(x[8:11]).as_matrix() @ T[:3, :3]
        T[:3, 3] += x[11:14]
        mount = Mount(tuple(map(float, T[:3, 3])), tuple(map(float, np.degrees(transforms.rpy(T)))))
        left, right = (
            replace(self.rig.left, axis=axes[0]),
            replace(self.rig.right, axis=axes[1], mount=mount),
        )
        return replace(self.rig, left=left, right=right)

    def _corners(self, x: np.ndarray) -> np.ndarray:
        """(N,2) px, predicted less measured."""
        rig, n = self.rig_of(x), len(self._stations)
        boards = x[_SHARED : _SHARED + 6 * n].reshape(n, 6)
        R_rb = Rotation.from_rotvec(boards[:, :3]).as_matrix() @ self._T_rig_board[:, :3, :3]
        p_rb = self._T_rig_board[:, :3, 3] + boards[:, 3:]
        angles = self._angle + x[_SHARED + 6 * n :]
        R_cr, p_rc = np.empty((len(angles), 3, 3)), np.empty((len(angles), 3))
        for is_right, side in ((False, rig.left), (True, rig.right)):
            own = self._right == is_right
            turn = Rotation.from_rotvec(angles[own, None] * side.axis.unit).as_matrix()
            T0, at = side.T_rig_cam(0.0), np.asarray(side.axis.xyz_m, float)
            R_cr[own] = np.swapaxes(turn @ T0[:3, :3], 1, 2)
            p_rc[own] = at + turn @ (T0[:3, 3] - at)
        s = self._station[self._view]
        p_rig = np.einsum("nij,nj->ni", R_rb[s], self._points) + p_rb[s]
        p_cam = np.einsum("nij,nj->ni", R_cr[self._view], p_rig - p_rc[self._view])
        xy = p_cam[:, :2] / np.maximum(p_cam[:, 2:], 1e-3)
        return (xy - self._measured) * self._focal_px[:, None]

    def corner_residuals(self, x: np.ndarray) -> np.ndarray:
        """(2N,) px of the corners that are kept."""
        return self._corners(x)[self._kept].ravel()

    def _residuals(self, x: np.ndarray) -> np.ndarray:
        angles = x[_SHARED + 6 * len(self._stations) :] / self.rig.angle_std_rad
        return np.concatenate([self.corner_residuals(x) / self._rules.corner_noise_px, angles])

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Gives the derivatives of the residuals. A board moves its station's corners alone and an
        angle its view's: all at once each."""
        n, base = len(self._stations), self.corner_residuals(x) / self._rules.corner_noise_px
        J = np.zeros((len(base) + len(self._views), len(x)))
        view = np.repeat(self._view[self._kept], 2)

        def slope(columns) -> np.ndarray:
            moved = x.copy()
            moved[columns] += _STEP
            return (self.corner_residuals(moved) / self._rules.corner_noise_px - base) / _STEP

        for k in range(_SHARED):
            J[: len(base), k] = slope(k)
        rows, station = np.arange(len(base)), self._station[view]
        for k in range(6):
            J[rows, _SHARED + 6 * station + k] = slope(_SHARED + 6 * np.arange(n) + k)
        J[rows, _SHARED + 6 * n + view] = slope(slice(_SHARED + 6 * n, None))
        own = np.arange(len(self._views))
        J[len(base) + own, _SHARED + 6 * n + own] = 1.0 / self.rig.angle_std_rad
        return J

    def fit(self, x: np.ndarray, robust: bool) -> np.ndarray:
        loss = {"loss": "soft_l1", "f_scale": 2.0} if robust else {}
        # steps by lsmr: a decomposition of the whole matrix takes several times as long
        options = {
            "x_scale": "jac",
            "tr_solver": "lsmr",
            "max_nfev": 60,
            "ftol": 1e-6,
            "xtol": 1e-7,
        }
        return least_squares(self._residuals, x, self.jacobian, **options, **loss).x

    def leave_out(self, x: np.ndarray) -> int:
        """Corners far off; how many."""
        off_px = np.linalg.norm(self._corners(x), axis=1)
        # the median of Rayleigh's law
        noise_px = max(self._rules.corner_noise_px, float(np.median(off_px)) / 1.18)
        self._kept = off_px < _OUTLIER_SIGMAS * noise_px
        return int((~self._kept).sum())


def _covariance(model: _Model, x: np.ndarray) -> np.ndarray:
    """(14, 14). Raises CalibrationRefused where some of it is not observed."""
    J = model.jacobian(x)
    scale = np.linalg.norm(J, axis=0)
    if scale.min() <= 0.0:
        raise CalibrationRefused(
            "some of the rig is in no view: take pictures with both cameras at many angles"
        )
    H = (J / scale).T @ (J / scale)
    values = np.linalg.eigvalsh(H)
    if values[0] < _LEAST_SHARE * values[-1]:
        raise CalibrationRefused(
            "these views leave an axis or a camera open: keep rig and board still while each camera turns through its "
            "range, and do so from several places"
        )
    residuals = model.corner_residuals(x) / model._rules.corner_noise_px
    per_dof = float((residuals**2).sum()) / max(1, len(residuals) - _SHARED)
    return (np.linalg.inv(H) / np.outer(scale, scale) * max(1.0, per_dof))[:_SHARED, :_SHARED]


def _spread(
    rig: TiltingRig, model: _Model, x: np.ndarray, covariance: np.ndarray
) -> Tuple[float, float]:
    """Largest standard deviation per axis of the right camera against the left one at exact angles:
    deg, m."""
    low, high = np.radians(rig.limits_deg)
    pairs = (
        [(low, low), (high, high)]
        if rig.coupled
        else [(low, low), (low, high), (high, low), (high, high)]
    )
    rotation, position = 0.0, 0.0
    for angles in pairs:
        at = TiltAngles(*map(float, angles))
        T = model.rig_of(x).T_left_right(at)
        J = np.empty((6, _SHARED))
        for k in range(_SHARED):
            moved = x.copy()
            moved[k] += _STEP
            M = model.rig_of(moved).T_left_right(at)
            J[:3, k] = Rotation.from_matrix(M[:3, :3] @ T[:3, :3].T).as_rotvec() / _STEP
            J[3:, k] = (M[:3, 3] - T[:3, 3]) / _STEP
        sigma = np.sqrt(np.diag(J @ covariance @ J.T))
        rotation, position = (
            max(rotation, float(sigma[:3].max())),
            max(position, float(sigma[3:].max())),
        )
    return float(np.degrees(rotation)), position


def _perpendicular(unit: np.ndarray) -> np.ndarray:
    """(2,3): two unit vectors across a direction."""
    first = np.cross(unit, np.eye(3)[int(np.argmin(np.abs(unit)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(unit, first)])
