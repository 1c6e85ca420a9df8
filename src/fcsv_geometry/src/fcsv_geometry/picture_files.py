# SPDX-License-Identifier: Apache-2.0
"""Picture files as people have them, read in one way by all packages: the pixels as stored, or a
refusal.

docs/design/conventions.md says when stored pixels are turned by EXIF's orientation. A file that is
cut, or whose content contradicts itself, is refused: decoders fill what is missing with grey, and
say so on stderr only.
"""

import contextlib
import io
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator, Optional, Set, Tuple

import cv2
import numpy as np

from fcsv_geometry.errors import PictureFileError

_ORIENTATION = 0x0112
_JPEG, _TIFFS = b"\xff\xd8\xff", (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# where EXIF or XMP may stand
_PNG, _PNG_TEXTS = b"\x89PNG\r\n\x1a\n", {b"eXIf", b"tEXt", b"zTXt", b"iTXt"}
_DEFLATE = (8, 32946)  # TIFF's numbers of this compression
_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_FTYP_KINDS = {
    b"heic": "HEIC (iPhone)",
    b"heix": "HEIC (iPhone)",
    b"hevc": "HEIC (iPhone)",
    b"mif1": "HEIF",
    b"msf1": "HEIF",
    b"avif": "AVIF",
    b"crx ": "a raw picture (CR3)",
    b"qt  ": "a film",
}
_NO_PICTURES = {
    b"%PDF": "a PDF",
    b"PK\x03\x04": "an archive (zip)",
    b"\x1f\x8b": "an archive (gzip)",
    b"Rar!": "an archive (rar)",
    b"FUJIFILM": "a raw picture (RAF)",
    b"IIRO": "a raw picture (ORF)",
    b"IIU\0": "a raw picture (RW2)",
    b"\0\0\0\x0cJXL ": "JPEG XL",
    b"\xff\x0a": "JPEG XL",
    b"version https://git-lfs": "a pointer of Git LFS",
    b"<": "text (HTML or XML)",
}
_ADVICE = {
    "a pointer of Git LFS": "fetch it: git lfs pull",
    "text (HTML or XML)": "download the picture itself",
}
_ZEROS = 512  # (octets) a copy that broke off may leave so many, or more, at the end of a file


@dataclass(frozen=True)
class StoredPicture:
    """Pixels as stored (HxWx3 BGR, or HxW grey; uint8 or uint16), and EXIF's orientation (1 to
    8)."""

    pixels: np.ndarray
    orientation: int = 1

    @property
    def size(self) -> Tuple[int, int]:
        """Width and height."""
        return self.pixels.shape[1], self.pixels.shape[0]

    def turned(self) -> np.ndarray:
        """The pixels as EXIF's orientation says that they are to be shown."""
        return _turned(self.pixels, self.orientation)


def read_picture(path: Path, grey: bool = False) -> StoredPicture:
    """Raises PictureFileError that names the file: not there, no picture, not whole."""
    if not Path(path).is_file():
        raise PictureFileError(f"{path} is missing")
    return decode_picture(Path(path).read_bytes(), str(path), grey)


def decode_picture(data: bytes, name: str, grey: bool = False) -> StoredPicture:
    """Decodes a picture from a file's content; ``name`` is for errors. Raises PictureFileError."""
    _require_picture(data, name)
    is_jpeg = data.startswith(_JPEG)
    pixels = _decode_jpeg(data, name, grey) if is_jpeg else None
    if pixels is None:
        pixels = _decode(data, name, grey)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise PictureFileError(
            f"{name}: holds {pixels.dtype} values; save it with 8 or 16 bits per channel"
        )
    orientation = _orientation(data)
    if data.startswith(_TIFFS):  # which OpenCV turns whatever it is told
        pixels = _turned(pixels, {6: 8, 8: 6}.get(orientation, orientation))
    return StoredPicture(pixels, orientation)


def is_turned(stored: Tuple[int, int], orientation: int, wanted: Tuple[int, int]) -> Optional[bool]:
    """Whether pixels of the size ``wanted`` (width, height) are those turned by EXIF's orientation,
    by their size.

    None where the size does not tell: half turns, square pictures, and where neither has it.

    >>> is_turned((64, 48), 6, (48, 64)), is_turned((64, 48), 6, (64, 48)), is_turned((64, 48), 3, (64, 48))
    (True, False, None)
    """
    if orientation == 1:
        return False
    if orientation < 5 or stored[0] == stored[1] or tuple(sorted(stored)) != tuple(sorted(wanted)):
        return None
    return tuple(stored) != tuple(wanted)


def _turned(pixels: np.ndarray, orientation: int) -> np.ndarray:
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    across, down = orientation in (2, 3, 6, 7), orientation in (3, 4, 7, 8)
    return np.ascontiguousarray(pixels[:: -1 if down else 1, :: -1 if across else 1])


def _require_picture(data: bytes, name: str) -> None:
    """Files of other kinds by their beginning. Raises PictureFileError."""
    if not data.strip(b"\0"):
        what = f"holds {len(data)} zero octets" if data else "is empty"
        raise PictureFileError(f"{name}: cannot be read as a picture, it {what}; copy it again")
    kind = next((k for begin, k in _NO_PICTURES.items() if data.startswith(begin)), None)
    if data[4:8] == b"ftyp":
        kind = _FTYP_KINDS.get(data[8:12], "a film")
    if kind is not None:
        raise PictureFileError(
            f"{name}: is {kind}, whatever its name; {_ADVICE.get(kind, 'save it as JPEG or PNG')}"
        )


def _decode_jpeg(data: bytes, name: str, grey: bool) -> Optional[np.ndarray]:
    """None where the colours are not of a kind that is decoded strictly. Raises
    PictureFileError."""
    import simplejpeg  # OpenCV and Pillow pass over libjpeg's warnings

    try:
        pixels = simplejpeg.decode_jpeg(data, "GRAY" if grey else "BGR", strict=True)
    except ValueError as error:
        words = str(error)
        if "Premature end" in words:
            raise PictureFileError(
                f"{name}: ends in the middle of the picture; copy it again ({words})"
            ) from error
        if any(
            w in words
            for w in ("Unsupported color", "Could not determine subsampling", "precision")
        ):
            return None
        raise PictureFileError(f"{name}: is damaged, copy it again ({words})") from error
    return pixels[..., 0] if grey else pixels


def _decode(data: bytes, name: str, grey: bool) -> np.ndarray:
    """Raises PictureFileError."""
    flags = _FLAGS | (cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR)
    if grey:
        flags &= ~cv2.IMREAD_ANYDEPTH  # who asks for grey wants 8 bits
    problem = _problem(data) or _deflate_problem(data)
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise PictureFileError(f"{name}: cannot be read as a picture ({error.err})") from error
    if problem is not None:
        raise PictureFileError(f"{name}: {problem}")
    if pixels is None:
        raise PictureFileError(f"{name}: cannot be read as a picture")
    if _ends_in_zeros(data, pixels):
        raise PictureFileError(
            f"{name}: ends in the middle of the picture, with zeros behind; copy it again"
        )
    return pixels


def _problem(data: bytes) -> Optional[str]:
    """What Pillow, which is stricter than OpenCV, finds wrong; None: nothing, or a kind that it
    does not know."""
    from PIL import Image, UnidentifiedImageError

    try:
        with _quiet(), Image.open(io.BytesIO(data)) as image:
            # PNG has a checksum in every part
            check = image.verify if image.format == "PNG" else image.load
            check()
    except (UnidentifiedImageError, Image.DecompressionBombError):
        return None
    except (OSError, SyntaxError, ValueError) as error:
        words = str(error)
        if "truncated" in words.lower():
            return f"ends in the middle of the picture; copy it again ({words})"
        return f"is damaged, copy it again ({words})"
    return None


def _deflate_problem(data: bytes) -> Optional[str]:
    """Says what is wrong with the checksums of a TIFF's deflated parts, whose checksums no decoder
    looks at."""
    if not data.startswith(_TIFFS):
        return None
    import tifffile

    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            page = file.pages[0]
            parts = (
                list(zip(page.dataoffsets, page.databytecounts))
                if page.compression in _DEFLATE
                else []
            )
        for at, size in parts:
            zlib.decompress(data[at : at + size])
    except (tifffile.TiffFileError, IndexError, AttributeError):
        return None  # OpenCV says what it thinks of it
    except zlib.error as error:
        return f"is damaged, copy it again ({error})"
    return None


def _ends_in_zeros(data: bytes, pixels: np.ndarray) -> bool:
    """Whether zeros took the place of the file's end: compressed files have no such run; in others
    the picture is black from the middle of a row on."""
    if data.startswith(b"\x89PNG") or len(data) - len(data.rstrip(b"\0")) < _ZEROS:
        return False
    if len(data) < 0.9 * pixels.nbytes:
        return True
    rows = pixels.reshape(len(pixels), pixels.shape[1], -1).any(axis=2)
    rows = rows[::-1] if data.startswith(b"BM") else rows  # stored from below
    last = int(np.flatnonzero(rows.any(axis=1))[-1]) if rows.any() else 0
    if not 0 < last < len(rows) - 2:
        return False
    end = int(np.flatnonzero(rows[last])[-1]) + 1
    return (
        bool(rows[last, 0] and rows[last - 1, end:].mean() > 0.5) if end < rows.shape[1] else False
    )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Runs the block without Pillow's warnings about EXIF parts that are broken, which say nothing
    of the pixels."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _png_parts(data: bytes) -> Set[bytes]:
    """The types of the parts (chunks) of a PNG."""
    found, at = set(), len(_PNG)
    while at + 8 <= len(data):
        found.add(data[at + 4 : at + 8])
        at += 12 + int.from_bytes(data[at : at + 4], "big")
    return found


def _orientation(data: bytes) -> int:
    """EXIF's; 1 where the file has none, or none of eight."""
    if data.startswith(_PNG) and not _png_parts(data) & _PNG_TEXTS:
        return 1  # Pillow would decode all of it to look behind the pixels
    from PIL import Image

    try:
        with _quiet(), Image.open(io.BytesIO(data)) as image:
            found = image.getexif().get(_ORIENTATION, 1)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return 1
    return found if found in range(1, 9) else 1
