# SPDX-License-Identifier: Apache-2.0
"""COLMAP's model, text or binary, read; and written as the folder that ``map`` reads."""

import struct
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.colmap_cameras import MODELS, camera_of, read_cameras
from fcsv_stereo.posed.colmap_images import PosedImage, read_images

#: COLMAP's numbers of the camera models that ``map`` knows.
_NAMES = {0: "SIMPLE_PINHOLE", 1: "PINHOLE", 2: "SIMPLE_RADIAL", 3: "RADIAL", 4: "OPENCV"}
_LONGEST_NAME = 4096
Model = Tuple[Dict[int, PinholeCamera], List[PosedImage]]


def read_model(folder: Path) -> Model:
    """Cameras, and posed photographs by name, of ``cameras.txt``, ``images.txt`` or the same as
    ``.bin``.

    Raises InputError that names the file.
    """
    if (folder / "images.bin").is_file():
        cameras = _binary_cameras(folder / "cameras.bin")
        posed = _binary_images(folder / "images.bin", cameras)
    else:
        cameras = read_cameras(folder / "cameras.txt")
        posed = read_images(folder / "images.txt", cameras)
    return cameras, sorted(posed, key=lambda p: p.name)


def write_model(folder: Path, cameras: Dict[int, PinholeCamera], posed: List[PosedImage]) -> None:
    """cameras.txt and images.txt; COLMAP's pixel centres are at 0.5."""
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy k1 k2 p1 p2 (pixel centres at 0.5)"]
    for number in sorted({p.camera_id for p in posed}):
        c = cameras[number]
        values = (c.fx, c.fy, c.cx + 0.5, c.cy + 0.5, *tuple(c.distortion)[:4])
        lines.append(
            f"{number} OPENCV {c.width} {c.height} " + " ".join(repr(float(v)) for v in values)
        )
    (folder / "cameras.txt").write_text("\n".join([*lines, ""]))
    lines = [
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME (T_cam_home, m), then a line of 2D points: none"
    ]
    for number, p in enumerate(posed, 1):
        if p.name != p.name.strip() or len(p.name.splitlines()) != 1:
            raise InputError(f"{p.name!r}: images.txt holds no such name; rename the photograph")
        T_cam_home = transforms.invert(p.T_home_cam)
        x, y, z, w = transforms.quaternion_xyzw(T_cam_home)
        pose = " ".join(f"{v:.12g}" for v in (w, x, y, z, *T_cam_home[:3, 3]))
        lines += [f"{number} {pose} {p.camera_id} {p.name}", ""]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")


class _Octets:
    """A file that is read from its beginning to its end. Raises InputError where it ends early."""

    def __init__(self, path: Path):
        if not path.is_file():
            raise InputError(
                f"{path} is missing: COLMAP's binary model has cameras.bin and images.bin"
            )
        self._path, self._octets, self._at = path, path.read_bytes(), 0

    def read(self, form: str) -> tuple:
        size = struct.calcsize("<" + form)
        self.skip(size)
        return struct.unpack_from("<" + form, self._octets, self._at - size)

    def skip(self, size: int) -> None:
        self._at += size
        if self._at > len(self._octets):
            raise InputError(f"{self._path}: ends early; copy it again")

    def word(self) -> str:
        end = self._octets.find(b"\0", self._at, self._at + _LONGEST_NAME)
        if end < 0:
            raise InputError(f"{self._path}: is no binary model of COLMAP")
        word = self._octets[self._at : end].decode("utf-8", "replace")
        self._at = end + 1
        return word


def _binary_cameras(path: Path) -> Dict[int, PinholeCamera]:
    octets, cameras = _Octets(path), {}
    (count,) = octets.read("Q")
    for _ in range(count):
        number, model, width, height = octets.read("iiQQ")
        if model not in _NAMES:
            raise InputError(
                f"{path}: camera {number} has model number {model}; map knows {', '.join(_NAMES.values())}"
            )
        order = MODELS[_NAMES[model]]
        values = dict(zip(order, octets.read(f"{len(order)}d")))
        try:
            cameras[number] = camera_of(width, height, values)
        except GeometryError as error:
            raise InputError(f"{path}: camera {number}: {error}") from error
    if not cameras:
        raise InputError(f"{path}: holds no camera")
    return cameras


def _binary_images(path: Path, cameras: Dict[int, PinholeCamera]) -> List[PosedImage]:
    octets, posed = _Octets(path), []
    (count,) = octets.read("Q")
    for _ in range(count):
        _, w, x, y, z, *t, camera_id = octets.read("i7di")
        name = octets.word()
        (points,) = octets.read("Q")
        octets.skip(24 * points)  # two coordinates and the number of a point each
        if camera_id not in cameras:
            raise InputError(f"{path}: camera {camera_id} of {name} is not in cameras.bin")
        try:
            T_cam_model = transforms.from_xyz_quaternion(np.array(t), [x, y, z, w])
        except GeometryError as error:
            raise InputError(f"{path}: pose of {name}: {error}") from error
        posed.append(PosedImage(name, camera_id, transforms.invert(T_cam_model)))
    if not posed:
        raise InputError(f"{path}: holds no picture")
    return posed
