# SPDX-License-Identifier: Apache-2.0
"""Reads what a map's folder says of its reference picture, for programs that go on from maps."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Tuple

import numpy as np

from fcsv_stereo.errors import InputError

REPORT = "report.json"
_ARRAYS = ("depth", "sigma", "kind")
# focal lengths as shares of the picture's larger side, and how many pictures the principal point
# lies off the middle at most: beyond what any camera has, that of a cut picture included
_FOCAL, _OFF_MIDDLE = (0.02, 1e3), 100.0


@dataclass(frozen=True)
class ReadMap:
    """``depth`` and ``sigma`` (H,W) m, NaN where none; ``kind`` (H,W) uint8 of ``model.kinds``;
    ``K`` 3x3 px; ``T_home_cam`` 4x4; ``stamp_s`` NaN where the map does not say it (before version
    0.3); ``reference`` as report.json has it, and ``gps``, where it has it."""

    depth: np.ndarray
    sigma: np.ndarray
    kind: np.ndarray
    K: np.ndarray
    T_home_cam: np.ndarray
    stamp_s: float
    reference: dict
    gps: Optional[dict] = None


def read_map_folder(folder) -> ReadMap:
    """Reads the folder that ``map`` wrote. Raises InputError naming folder, file and field."""
    folder = Path(folder)
    try:
        document = json.loads((folder / REPORT).read_text())
        reference = document["reference"]
        if not isinstance(reference, dict):
            raise ValueError(f"{REPORT}: reference is no mapping")
        arrays = [_load(folder / f"{name}.npy") for name in _ARRAYS]
        for name, values in zip(_ARRAYS, arrays):
            _require_picture(f"{name}.npy", values, arrays[0].shape)
        return ReadMap(
            *arrays,
            K=_camera_matrix(reference, arrays[0].shape),
            T_home_cam=np.array(reference["T_home_cam"], float),
            stamp_s=_number({"stamp_s": np.nan, **reference}, "stamp_s"),
            reference=reference,
            gps=document.get("gps"),
        )
    except FileNotFoundError as error:
        raise InputError(
            f"{folder}: has no {Path(error.filename).name}; give a folder that 'map' wrote with -o"
        ) from error
    except RecursionError as error:
        raise InputError(
            f"{folder}: is not a map of this program ({REPORT} is nested too deep)"
        ) from error
    except (KeyError, TypeError, ValueError, OverflowError, OSError, EOFError) as error:
        raise InputError(f"{folder}: is not a map of this program ({error})") from error


def _load(path: Path) -> np.ndarray:
    try:
        return np.load(path)
    except (ValueError, EOFError) as error:
        raise ValueError(f"{path.name}: {error}") from error


def _number(reference: dict, name: str) -> float:
    """Raises KeyError, and ValueError that names the field."""
    try:
        return float(reference[name])
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{REPORT}: reference.{name}: {error}") from error


def _require_picture(name: str, values: np.ndarray, shape: Tuple[int, ...]) -> None:
    """Raises ValueError unless the array holds a number for each pixel of depth.npy."""
    if values.dtype.kind not in "buif":
        raise ValueError(f"{name}: holds {values.dtype}, not numbers")
    if values.ndim != 2 or not values.size:
        raise ValueError(f"{name}: has shape {values.shape}, which is no picture")
    if values.shape != shape:
        raise ValueError(f"{name}: has shape {values.shape}, {_ARRAYS[0]}.npy {shape}")


def _camera_matrix(reference: dict, shape: Tuple[int, ...]) -> np.ndarray:
    """3x3 of the camera of a picture of this shape. Raises KeyError, TypeError, and ValueError that
    names the field."""
    height, width = shape
    at = f"{REPORT}: reference"
    for name, size in (("width", width), ("height", height)):
        if reference.get(name, size) != size:  # before version 0.3 it is not told
            raise ValueError(f"{at}.{name}: is {reference[name]}, {_ARRAYS[0]}.npy has {size}")
    fx, fy, cx, cy = (_number(reference, name) for name in ("fx", "fy", "cx", "cy"))
    side = max(width, height)
    for name, f in (("fx", fx), ("fy", fy)):
        if not _FOCAL[0] * side <= f <= _FOCAL[1] * side:
            raise ValueError(
                f"{at}.{name}: {f:g} px is no focal length of a picture of {width} x {height}"
            )
    for name, c, size in (("cx", cx, width), ("cy", cy, height)):
        if not abs(c - 0.5 * size) <= _OFF_MIDDLE * size:
            raise ValueError(
                f"{at}.{name}: {c:g} px is no principal point of a picture of {width} x {height}"
            )
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
