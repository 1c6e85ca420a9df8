# SPDX-License-Identifier: Apache-2.0
"""A board of tags, and what a camera of the rig saw of it at an angle."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Sequence

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import read_picture
from fcsv_tracking.errors import CalibrationRefused
from fcsv_tracking.tags import TagDetector, TagObservation, corner_points
from fcsv_tracking.tilting.rig import SIDES, TiltingRig

#: Beside the pictures: which is which.
VIEWS = "views.csv"
_COLUMNS = ["picture", "station", "side", "angle_deg"]


@dataclass(frozen=True)
class TagBoard:
    """A flat grid of tags (tag36h11) with rising ids, row by row from the top left; edges and gaps
    in m.

    Its frame: origin in the middle of the first tag, x right, y down, z into the board.
    """

    columns: int = 4
    rows: int = 3
    size_m: float = 0.06
    gap_m: float = 0.02
    first_id: int = 0

    def __post_init__(self):
        if (
            self.columns < 1
            or self.rows < 1
            or self.first_id < 0
            or self.first_id + self.columns * self.rows > 587
        ):
            raise ValueError(
                f"board: {self.columns}x{self.rows} tags from id {self.first_id}: none, or beyond id 586"
            )
        if not self.size_m > 0 or not self.gap_m > 0:
            raise ValueError(
                f"board: tags of {self.size_m} m with gaps of {self.gap_m} m; both must be positive"
            )

    def corners(self, tag_id: int) -> np.ndarray:
        """(4,3) m in the board's frame, in the detector's order.

        >>> TagBoard(2, 1, 0.06, 0.02).corners(1)[:, 0].round(2).tolist()
        [0.05, 0.11, 0.11, 0.05]
        """
        row, column = divmod(tag_id - self.first_id, self.columns)
        step = self.size_m + self.gap_m
        return corner_points(self.size_m) + [column * step, row * step, 0.0]

    def detector(self) -> TagDetector:
        """Makes a detector of its tags alone."""
        ids = range(self.first_id, self.first_id + self.columns * self.rows)
        return TagDetector(dict.fromkeys(ids, self.size_m))


@dataclass(frozen=True)
class SideBoardView:
    """Corners (N,2, undistorted x/z, y/z) of the board's points (N,3, m) in one picture of a side
    at an angle as read.

    Rig and board stand still within a ``station``.
    """

    station: str
    side: str
    angle_rad: float
    corners_normalized: np.ndarray
    points_m: np.ndarray
    focal_px: float
    name: str = ""


def view_of(
    station: str,
    side: str,
    angle_rad: float,
    tags: Sequence[TagObservation],
    board: TagBoard,
    camera: PinholeCamera,
    name: str = "",
) -> Optional[SideBoardView]:
    """None where no tag of the board is seen."""
    if not tags:
        return None
    corners = np.concatenate([t.corners_normalized for t in tags])
    points = np.concatenate([board.corners(t.id) for t in tags])
    return SideBoardView(
        station, side, angle_rad, corners, points, (camera.fx + camera.fy) / 2.0, name
    )


def read_views(folder: Path, rig: TiltingRig, board: TagBoard) -> List[SideBoardView]:
    """Pictures of ``folder`` with the board, as its views.csv lists them. Raises CalibrationRefused
    naming the line."""
    detector, found = board.detector(), []
    path = folder / VIEWS
    if not path.is_file():
        raise CalibrationRefused(
            f"{path}: does not exist; it lists {','.join(_COLUMNS)} of every picture"
        )
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        if list(reader.fieldnames or ()) != _COLUMNS:
            raise CalibrationRefused(f"{path}, line 1: the columns must be {','.join(_COLUMNS)}")
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            side, angle_deg = row["side"], _number(row["angle_deg"], where)
            if side not in SIDES:
                raise CalibrationRefused(f"{where}: side '{side}' is not one of {', '.join(SIDES)}")
            try:
                gray = read_picture(folder / str(row["picture"]), grey=True).pixels
            except PictureFileError as error:
                raise CalibrationRefused(f"{where}: {error}") from error
            camera = getattr(rig, side).camera
            tags = detector.detect(gray, camera)
            view = view_of(
                str(row["station"]),
                side,
                float(np.radians(angle_deg)),
                tags,
                board,
                camera,
                row["picture"],
            )
            found += [view] if view else []
    return found


def _number(text: Optional[str], where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise CalibrationRefused(f"{where}: angle '{text}' is no number of degrees")
    return value
