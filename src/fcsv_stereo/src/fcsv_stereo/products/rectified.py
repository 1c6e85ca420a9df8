# SPDX-License-Identifier: Apache-2.0
"""Every pair as rectified pictures with Q, for whatever matcher comes next."""

import re
from pathlib import Path

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.errors import MatchingError
from fcsv_stereo.model import Axis, MapInput, MapResult
from fcsv_stereo.products.pictures import refined_pictures
from fcsv_stereo.rectify import RectifiedPair, bouguet

_FILES = {Axis.HORIZONTAL: ("left.png", "right.png"), Axis.VERTICAL: ("top.png", "bottom.png")}


def write_pairs(result: MapResult, given: MapInput, folder: Path) -> None:
    """A folder for each pair: left.png and right.png, or top.png and bottom.png, and
    calibration.yaml.

    Rectified anew from the refined poses with Bouguet's method, whatever the map's method did, and
    so ordered that disparities are positive. calibration.yaml is for OpenCV's FileStorage: Q as of
    reprojectImageTo3D (disparity along x, or along y for a vertical pair), K of both, T_home_rect
    from the first's rectified frame to home (m).
    """
    pictures = refined_pictures(result, given)
    folder.mkdir()
    for number, p in enumerate(result.pairs, 1):
        first, second = pictures[p.reference_name], pictures[p.other_name]
        try:
            pair = bouguet(first, second, p.configuration.axis)
        except MatchingError as error:  # one camera ahead of the other
            result.warnings.append(f"pairs: {p.configuration.name} is left out ({error})")
            continue
        if pair.baseline_m < 0.0:
            first, second = second, first
            pair = bouguet(first, second, p.configuration.axis)
        name = re.sub(r"[^\w.+-]+", "_", p.configuration.name) or "pair"
        path = folder / f"{number:02d}_{name}"
        path.mkdir()
        for file, image in zip(_FILES[pair.axis], (pair.reference, pair.other)):
            if not cv2.imwrite(str(path / file), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)):
                raise OSError(f"{file} was refused")
        p_home_m = first.T_home_cam[:3, 3] + result.origin_m
        _write_calibration(pair, (first.name, second.name), p_home_m, path / "calibration.yaml")


def reprojection_matrix(pair: RectifiedPair) -> np.ndarray:
    """Q (4x4): [X Y Z W] = Q [u v d 1] in the first picture's rectified frame, with d = u - u' (or
    v - v')."""
    f, cx, cy = pair.K_reference[0, 0], pair.K_reference[0, 2], pair.K_reference[1, 2]
    i = pair.axis_index
    offset = pair.K_reference[i, 2] - pair.K_other[i, 2]
    b = pair.baseline_m
    return np.array(
        [[1, 0, 0, -cx], [0, 1, 0, -cy], [0, 0, 0, f], [0, 0, 1 / b, -offset / b]], float
    )


def _write_calibration(pair: RectifiedPair, names, p_home_m: np.ndarray, path: Path) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    if not storage.isOpened():
        raise OSError(f"{path.name} cannot be opened")
    height, width = pair.reference.shape[:2]
    storage.write("axis", pair.axis.value)
    storage.write("first_picture", names[0])
    storage.write("second_picture", names[1])
    for key, value in (
        ("image_width", width),
        ("image_height", height),
        ("baseline_m", pair.baseline_m),
    ):
        storage.write(key, value)
    matrices = {
        "Q": reprojection_matrix(pair),
        "K_first": pair.K_reference,
        "K_second": pair.K_other,
    }
    matrices["T_home_rect"] = transforms.transform(pair.R_home_rect, p_home_m)
    for key, value in matrices.items():
        storage.write(key, np.ascontiguousarray(value, float))
    storage.release()
