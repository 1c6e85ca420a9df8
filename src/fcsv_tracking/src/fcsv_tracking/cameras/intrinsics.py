# SPDX-License-Identifier: Apache-2.0
"""Intrinsics of one camera from views of a chessboard (Zhang 2000, by OpenCV), bad views left out.

A small reprojection error alone says little: boards that all face the camera fit any focal length,
and boards in the middle leave the corners of the picture to the polynomial. Both are refused.
"""

from dataclasses import dataclass, field
from typing import Dict, List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_tracking.cameras.board import BoardView, Chessboard
from fcsv_tracking.errors import CameraCalibrationRefused

GRID = (6, 5)  # cells across and down in which corners are counted


@dataclass(frozen=True)
class IntrinsicsRules:
    """What is good enough."""

    least_views: int = 8
    least_coverage: float = 0.5  # share of the grid's cells that hold a corner of some view
    # likewise, of the cells at the border, where distortion is largest
    least_border_coverage: float = 0.35
    # between the two boards that differ most: parallel ones fit any focal length well
    least_tilt_deg: float = 12.0
    most_focal_std: float = 0.01  # of the focal length
    most_rms_px: float = 1.0
    bad_view_factor: float = 3.0  # a view is bad beyond this many times the median view's error ...
    bad_view_least_px: float = 0.5  # ... and beyond this

    def __post_init__(self):
        if self.least_views < 3:
            raise ValueError(f"least_views: {self.least_views} is less than 3")
        for name in ("least_coverage", "least_border_coverage"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: {getattr(self, name)} is not in 0..1")


@dataclass(frozen=True)
class Intrinsics:
    """The camera, rms over all corners (px), and error per view (px) of the views that it stands
    on.

    ``left_out`` maps a view's name to why; ``stds`` are those of fx, fy, cx, cy (px).
    """

    camera: PinholeCamera
    rms_px: float
    stds: Tuple[float, float, float, float]
    views: List[BoardView]
    errors_px: List[float]
    T_cam_board: List[np.ndarray]
    residuals_px: List[np.ndarray] = field(repr=False)
    left_out: Dict[str, str] = field(default_factory=dict)
    coverage: float = 0.0


def calibrate_intrinsics(
    views: Sequence[BoardView],
    board: Chessboard,
    size: Tuple[int, int],
    rules: IntrinsicsRules = IntrinsicsRules(),
) -> Intrinsics:
    """The camera of pictures of ``size`` (width, height), 5 distortion coefficients ("plumb_bob").

    Raises CameraCalibrationRefused with the reason and what to do.
    """
    kept, left_out = list(views), {}
    while True:
        _require_enough(kept, left_out, rules)
        _require_coverage(kept, size, rules)
        found = _calibrate(kept, board, size)
        bad = _bad_views(found, rules)
        if not bad:
            break
        left_out.update(
            {v.name: f"error {found.errors_px[i]:.2f} px" for i, v in enumerate(kept) if i in bad}
        )
        kept = [v for i, v in enumerate(kept) if i not in bad]
    _require_sharp(found, rules)
    return _with(found, left_out, float(occupied(kept, size).mean()))


def occupied(views: Sequence[BoardView], size: Tuple[int, int]) -> np.ndarray:
    """Which cells (rows, columns) of the grid over the picture hold a corner of some view."""
    cells = np.zeros(GRID[::-1], bool)
    for view in views:
        index = np.floor(view.corners_px / np.array(size) * GRID).astype(int)
        columns, rows = np.clip(index, 0, np.array(GRID) - 1).T
        cells[rows, columns] = True
    return cells


def _calibrate(views: Sequence[BoardView], board: Chessboard, size: Tuple[int, int]) -> Intrinsics:
    points = [board.points.astype(np.float32)] * len(views)
    pixels = [v.corners_px.astype(np.float32).reshape(-1, 1, 2) for v in views]
    try:
        rms, K, D, rvecs, tvecs, stds, _, errors = cv2.calibrateCameraExtended(
            points, pixels, size, None, None
        )
        camera = PinholeCamera(
            *size, K[0, 0], K[1, 1], K[0, 2], K[1, 2], tuple(D.ravel()[:5].tolist())
        )
    except cv2.error as error:
        raise CameraCalibrationRefused(
            f"no camera explains the views ({error.err}): check --board"
        ) from error
    poses, residuals = [], []
    for view, rvec, tvec in zip(views, rvecs, tvecs):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = cv2.Rodrigues(rvec)[0], tvec.ravel()
        poses.append(T)
        projected = cv2.projectPoints(board.points, rvec, tvec, K, D)[0].reshape(-1, 2)
        residuals.append(view.corners_px - projected)
    return Intrinsics(
        camera,
        float(rms),
        tuple(stds.ravel()[:4].tolist()),
        list(views),
        errors.ravel().tolist(),
        poses,
        residuals,
    )


def _bad_views(found: Intrinsics, rules: IntrinsicsRules) -> List[int]:
    """Indices of the views that fit far worse than the others: the worst half at most, the rest may
    be its fault."""
    errors = np.array(found.errors_px)
    limit = max(rules.bad_view_factor * float(np.median(errors)), rules.bad_view_least_px)
    bad = np.flatnonzero(errors > limit)
    return bad[np.argsort(errors[bad])][-max(1, len(bad) // 2) :].tolist() if len(bad) else []


def _with(found: Intrinsics, left_out: Dict[str, str], coverage: float) -> Intrinsics:
    return Intrinsics(
        found.camera,
        found.rms_px,
        found.stds,
        found.views,
        found.errors_px,
        found.T_cam_board,
        found.residuals_px,
        left_out,
        coverage,
    )


def _require_enough(
    views: Sequence[BoardView], left_out: Dict[str, str], rules: IntrinsicsRules
) -> None:
    if len(views) < rules.least_views:
        without = (
            f" ({len(left_out)} fitted badly and were left out: {', '.join(left_out)})"
            if left_out
            else ""
        )
        raise CameraCalibrationRefused(
            f"{len(views)} usable views of the board{without}, {rules.least_views} are needed: take more pictures with "
            f"the whole board in them, tilted differently in each"
        )


def _require_coverage(
    views: Sequence[BoardView], size: Tuple[int, int], rules: IntrinsicsRules
) -> None:
    cells = occupied(views, size)
    border = np.ones_like(cells)
    border[1:-1, 1:-1] = False
    shares = {
        "the picture": (cells.mean(), rules.least_coverage),
        "its border": (cells[border].mean(), rules.least_border_coverage),
    }
    for what, (share, least) in shares.items():
        if share < least:
            raise CameraCalibrationRefused(
                f"the board covers only {share:.0%} of {what}, {least:.0%} are needed: show it also "
                f"{_emptiest(cells)} of the picture"
            )


def _emptiest(cells: np.ndarray) -> str:
    """Where the next board should be, in words."""
    half_rows, half_columns = cells.shape[0] // 2, cells.shape[1] // 2
    parts = {
        "in the left half": cells[:, :half_columns],
        "in the right half": cells[:, -half_columns:],
        "in the upper half": cells[:half_rows],
        "in the lower half": cells[-half_rows:],
    }
    return min(parts, key=lambda name: parts[name].mean())


def _require_sharp(found: Intrinsics, rules: IntrinsicsRules) -> None:
    normals = np.array([T[:3, 2] for T in found.T_cam_board])
    tilt_deg = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max()))
    if tilt_deg < rules.least_tilt_deg:
        raise CameraCalibrationRefused(
            f"all boards are parallel to within {tilt_deg:.0f} deg (at least {rules.least_tilt_deg:.0f} needed), which "
            f"leaves the focal length open: tilt the board by 30 to 45 degrees, to all sides"
        )
    share = max(found.stds[0] / found.camera.fx, found.stds[1] / found.camera.fy)
    if not share <= rules.most_focal_std:
        raise CameraCalibrationRefused(
            f"the focal length is only known to {share:.1%} (bound {rules.most_focal_std:.1%}): tilt the board by "
            f"30 to 45 degrees, to all sides, instead of holding it parallel to the picture"
        )
    if not found.rms_px <= rules.most_rms_px:
        raise CameraCalibrationRefused(
            f"the corners are {found.rms_px:.2f} px off (bound {rules.most_rms_px} px): a bent board, a moving one, "
            f"or a picture size or board that is not what was given"
        )
