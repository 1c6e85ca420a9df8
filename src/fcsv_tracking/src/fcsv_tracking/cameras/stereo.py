# SPDX-License-Identifier: Apache-2.0
"""Two cameras on one mount: the pose of one against the other from pairs of pictures of a
chessboard."""

from dataclasses import dataclass, field
from typing import Dict, List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_tracking.cameras.board import BoardView, Chessboard
from fcsv_tracking.errors import CameraCalibrationRefused

_LEAST_PAIRS = 5
_MOST_RMS_PX = 1.5


@dataclass(frozen=True)
class StereoCalibration:
    """T_right_left takes points of the left optical frame to the right one; ``errors_px`` per pair
    (left, right)."""

    T_right_left: np.ndarray
    rms_px: float
    pairs: List[str]
    errors_px: List[Tuple[float, float]]
    left_out: Dict[str, str] = field(default_factory=dict)

    @property
    def baseline_m(self) -> float:
        return float(np.linalg.norm(self.T_right_left[:3, 3]))


def calibrate_stereo(
    left_views: Sequence[BoardView],
    right_views: Sequence[BoardView],
    board: Chessboard,
    left: PinholeCamera,
    right: PinholeCamera,
) -> StereoCalibration:
    """The pair, intrinsics given and kept; views of one name belong together.

    A pair that the two orders of the corners tell apart badly, or that fits far worse than the
    others, is left out by name. Raises CameraCalibrationRefused with the reason and what to do.
    """
    rights = {v.name: v for v in right_views}
    pairs = [(v, _same_order(v, rights[v.name])) for v in left_views if v.name in rights]
    left_out: Dict[str, str] = {}
    while True:
        if len(pairs) < _LEAST_PAIRS:
            raise CameraCalibrationRefused(
                f"{len(pairs)} pairs show the board to both cameras, {_LEAST_PAIRS} are needed: hold it where both "
                f"see it, and let the pictures of a pair have one name (left01, right01) or one stamp"
            )
        rms_px, T_right_left, errors = _calibrate(pairs, board, left, right)
        worst = np.max(errors, axis=1)
        index = int(np.argmax(worst))
        if worst[index] <= max(3.0 * float(np.median(worst)), 0.5):
            break
        left_out[pairs[index][0].name] = f"error {worst[index]:.2f} px"
        del pairs[index]
    if rms_px > _MOST_RMS_PX:
        raise CameraCalibrationRefused(
            f"the pairs are {rms_px:.2f} px off (bound {_MOST_RMS_PX} px): are the pictures of a pair of one moment?"
        )
    names = [left_view.name for left_view, _ in pairs]
    return StereoCalibration(
        T_right_left, rms_px, names, [tuple(e) for e in errors.tolist()], left_out
    )


def _calibrate(pairs, board: Chessboard, left: PinholeCamera, right: PinholeCamera):
    points = [board.points.astype(np.float32)] * len(pairs)
    pixels = [
        [p[side].corners_px.astype(np.float32).reshape(-1, 1, 2) for p in pairs] for side in (0, 1)
    ]
    D = [np.array(c.distortion) for c in (left, right)]
    found = cv2.stereoCalibrateExtended(
        points,
        *pixels,
        left.K,
        D[0],
        right.K,
        D[1],
        (left.width, left.height),
        np.eye(3),
        np.zeros(3),
        flags=cv2.CALIB_FIX_INTRINSIC,
    )
    rms_px, R, t, errors = found[0], found[5], found[6], found[-1]
    return float(rms_px), transforms.transform(R, t.ravel()), np.asarray(errors).reshape(-1, 2)


def _same_order(left: BoardView, right: BoardView) -> BoardView:
    """The right view with its corners in the left one's order: a board turned by 180 degrees looks
    the same.

    Holds for cameras that are rolled by less than 90 degrees against each other.
    """
    directions = [v.corners_px[-1] - v.corners_px[0] for v in (left, right)]
    return (
        right
        if directions[0] @ directions[1] > 0
        else BoardView(right.name, right.corners_px[::-1])
    )
