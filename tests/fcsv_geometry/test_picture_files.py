# SPDX-License-Identifier: Apache-2.0
"""Picture files: whole ones give their stored pixels, others are refused by name."""

import doctest
import io

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from PIL.PngImagePlugin import PngImageFile
from support.spoilt_pictures import BREAKS, HEIC, grain, spoil, with_orientation

from fcsv_geometry import picture_files
from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import decode_picture, read_picture


def encoded(kind, image=None):
    image = grain() if image is None else image
    if kind == "jpeg with a thumbnail":
        thumbnail = encoded("jpeg", cv2.resize(image, (40, 30)))
        return with_orientation(encoded("jpeg", image), 1, thumbnail)
    if kind.startswith("tiff, "):
        file = io.BytesIO()
        tifffile.imwrite(
            file, image[..., ::-1], compression="zlib" if kind == "tiff, deflate" else None
        )
        return file.getvalue()
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1] if kind == "jpeg, progressive" else []
    return cv2.imencode("." + kind.split(",")[0], image, options)[1].tobytes()


KINDS = (
    "jpeg",
    "jpeg with a thumbnail",
    "jpeg, progressive",
    "png",
    "tiff",
    "tiff, deflate",
    "tiff, raw",
    "bmp",
    "ppm",
)


def test_examples():
    assert doctest.testmod(picture_files).failed == 0


@pytest.mark.parametrize("kind", KINDS)
def test_whole_files_are_read_as_opencv_reads_them(kind):
    data = encoded(kind)
    for grey, flag in ((False, cv2.IMREAD_COLOR), (True, cv2.IMREAD_GRAYSCALE)):
        expected = cv2.imdecode(np.frombuffer(data, np.uint8), flag | cv2.IMREAD_IGNORE_ORIENTATION)
        assert np.array_equal(decode_picture(data, "a", grey).pixels, expected)


@pytest.mark.parametrize("how", BREAKS)
@pytest.mark.parametrize("kind", KINDS)
def test_spoilt_files_are_refused_by_name(kind, how, wrong_input, tmp_path):
    """Garbage among uncompressed pixels looks like pixels: nothing in such a file tells."""
    if how.startswith("garbage") and kind in ("tiff, raw", "bmp", "ppm"):
        pytest.skip("undetectable")
    path = tmp_path / "a.jpg"
    path.write_bytes(spoil(encoded(kind), how))
    with pytest.raises(PictureFileError, match="a.jpg: ") as error:
        read_picture(path)
    if kind == "jpeg with a thumbnail":
        wrong_input("Pictures", f"JPEG, {how}", "refused", str(error.value).split(" (")[0])


def test_black_pictures_and_what_cameras_write_behind_are_whole():
    for kind in KINDS:
        for image in (
            np.zeros((120, 160, 3), np.uint8),
            np.vstack([grain(), np.zeros((40, 160, 3), np.uint8)]),
        ):
            assert decode_picture(encoded(kind, image), "a").pixels.shape == image.shape
    for kind in ("jpeg", "png"):
        assert decode_picture(
            encoded(kind) + b"MotionPhoto" * 100 + bytes(2000), "a"
        ).pixels.shape == (120, 160, 3)


@pytest.mark.parametrize(
    "data, words",
    [
        (HEIC, "is HEIC"),
        (b"\0\0\0\x20ftypavif" + b"1" * 99, "is AVIF"),
        (b"\0\0\0\x20ftypmp42" + b"1" * 99, "is a film"),
        (b"", "is empty"),
        (bytes(5000), "5000 zero octets"),
        (b"version https://git-lfs.github.com/spec/v1", "git lfs"),
        (b"<!DOCTYPE html><html>", "HTML"),
        (b"%PDF-1.4", "PDF"),
        (b"PK\x03\x04abc", "archive"),
        (b"no picture at all", "cannot be read as a picture"),
        (b"\xff\xd8\xff\xe0garbage", "a.jpg: "),
    ],
)
def test_other_files_are_told_for_what_they_are(tmp_path, data, words, wrong_input):
    path = tmp_path / "a.jpg"
    path.write_bytes(data)
    with pytest.raises(PictureFileError, match="a.jpg: ") as error:
        read_picture(path)
    assert words in str(error.value) and "\n" not in str(error.value)
    if data is HEIC:
        wrong_input("Pictures", "HEIC named .jpg", "refused", str(error.value))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["jpeg", "png", "tiff", "tiff of 16 bits"])
def test_pixels_are_the_stored_ones_and_turn_as_exif_says(kind, orientation):
    """TIFF, too, which OpenCV turns always. Pillow turns the expected ones."""
    image = grain((32, 48))
    exif = Image.Exif()
    exif[0x0112] = orientation
    file = io.BytesIO()
    if kind.startswith("tiff"):
        wide = image.astype(np.uint16) * 256 if "16" in kind else image
        tifffile.imwrite(file, wide, extratags=[(274, "H", 1, orientation, True)])
    else:
        Image.fromarray(image).save(
            file, kind, exif=exif, **({"quality": 100, "subsampling": 0} if kind == "jpeg" else {})
        )
    found = decode_picture(file.getvalue(), "a")
    expected = {
        1: image,
        2: image[:, ::-1],
        3: image[::-1, ::-1],
        4: image[::-1],
        5: image.swapaxes(0, 1),
        6: np.rot90(image, -1),
        7: np.rot90(image, 2).swapaxes(0, 1),
        8: np.rot90(image),
    }
    eight_bits = (lambda p: p // 256) if "16" in kind else (lambda p: p)
    assert found.orientation == orientation
    for pixels, wanted in ((found.pixels, image), (found.turned(), expected[orientation])):
        assert pixels.shape == wanted.shape
        assert np.abs(eight_bits(pixels)[..., ::-1].astype(int) - wanted).mean() < 3.0


@pytest.mark.parametrize("tagged", [False, True])
def test_a_png_is_decoded_once(tmp_path, monkeypatch, tagged):
    """Pillow decodes all of a PNG to look for EXIF behind its pixels: it is asked only where there
    may be some."""
    exif = Image.Exif()
    exif[0x0112] = 6
    pixels = np.random.default_rng(1).integers(0, 255, (20, 30, 3), np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png", **({"exif": exif} if tagged else {}))
    decoded, load = [], PngImageFile.load
    monkeypatch.setattr(PngImageFile, "load", lambda self: decoded.append(1) or load(self))
    found = read_picture(tmp_path / "a.png")
    assert found.orientation == (6 if tagged else 1) and not decoded
    assert np.array_equal(found.pixels[..., ::-1], pixels)
