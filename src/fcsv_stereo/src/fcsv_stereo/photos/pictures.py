# SPDX-License-Identifier: Apache-2.0
"""The picture files themselves: copied upright and at a size that ``map`` can work with."""

import math
import shutil
from pathlib import Path
from typing import Tuple

import numpy as np
from PIL import Image, ImageOps

from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import read_picture
from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.tags import ORIENTATION, Tags

#: Make, model, XMP, EXIF, GPS: TIFF's other tags tell how the old file stores its pixels.
_KEPT_OF_TIFF = {0x010F, 0x0110, 0x02BC, 0x8769, 0x8825}
_QUALITY = 95  # of JPEG: what is lost is below the noise of matching
#: R_stored_upright by EXIF orientation: how the axes of the upright picture lie in the stored one
#: (not of mirrored).
_UPRIGHT = {
    1: np.eye(3),
    3: np.diag([-1.0, -1.0, 1.0]),
    6: np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    8: np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}


def R_stored_upright(tags: Tags) -> np.ndarray:
    """Raises InputError where the picture is stored mirrored."""
    if tags.orientation not in _UPRIGHT:
        raise InputError(
            f"{tags.path}: is stored mirrored (EXIF orientation {tags.orientation}); no camera does that"
        )
    return _UPRIGHT[tags.orientation]


def upright_size(tags: Tags, longest_px: int) -> Tuple[int, int]:
    """(width, height) of the copy; ``longest_px`` 0: as it is."""
    width, height = tags.size if tags.orientation < 5 else tags.size[::-1]
    share = min(1.0, longest_px / max(width, height)) if longest_px else 1.0
    return max(1, round(width * share)), max(1, round(height * share))


def copy_upright(tags: Tags, folder: Path, longest_px: int) -> None:
    """The file itself where nothing changes; else its pixels turned and made smaller, with its
    other EXIF tags.

    Raises InputError where the picture cannot be read to its end.
    """
    R_stored_upright(tags)  # a mirrored one is refused
    try:
        read_picture(tags.path)  # Pillow passes over damage that this one does not
    except PictureFileError as error:
        raise InputError(str(error)) from error
    size = upright_size(tags, longest_px)
    target = folder / tags.path.name
    if tags.orientation == 1 and size == tags.size:
        shutil.copyfile(tags.path, target)
        return
    try:
        with Image.open(tags.path) as image:
            exif = image.getexif()
            upright = ImageOps.exif_transpose(image)
            if size != upright.size:
                upright = upright.resize(size, Image.LANCZOS)
            for tag in set(exif) - _KEPT_OF_TIFF if _is_tiff(target) else ():
                del exif[tag]
            exif[ORIENTATION] = 1
            upright.save(
                target, exif=exif.tobytes(), **({"quality": _QUALITY} if _is_jpeg(target) else {})
            )
    except (OSError, SyntaxError, ValueError) as error:
        if isinstance(error, OSError) and error.errno:  # the disk, not the picture
            raise
        raise InputError(
            f"{tags.path}: cannot be read to its end; copy it again ({error})"
        ) from error


def focal_px(tags: Tags, longest_px: int):
    """Gives the focal length of the copy; None where the file says none."""
    if tags.focal_px is None:
        return None
    share = math.hypot(*upright_size(tags, longest_px)) / math.hypot(*tags.size)
    return round(tags.focal_px * share, 3)


def _is_tiff(path: Path) -> bool:
    return path.suffix.lower() in (".tif", ".tiff")


def _is_jpeg(path: Path) -> bool:
    return path.suffix.lower() in (".jpg", ".jpeg")
