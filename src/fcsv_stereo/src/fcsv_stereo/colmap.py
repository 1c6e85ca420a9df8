# SPDX-License-Identifier: Apache-2.0
"""Posed photographs: a folder ``images/`` with COLMAP's text model; poses are priors, ``home`` is the model's world.

``priors.csv`` may say how good they are (``priors``).
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, List, Optional

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_stereo.errors import InputError
from fcsv_stereo.exposure import Exposure
from fcsv_stereo.model import Configuration, ConfigurationInput, InputKind, MapInput, Picture, PosePrior
from fcsv_stereo.priors import FILE as PRIORS
from fcsv_stereo.priors import read_priors
from fcsv_stereo.text import text_of

#: Parameters of each camera model in order, as names of fx, fy, cx, cy, k1, k2, p1, p2.
MODELS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
}

_STORED = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_ENDS = ((b"\xff\xd8", b"\xff\xd9"), (b"\x89PNG", b"IEND"))  # how JPEG and PNG files begin and end
_ROUNDING = 1e-9  # of the largest number in two poses: what may be left of one place
_TAIL = 1 << 18  # (octets) cameras write previews and notes behind the picture's end


@dataclass(frozen=True)
class PosedImage:
    """A line of images.txt; T_home_cam with home the model's world."""

    name: str
    camera_id: int
    T_home_cam: np.ndarray


def is_model(folder: Path) -> bool:
    """Whether a folder looks like posed photographs."""
    return any((folder / f).exists() for f in ("images.txt", "cameras.txt", "images"))


def read_photographs(folder: Path, reference: Optional[str] = None) -> MapInput:
    """Every other picture paired with the reference (default: the first in images.txt). Raises InputError."""
    cameras = read_cameras(folder / "cameras.txt")
    posed = read_images(folder / "images.txt", cameras)
    by_name = {p.name: p for p in posed}
    if reference is not None and reference not in by_name:
        raise InputError(f"{folder / 'images.txt'}: no picture '{reference}'; the first is {posed[0].name}")
    if len(posed) < 2:
        raise InputError(f"{folder / 'images.txt'}: holds {len(posed)} picture; a pair needs two")
    _require_poses(folder, by_name)
    first = by_name[reference] if reference else posed[0]
    pictures, prior = _load(folder, posed, cameras), None
    if (folder / PRIORS).is_file():
        known, scale_sigma = read_priors(folder / PRIORS, by_name)
        prior = PosePrior(scale_sigma=scale_sigma)
        # errors of one vehicle's poses would count as one drift
        pictures = {n: replace(p, covariance=known[n], vehicle=n) for n, p in pictures.items()}
    view = pictures[first.name]
    configurations = [
        ConfigurationInput(_configuration(view, pictures[p.name]), [view], [pictures[p.name]])
        for p in posed
        if p.name != first.name
    ]
    return MapInput(InputKind.PHOTOGRAPHS, configurations, prior=prior)


def read_cameras(path: Path) -> Dict[int, PinholeCamera]:
    """cameras.txt; pixel centres come at 0.5 and leave at whole numbers. Raises InputError."""
    cameras = {}
    for number, words in _lines(path):
        try:
            model, width, height = words[1], int(words[2]), int(words[3])
            if model not in MODELS:
                raise InputError(f"{path}, line {number}: camera model {model} is not one of {', '.join(MODELS)}")
            if len(words) - 4 != len(MODELS[model]):
                raise InputError(f"{path}, line {number}: {model} has {len(MODELS[model])} parameters")
            values = dict(zip(MODELS[model], map(float, words[4:])))
            cameras[int(words[0])] = camera_of(width, height, values)
        except (ValueError, IndexError, TypeError) as error:
            raise InputError(f"{path}, line {number}: not a camera ({error})") from error
        except GeometryError as error:
            raise InputError(f"{path}, line {number}: {error}") from error
    if not cameras:
        raise InputError(f"{path}: holds no camera")
    return cameras


def camera_of(width: int, height: int, values: Dict[str, float]) -> PinholeCamera:
    """From a camera model's parameters by name, whose pixel centres are at 0.5. Raises GeometryError."""
    fx, fy = values.get("fx", values.get("f")), values.get("fy", values.get("f"))
    distortion = tuple(values.get(k, 0.0) for k in ("k1", "k2", "p1", "p2")) + (0.0,)
    return PinholeCamera(width, height, fx, fy, values["cx"] - 0.5, values["cy"] - 0.5, distortion)


