# SPDX-License-Identifier: Apache-2.0
"""Board views out of pictures, with a reason for every picture that gives none."""

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Dict, Iterable, List, Tuple, Union

import numpy as np

from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import read_picture
from fcsv_tracking.cameras.board import BoardView, Chessboard, find_board
from fcsv_tracking.errors import CameraCalibrationRefused

_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".pgm", ".ppm"}
#: A view that moved less than this against the one before (mean of all corners) says nothing new.
_LEAST_MOVE_PX = 12.0
_MOST_VIEWS = 80
_START = re.compile("[A-Za-z]*")
_SIDES = (("left", "right"), ("l", "r"))

# grey HxW uint8, or why there is none
NamedPicture = Tuple[str, Union[np.ndarray, PictureFileError, None]]


@dataclass
class BoardViews:
    """What the pictures of one camera gave; ``size`` is width, height."""

    size: Tuple[int, int] = (0, 0)
    views: List[BoardView] = field(default_factory=list)
    left_out: Dict[str, str] = field(default_factory=dict)


def folder_pictures(folder: Path, prefix: str = "") -> List[Tuple[str, Path]]:
    """Name (without ``prefix``, so that left07 and right07 are one) and path of the pictures of a
    folder, sorted."""
    if not folder.is_dir():
        raise CameraCalibrationRefused(f"{folder}: no such folder")
    # macOS leaves ._x.jpg beside x.jpg
    seen = (p for p in folder.iterdir() if not p.name.startswith("."))
    paths = sorted(p for p in seen if p.suffix.lower() in _SUFFIXES and p.name.startswith(prefix))
    if not paths:
        start = f" that begin with '{prefix}'" if prefix else ""
        raise CameraCalibrationRefused(
            f"{folder}: no pictures{start} ({', '.join(sorted(_SUFFIXES))})"
        )
    return [(p.stem[len(prefix) :] or p.stem, p) for p in paths]


def require_one_camera(folder: Path, stems: Iterable[str]) -> None:
    """Raises CameraCalibrationRefused where file names say that two cameras took them.

    >>> require_one_camera(Path("board"), ["left01", "left02"])
    """
    starts = {_START.match(stem).group().lower() for stem in stems}
    for left, right in _SIDES:
        if {left, right} <= starts:
            raise CameraCalibrationRefused(
                f"{folder}: holds pictures of two cameras, {left}... and {right}...: give both with "
                f"--prefix {left} --right-prefix {right}, or one of them with --prefix"
            )


def read_gray(path: Path) -> Union[np.ndarray, PictureFileError]:
    """The pixels as stored, as a camera's driver gives them: EXIF's orientation does not turn
    them."""
    try:
        return read_picture(path, grey=True).pixels
    except PictureFileError as error:
        return error


def collect_views(
    pictures: Iterable[NamedPicture],
    board: Chessboard,
    thin: bool = False,
    progress: Callable[[str], None] = str,
) -> BoardViews:
    """Views of one camera; ``thin`` passes over pictures of a video in which the board has hardly
    moved.

    Pictures of another size than most, unreadable ones and such without the whole board are named
    with the reason.
    """
    found, sizes = BoardViews(), {}
    for name, gray in pictures:
        progress(name)
        if not isinstance(gray, np.ndarray):
            found.left_out[name] = str(gray or "cannot be read as a picture")
            continue
        sizes[name] = gray.shape[::-1]
        corners = find_board(gray, board)
        if corners is None:
            found.left_out[name] = "no whole board found"
        elif not (
            thin and found.views and _moved_px(found.views[-1].corners_px, corners) < _LEAST_MOVE_PX
        ):
            found.views.append(BoardView(name, corners))
    if not found.views:
        unreadable = [why for name, why in found.left_out.items() if name not in sizes]
        raise CameraCalibrationRefused(
            f"none of {len(found.left_out)} pictures shows a board of {board.columns}x{board.rows} inner corners: "
            f"check --board, and that no edge is cut off"
            + "".join(f"; {why}" for why in unreadable[:3])
        )
    _require_one_size(found, sizes)
    if thin and len(found.views) > _MOST_VIEWS:
        found.views = [
            found.views[i] for i in np.linspace(0, len(found.views) - 1, _MOST_VIEWS).astype(int)
        ]
    return found


def _require_one_size(found: BoardViews, sizes: Dict[str, Tuple[int, int]]) -> None:
    found.size = Counter(sizes[v.name] for v in found.views).most_common(1)[0][0]
    for view in [v for v in found.views if sizes[v.name] != found.size]:
        width, height = sizes[view.name]
        found.left_out[view.name] = (
            f"is {width}x{height}, the others {found.size[0]}x{found.size[1]}"
        )
        found.views.remove(view)


def _moved_px(before: np.ndarray, after: np.ndarray) -> float:
    return float(np.linalg.norm(after - before, axis=1).mean())
