# SPDX-License-Identifier: Apache-2.0
"""The YAML file of a camera's calibration, of camera_calibration_parsers: every ROS camera driver
reads it."""

from pathlib import Path
from typing import List, Optional, Tuple

import numpy as np

from fcsv_geometry import config
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.intrinsics import camera_of_matrix, model_of

_SHAPES = {
    "camera_matrix": (3, 3),
    "distortion_coefficients": (1, 5),
    "rectification_matrix": (3, 3),
    "projection_matrix": (3, 4),
}
#: of the file; every one must be there
KEYS = ("image_width", "image_height", "camera_name", "distortion_model", *_SHAPES)


def write_camera(
    path: Path,
    name: str,
    camera: PinholeCamera,
    R: Optional[np.ndarray] = None,
    P: Optional[np.ndarray] = None,
) -> None:
    """One camera; R (3,3) and P (3,4) of a rectified pair, by default those of a single camera."""
    distortion = camera.distortion if len(camera.distortion) > 5 else (*camera.distortion, 0.0)[:5]
    matrices = {
        "camera_matrix": camera.K,
        "distortion_coefficients": np.array([distortion]),
        "rectification_matrix": np.eye(3) if R is None else R,
        "projection_matrix": np.hstack([camera.K, np.zeros((3, 1))]) if P is None else P,
    }
    lines = [
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f"camera_name: {name}",
    ]
    for key, matrix in matrices.items():
        if key == "distortion_coefficients":
            lines.append(f"distortion_model: {model_of(distortion)}")
        values = ", ".join(repr(float(v)) for v in matrix.ravel())
        lines += [
            f"{key}:",
            f"  rows: {matrix.shape[0]}",
            f"  cols: {matrix.shape[1]}",
            f"  data: [{values}]",
        ]
    Path(path).write_text("\n".join(lines) + "\n")


def read_camera(path: Path) -> Tuple[str, PinholeCamera]:
    """Name and camera. Raises ConfigError naming file and field."""
    document = config.read_yaml(path)
    if not isinstance(document, dict):
        raise config.ConfigError(f"{path}: is not a camera file of camera_calibration_parsers")
    for key in KEYS:
        if key not in document:
            other = config.nearest(key, [str(k) for k in document if k not in KEYS])
            hint = f"; is '{other}' meant?" if other else ""
            raise config.ConfigError(f"{path}: '{key}' is missing{hint}", key, f"is missing{hint}")
    K = _matrix(path, document, "camera_matrix")
    D = _coefficients(path, document)
    try:
        size = (int(document["image_width"]), int(document["image_height"]))
        camera = camera_of_matrix(*size, K.ravel(), D, str(document["distortion_model"]))
    except (TypeError, ValueError) as error:
        raise config.ConfigError(
            f"{path}: image_width and image_height are no numbers ({error})"
        ) from error
    except GeometryError as error:
        raise config.ConfigError(f"{path}: {error}") from error
    return str(document["camera_name"]), camera


def _coefficients(path: Path, document: dict) -> List[float]:
    try:
        return [float(d) for d in document["distortion_coefficients"]["data"]]
    except (KeyError, TypeError, ValueError) as error:
        key, words = "distortion_coefficients", f"is no row of numbers ({error})"
        raise config.ConfigError(f"{path}: '{key}' {words}", key, words) from error


def _matrix(path: Path, document: dict, key: str) -> np.ndarray:
    try:
        return np.array(document[key]["data"], float).reshape(_SHAPES[key])
    except (KeyError, TypeError, ValueError) as error:
        words = f"is not a {_SHAPES[key]} matrix ({error})"
        raise config.ConfigError(f"{path}: '{key}' {words}", key, words) from error
