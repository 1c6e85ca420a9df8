# SPDX-License-Identifier: Apache-2.0
"""Pictures of 16 bits and of Bayer mosaics, in bags and as photographs: the same map as from 8-bit
RGB."""

import doctest

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import Image
from support.photographs import model
from support.scenes import CAMERA, photograph
from support.sessions import T_HOME_CAM, write_session

from fcsv_geometry.ros import conversions
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed import colmap, exposure
from fcsv_stereo.sessions.pictures import ENCODINGS, rgb_of
from fcsv_stereo.sessions.read import read_session

TINT = np.array([1.0, 0.8, 0.5])  # so that a wrong order of colours shows


def tinted(vehicle):
    return (photograph(T_HOME_CAM[vehicle]) * TINT).astype(np.uint8)


def encode(rgb, encoding):
    """RGB (HxWx3 uint8) as a driver would send it; 16 bits hold 12, as many cameras do."""
    image = rgb.astype(np.uint16) * 16 if encoding.endswith("16") else rgb
    if encoding.startswith("bayer"):
        pattern = encoding.split("_")[1][:4].upper()
        mosaic = np.empty(image.shape[:2], image.dtype)
        for colour, (row, column) in zip(pattern, np.ndindex(2, 2)):
            mosaic[row::2, column::2] = image[row::2, column::2, "RGB".index(colour)]
        return mosaic
    kind = encoding.rstrip("0123456789")
    if kind == "mono":
        return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    order = [("rgba" if len(kind) == 4 else "rgb").index(c) for c in kind]
    alpha = np.full_like(image[..., :1], np.iinfo(image.dtype).max)
    return np.ascontiguousarray(np.concatenate([image, alpha], axis=-1)[..., order])


def test_scale_in_its_docstring():
    result = doctest.testmod(exposure)
    assert result.attempted > 0 and result.failed == 0


@pytest.mark.parametrize("encoding", [e for names in ENCODINGS.values() for e in names])
def test_every_encoding_of_a_session(tmp_path, encoding):
    """Colours and grey values come back as they were, but for what a mosaic blurs and the scale
    stretches."""
    session = write_session(
        tmp_path, encoding=encoding, encode=lambda i: encode((i * TINT).astype(np.uint8), encoding)
    )
    (c,) = read_session(session).configurations
    for p in (c.references[0], c.others[0]):
        expected = tinted(p.vehicle).astype(float)
        if encoding.startswith("mono"):
            expected = np.repeat(
                cv2.cvtColor(expected.astype(np.uint8), cv2.COLOR_RGB2GRAY)[..., None], 3, -1
            )
        assert p.image.dtype == np.uint8 and p.image.shape == (CAMERA.height, CAMERA.width, 3)
        found = p.image[2:-2, 2:-2].astype(float)
        expected = expected[2:-2, 2:-2]
        gain, offset = np.polyfit(expected.ravel(), found.ravel(), 1)
        assert np.abs(gain * expected + offset - found).mean() < (
            6.0 if encoding.startswith("bayer") else 1.0
        )
        if encoding.endswith("8"):
            assert np.allclose(found.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), atol=2.0)
        else:  # the darkest and the brightest thousandth of all become the ends
            assert found.min() < 3 and found.max() > 252


def test_one_scale_for_all_pictures_of_a_vehicle(tmp_path):
    """A picture of half the light stays half as bright: it is not stretched by itself."""
    count = []

    def dimmer(image):
        count.append(1)
        return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint16) * (
            256 if len(count) % 2 else 128
        )

    (c,) = read_session(write_session(tmp_path, encoding="mono16", encode=dimmer)).configurations
    bright, dim, *_ = (float(p.image.mean()) for p in c.references)
    assert dim < 0.6 * bright


def photographs(folder, rgb, depth):
    """Two photographs of one camera."""
    model(folder, f"1 PINHOLE {CAMERA.width} {CAMERA.height} {CAMERA.fx} {CAMERA.fy} 160 120\n")
    for name, scale in (("a", 1.0), ("b", 0.5)):
        cv2.imwrite(
            str(folder / "images" / f"{name}.png"),
            (rgb[..., ::-1].astype(float) * scale).astype(depth),
        )
    return folder


def test_photographs_of_16_bits(tmp_path):
    """12 bits in 16: neither nearly black, nor each by itself."""
    rgb = tinted("uav1")
    given = colmap.read_photographs(photographs(tmp_path, rgb.astype(np.uint16) * 16, np.uint16))
    a, b = given.configurations[0].references[0].image, given.configurations[0].others[0].image
    assert a.dtype == b.dtype == np.uint8 and np.percentile(a, 99.8) > 240
    gain, offset = np.polyfit(rgb.ravel().astype(float), a.ravel().astype(float), 1)
    assert np.abs(gain * rgb + offset - a).mean() < 1.0
    assert b.mean() < 0.6 * a.mean()


def test_photographs_of_other_numbers_are_named(tmp_path):
    folder = photographs(tmp_path, tinted("uav1"), np.uint8)
    cv2.imwrite(str(tmp_path / "a.tiff"), np.zeros((CAMERA.height, CAMERA.width, 3), np.float32))
    (tmp_path / "a.tiff").rename(folder / "images" / "a.png")
    with pytest.raises(
        InputError, match=r"a\.png: holds float32 values; save it with 8 or 16 bits"
    ):
        colmap.read_photographs(folder)


@pytest.mark.parametrize("big", [0, 1])
@pytest.mark.parametrize("encoding", [e for names in ENCODINGS.values() for e in names])
def test_pictures_are_what_cv_bridge_makes_of_them(encoding, big):
    """To the last bit, with lines that are padded and samples of either order of bytes."""
    bits = 16 if encoding.endswith("16") else 8
    random = np.random.default_rng(1)
    rgb = random.integers(
        0, 1 << (bits if bits == 8 else 12), (CAMERA.height, CAMERA.width, 3)
    ).astype(np.uint8)
    array = encode(rgb, encoding)
    plain = conversions.array_to_image(array, encoding, 1.0, "cam")
    rows = (
        array.astype(array.dtype.newbyteorder(">" if big else "<"))
        .reshape(CAMERA.height, -1)
        .view(np.uint8)
    )
    padded = Image(plain.header, plain.height, plain.width, encoding, big, rows.shape[1] + 6, b"")
    padded.data = np.hstack([rows, np.full((CAMERA.height, 6), 77, np.uint8)]).tobytes()
    expected = conversions.image_to_array(plain, f"rgb{bits}")
    for message in (plain, padded):
        found = rgb_of("a.bag, topic /image_raw", message, CAMERA)
        assert found.dtype == expected.dtype and np.array_equal(found, expected)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"data": b"123"}, "image has 3 bytes where height x step is"),
        (
            {"step": 10, "data": bytes(10 * CAMERA.height)},
            "image has lines of 10 bytes where mono8 needs",
        ),
        ({"width": 7}, "picture is 7x"),
    ],
)
def test_pictures_that_are_not_what_they_say_are_named(change, words):
    message = conversions.array_to_image(
        np.zeros((CAMERA.height, CAMERA.width), np.uint8), "mono8", 1.0, "cam"
    )
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(InputError, match=words):
        rgb_of("a.bag, topic /image_raw", message, CAMERA)
