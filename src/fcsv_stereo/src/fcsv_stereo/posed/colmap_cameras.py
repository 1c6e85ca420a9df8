# SPDX-License-Identifier: Apache-2.0
"""COLMAP's cameras.txt."""

from pathlib import Path
from typing import Dict

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.intrinsics import require_plausible
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.colmap_images import data_lines

#: Parameters of each camera model in order, as names of fx, fy, cx, cy, k1, k2, p1, p2.
MODELS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
}


def read_cameras(path: Path) -> Dict[int, PinholeCamera]:
    """cameras.txt; pixel centres come at 0.5 and leave at whole numbers. Raises InputError."""
    cameras = {}
    for number, words in _lines(path):
        try:
            model, width, height = words[1], int(words[2]), int(words[3])
            if model not in MODELS:
                raise InputError(
                    f"{path}, line {number}: camera model {model} is not one of {', '.join(MODELS)}"
                )
            if len(words) - 4 != len(MODELS[model]):
                raise InputError(
                    f"{path}, line {number}: {model} has {len(MODELS[model])} parameters"
                )
            values = dict(zip(MODELS[model], map(float, words[4:])))
            if int(words[0]) in cameras:
                raise InputError(
                    f"{path}, line {number}: camera {words[0]} stands there already; take one out"
                )
            cameras[int(words[0])] = camera_of(width, height, values)
        except (ValueError, IndexError, TypeError) as error:
            raise InputError(f"{path}, line {number}: not a camera ({error})") from error
        except GeometryError as error:
            raise InputError(f"{path}, line {number}: {error}") from error
    if not cameras:
        raise InputError(f"{path}: holds no camera")
    return cameras


def camera_of(width: int, height: int, values: Dict[str, float]) -> PinholeCamera:
    """Makes a camera from a camera model's parameters by name, whose pixel centres are at 0.5.
    Raises GeometryError."""
    fx, fy = values.get("fx", values.get("f")), values.get("fy", values.get("f"))
    distortion = tuple(values.get(k, 0.0) for k in ("k1", "k2", "p1", "p2")) + (0.0,)
    return require_plausible(
        PinholeCamera(width, height, fx, fy, values["cx"] - 0.5, values["cy"] - 0.5, distortion)
    )


def _lines(path: Path):
    if not path.is_file():
        deeper = sorted(path.parent.glob(f"sparse/**/{path.name}"))
        hint = f"; copy what stands in {deeper[0].parent} beside images/" if deeper else ""
        needed = "posed photographs need images/, cameras.txt and images.txt (COLMAP text)"
        raise InputError(f"{path} is missing: {needed}{hint}")
    for number, line in data_lines(path):
        if line.strip():
            yield number, line.split()