def read_images(path: Path, cameras: Dict[int, PinholeCamera]) -> List[PosedImage]:
    """images.txt: qw qx qy qz tx ty tz of T_cam_world, every second line (points) is skipped. Raises InputError."""
    images: List[PosedImage] = []
    for number, line in _image_lines(path):
        words = line.split()
        try:
            values = [float(w) for w in words[1:8]]
            camera_id, name = int(words[8]), " ".join(words[9:])
        except (ValueError, IndexError) as error:
            raise InputError(f"{path}, line {number}: not a posed picture ({error})") from error
        if camera_id not in cameras:
            raise InputError(f"{path}, line {number}: camera {camera_id} of {name} is not in cameras.txt")
        qw, qx, qy, qz, *t = values
        try:
            T_cam_home = transforms.from_xyz_quaternion(t, [qx, qy, qz, qw])
        except GeometryError as error:
            raise InputError(f"{path}, line {number}: pose of {name}: {error}") from error
        images.append(PosedImage(name, camera_id, transforms.invert(T_cam_home)))
    if not images:
        raise InputError(f"{path}: holds no picture")
    return images


def _lines(path: Path):
    if not path.is_file():
        raise InputError(f"{path} is missing: posed photographs need images/, cameras.txt and images.txt (COLMAP text)")
    for number, line in enumerate(text_of(path).splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            yield number, line.split()


def _image_lines(path: Path):
    """The first of every two lines after the comments; the second may be empty."""
    if not path.is_file():
        raise InputError(f"{path} is missing: photographs without poses cannot be mapped; export them as COLMAP text")
    lines = [(i, s) for i, s in enumerate(text_of(path).splitlines(), 1) if not s.startswith("#")]
    while lines and not lines[0][1].strip():
        lines.pop(0)
    for number, line in lines[::2]:
        if line.strip():
            yield number, line


def _require_poses(folder: Path, by_name: Dict[str, PosedImage]) -> None:
    """A photograph that nobody posed would silently be missing from the map."""
    for path in sorted((folder / "images").glob("*")):
        if path.suffix.lower() in (".jpg", ".jpeg", ".png", ".tif", ".tiff") and path.name not in by_name:
            raise InputError(f"{path}: has no pose in images.txt; add it or take the file away")


def _load(folder: Path, posed: List[PosedImage], cameras: Dict[int, PinholeCamera]) -> Dict[str, Picture]:
    """By name, undistorted; those of 16 bits share one scale per camera."""
    images = {p.name: _read(folder / "images" / p.name, cameras[p.camera_id], p.camera_id) for p in posed}
    exposures = {
        c: Exposure.common(images[p.name] for p in posed if p.camera_id == c and images[p.name].dtype == np.uint16)
        for c in {p.camera_id for p in posed}
    }
    pictures = {}
    for p in posed:
        camera = cameras[p.camera_id]
        rgb = cv2.cvtColor(exposures[p.camera_id].to_8_bit(images.pop(p.name)), cv2.COLOR_BGR2RGB)
        pictures[p.name] = Picture.undistorted(p.name, "camera", 0.0, rgb, camera, p.T_home_cam)
    return pictures


def _read(path: Path, camera: PinholeCamera, camera_id: int) -> np.ndarray:
    """HxWx3 BGR, uint8 or uint16: the pixels as they are stored, as COLMAP reads them. Raises InputError.

    A file whose EXIF orientation turns it is turned only where cameras.txt has the size of the turned picture.
    """
    if not path.is_file():
        raise InputError(f"{path} is missing; images.txt names it")
    if _ends_early(path):
        raise InputError(f"{path}: ends in the middle of the picture; copy it again")
    image = cv2.imread(str(path), _STORED)
    if image is None:
        raise InputError(f"{path}: cannot be read as a picture")
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: holds {image.dtype} values; save it with 8 or 16 bits per channel")
    wanted = (camera.height, camera.width)
    if image.shape[:2] == wanted[::-1] != wanted:
        image = cv2.imread(str(path), _STORED & ~cv2.IMREAD_IGNORE_ORIENTATION)
    if image.shape[:2] != wanted:
        size = f"{image.shape[1]}x{image.shape[0]}"
        raise InputError(f"{path}: is {size}, cameras.txt says {camera.width}x{camera.height} for camera {camera_id}")
    return image


def _ends_early(path: Path) -> bool:
    """Whether a JPEG or PNG file lacks its end; OpenCV makes grey of what is missing, and says nothing."""
    with open(path, "rb") as file:
        head = file.read(8)
        size = file.seek(0, 2)
        file.seek(max(0, size - _TAIL))
        tail = file.read()
    return any(head.startswith(begin) and end not in tail for begin, end in _ENDS)


def _configuration(reference: Picture, other: Picture) -> Configuration:
    """Raises InputError where the two cannot be a pair."""
    if (reference.camera.width, reference.camera.height) != (other.camera.width, other.camera.height):
        raise InputError(f"{other.name} and {reference.name} have two sizes; one reference needs pictures of one size")
    configuration = Configuration.between(reference.T_home_cam, other.T_home_cam)
    places = np.stack([p.T_home_cam[:3, 3] for p in (reference, other)])
    if configuration.baseline_m <= _ROUNDING * float(np.abs(places).max()):
        raise InputError(f"{other.name} and {reference.name} were taken from one place: no baseline")
    return replace(configuration, name=f"{reference.name} with {other.name}")
