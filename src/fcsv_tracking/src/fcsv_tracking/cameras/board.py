# SPDX-License-Identifier: Apache-2.0
"""The chessboard: where its inner corners are, on the board and in a picture."""

from dataclasses import dataclass
from typing import Optional

import cv2
import numpy as np

_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_SUBPIXEL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)


@dataclass(frozen=True)
class Chessboard:
    """Inner corners across and down (a board of 10 x 7 squares has 9 x 6), and the edge of a
    square."""

    columns: int = 9
    rows: int = 6
    square_m: float = 0.025

    def __post_init__(self):
        if min(self.columns, self.rows) < 3:
            raise ValueError(
                f"board: {self.columns}x{self.rows} inner corners; a chessboard needs 3x3 or more"
            )
        if not self.square_m > 0:
            raise ValueError(f"square_m: {self.square_m} must be positive")

    @property
    def points(self) -> np.ndarray:
        """Corners (N,3) in the board's frame (m), row by row, z = 0.

        >>> Chessboard(9, 6, 0.5).points[10].tolist()
        [0.5, 0.5, 0.0]
        """
        rows, columns = np.mgrid[: self.rows, : self.columns]
        return np.stack([columns, rows, np.zeros_like(rows)], -1).reshape(-1, 3) * float(
            self.square_m
        )


@dataclass(frozen=True)
class BoardView:
    """Corners (N,2) of the board in one picture, px, in the order of Chessboard.points."""

    name: str
    corners_px: np.ndarray


def find_board(gray: np.ndarray, board: Chessboard) -> Optional[np.ndarray]:
    """Corners (N,2) px, refined to subpixels, or None where the whole board is not seen; gray is
    HxW uint8."""
    size = (board.columns, board.rows)
    found, corners = cv2.findChessboardCorners(gray, size, flags=_FLAGS)
    if not found:
        return None
    half = _half_window(corners.reshape(board.rows, board.columns, 2))
    return (
        cv2.cornerSubPix(gray, corners, (half, half), (-1, -1), _SUBPIXEL)
        .reshape(-1, 2)
        .astype(float)
    )


def _half_window(grid: np.ndarray) -> int:
    """Half the search window (px): never so large that it reaches the neighbouring corner."""
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
    return int(np.clip(0.45 * min(steps), 2, 11))
