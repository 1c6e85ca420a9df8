# SPDX-License-Identifier: Apache-2.0
"""The files in ``images/`` of posed photographs: found by the names in images.txt, read whole,
turned where they must.

Which pixels the poses are of, stored ones or those turned by EXIF's orientation:
docs/design/conventions.md.
"""

from pathlib import Path
from typing import Collection, Dict, List, Mapping, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import StoredPicture, is_turned, read_picture
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import Picture
from fcsv_stereo.posed.colmap_images import PosedImage, same_name
from fcsv_stereo.posed.exposure import Exposure

_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")


def find_files(folder: Path, names: Sequence[str]) -> Dict[str, Path]:
    """The file in ``folder`` of each name, which may be written otherwise there (``same_name``,
    capital letters).

    Raises InputError where one is missing, two names are of one file, or a photograph has no name:
    it would silently be missing from the map.
    """
    there = {str(p.relative_to(folder)): p for p in _files(folder)}
    found: Dict[str, Path] = {}
    for name in names:
        path = folder / name
        found[name] = path if path.is_file() else _alike(folder, name, there)
    by_file: Dict[Path, str] = {}
    for name, path in found.items():
        if path in by_file:
            raise InputError(
                f"{path}: images.txt names it twice, '{by_file[path]}' and '{name}'; take one out"
            )
        by_file[path] = name
    for path in there.values():
        if path.suffix.lower() in _SUFFIXES and path not in by_file:
            raise InputError(f"{path}: has no pose in images.txt; add it or take the file away")
    return found


def _files(folder: Path) -> List[Path]:
    """All, in folders, too; not what macOS and network disks leave beside pictures (._x.jpg,
    @eaDir)."""
    paths = sorted(p for p in folder.rglob("*") if p.is_file())
    return [
        p
        for p in paths
        if not any(w[0] in ".@" or w == "__MACOSX" for w in p.relative_to(folder).parts)
    ]


def _alike(folder: Path, name: str, there: Mapping[str, Path]) -> Path:
    for alike in (same_name, lambda n: same_name(n).casefold()):
        paths = [p for n, p in there.items() if alike(n) == alike(name)]
        if len(paths) == 1:
            return paths[0]
    elsewhere = [n for n in there if Path(n).name == Path(name).name]
    hint = f"; {folder / elsewhere[0]} is there: name it '{elsewhere[0]}'" if elsewhere else ""
    raise InputError(f"{folder / name} is missing; images.txt names it{hint}")


def load_pictures(
    files: Mapping[str, Path],
    posed: Sequence[PosedImage],
    cameras: Mapping[int, PinholeCamera],
    reference: str,
    warnings: List[str],
) -> Dict[str, Picture]:
    """Loads pictures by name, undistorted; those of 16 bits share one scale per camera.

    A file that cannot be read whole is left out, and ``warnings`` name it. Raises InputError where
    it is the reference's, or no other one is left.
    """
    stored, broken = _read(files, posed)
    if reference in broken:
        raise InputError(
            f"{broken[reference]}; it is the reference picture: --reference NAME chooses another"
        )
    if len(stored) < 2 and broken:
        raise InputError("; ".join(broken.values()))
    warnings += [f"left out: {words}" for words in broken.values()]
    kept = [p for p in posed if p.name in stored]
    images = _as_posed(files, stored, kept, cameras, warnings)
    exposures = {
        c: Exposure.common(
            images[p.name] for p in kept if p.camera_id == c and images[p.name].dtype == np.uint16
        )
        for c in {p.camera_id for p in kept}
    }
    pictures = {}
    for p in kept:
        camera = cameras[p.camera_id]
        rgb = cv2.cvtColor(exposures[p.camera_id].to_8_bit(images.pop(p.name)), cv2.COLOR_BGR2RGB)
        pictures[p.name] = Picture.undistorted(p.name, "camera", 0.0, rgb, camera, p.T_home_cam)
    return pictures


def _read(
    files: Mapping[str, Path], posed: Sequence[PosedImage]
) -> Tuple[Dict[str, StoredPicture], Dict[str, str]]:
    """What could be read, and what is wrong with the others."""
    stored, broken = {}, {}
    for p in posed:
        try:
            stored[p.name] = read_picture(files[p.name])
        except PictureFileError as error:
            broken[p.name] = str(error)
    return stored, broken


def _as_posed(
    files: Mapping[str, Path],
    stored: Dict[str, StoredPicture],
    posed: Sequence[PosedImage],
    cameras: Mapping[int, PinholeCamera],
    warnings: List[str],
) -> Dict[str, np.ndarray]:
    """The pixels that the poses are of. Raises InputError where a picture has not its camera's
    size."""
    sizes = {p.name: (cameras[p.camera_id].width, cameras[p.camera_id].height) for p in posed}
    told = {n: is_turned(s.size, s.orientation, sizes[n]) for n, s in stored.items()}
    by_size = {told[n] for n, s in stored.items() if s.orientation != 1} - {None}
    turns = by_size == {True}  # a model is of stored pixels, or of turned ones, all of it
    unclear = [n for n, t in told.items() if t is None]
    if unclear and not by_size:
        warnings.append(_unclear(files, stored, unclear))
    images = {}
    for p in posed:
        picture = stored.pop(p.name)
        images[p.name] = (
            picture.turned() if told[p.name] or (told[p.name] is None and turns) else picture.pixels
        )
        found = images[p.name].shape[1], images[p.name].shape[0]
        if found != sizes[p.name]:
            (w, h), (width, height) = found, sizes[p.name]
            raise InputError(
                f"{files[p.name]}: is {w}x{h}, cameras.txt says {width}x{height} for camera {p.camera_id}"
            )
    return images


def _unclear(
    files: Mapping[str, Path], stored: Mapping[str, StoredPicture], names: Collection[str]
) -> str:
    first = next(iter(names))
    return (
        f"EXIF's orientation turns {len(names)} of {len(stored)} pictures ({files[first].name}: "
        f"{stored[first].orientation}), and their size does not tell whether their poses are of turned pixels. They "
        "were taken as stored, as COLMAP takes them. If the poses are of turned ones, save the pictures turned."
    )
