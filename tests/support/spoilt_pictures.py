# SPDX-License-Identifier: Apache-2.0
"""Picture files as copies that broke off, bad cards and renamed files leave them."""

import cv2
import numpy as np

BREAKS = ("cut at 10 %", "cut at 50 %", "cut at 99 %", "zeros from 50 %", "garbage in the middle")
#: An HEIC file's beginning.
HEIC = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(range(256)) * 4


def spoil(data: bytes, how: str) -> bytes:
    n = len(data)
    if how.startswith("cut"):
        return data[: n * int(how.split()[2]) // 100]
    if how.startswith("zeros"):
        return data[: n // 2] + bytes(n - n // 2)
    garbage = np.random.default_rng(5).integers(0, 256, 600, np.uint8).tobytes()
    return data[: n // 2] + garbage + data[n // 2 + 600 :]


def grain(shape=(120, 160), seed=3):
    """RGB of a photograph's kind: structure of all sizes."""
    rng = np.random.default_rng(seed)
    image = cv2.resize(
        rng.integers(0, 255, (shape[0] // 8, shape[1] // 8, 3), np.uint8), shape[::-1]
    )
    return np.clip(image + rng.normal(0, 8, image.shape), 1, 255).astype(np.uint8)


def with_orientation(jpeg: bytes, orientation: int, thumbnail: bytes = b"") -> bytes:
    """A JPEG with an EXIF part that holds the orientation, and a thumbnail where one is given."""
    entry = b"\x12\x01\x03\0\x01\0\0\0" + bytes([orientation, 0, 0, 0])
    tiff = b"II*\0\x08\0\0\0\x01\0" + entry + b"\0\0\0\0"
    if thumbnail:
        at = len(tiff) + 2 + 2 * 12 + 4
        ifd1 = b"\x02\0" + b"\x01\x02\x04\0\x01\0\0\0" + at.to_bytes(4, "little")
        ifd1 += b"\x02\x02\x04\0\x01\0\0\0" + len(thumbnail).to_bytes(4, "little") + b"\0\0\0\0"
        tiff = tiff[:-4] + len(tiff).to_bytes(4, "little") + ifd1 + thumbnail
    exif = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
