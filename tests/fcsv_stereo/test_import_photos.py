# SPDX-License-Identifier: Apache-2.0
"""GPS-tagged photographs become a folder that map reads: tags, places, scale, models, and what is
refused."""

import struct
import sys

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from support.gps_tags import FOCAL_35_MM, ORIGIN, PLACES_M, flown_photographs, gps_at, write_tagged
from support.scenes import CAMERA, camera_pose

from fcsv_geometry import transforms
from fcsv_geometry.earth import east_north_up_m
from fcsv_stereo import fcsv_command
from fcsv_stereo.errors import InputError, OutputError
from fcsv_stereo.photos import ImportOptions, import_photos
from fcsv_stereo.photos.command import main
from fcsv_stereo.photos.models import read_model
from fcsv_stereo.photos.similarity import fit
from fcsv_stereo.photos.tags import read_tags
from fcsv_stereo.posed import colmap

XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description drone-dji:GimbalYawDegree="+90.00"
drone-dji:GimbalPitchDegree="-30.0" drone-dji:GimbalRollDegree="0" drone-dji:RtkFlag="50" drone-dji:RtkStdLon="0.012"
drone-dji:RtkStdLat="0.011" drone-dji:RtkStdHgt="0.03" drone-dji:AbsoluteAltitude="+521.5"/></x:xmpmeta>"""
SMALL = np.zeros((24, 32, 3), np.uint8)


def test_tags_of_an_ordinary_camera(tmp_path):
    write_tagged(
        tmp_path / "a.jpg", SMALL, gps_at([30.0, -40.0, 12.0]), 6, FOCAL_35_MM, error_m=1.5
    )
    tags = read_tags(tmp_path / "a.jpg")
    assert (tags.size, tags.orientation, tags.camera, tags.R_enu_cam) == (
        (32, 24),
        6,
        "Maker Flyer 1",
        None,
    )
    # 40 px: the picture's diagonal
    assert tags.focal_px == pytest.approx(FOCAL_35_MM * 40.0 / np.hypot(36, 24))
    assert (tags.gps.sigma_m, tags.gps.height_sigma_m) == (1.5, 3.0)
    np.testing.assert_allclose(
        east_north_up_m([tags.gps], ORIGIN)[0], [30.0, -40.0, 12.0], atol=0.002
    )


def test_tags_of_a_drone(tmp_path):
    """Gimbal to the east, 30 degrees down: right is south, and the optical axis dips."""
    write_tagged(tmp_path / "a.jpg", SMALL, gps_at([0.0, 0.0, 0.0]), xmp=XMP)
    tags = read_tags(tmp_path / "a.jpg")
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    np.testing.assert_allclose(
        tags.R_enu_cam, np.array([[0, -1, 0], [-s, 0, -c], [c, 0, -s]]).T, atol=1e-12
    )
    assert (tags.gps.sigma_m, tags.gps.height_sigma_m, tags.gps.height_m) == (0.012, 0.03, 521.5)
    assert tags.focal_px is None


@pytest.mark.parametrize("south_west", [False, True])
def test_places_all_over_the_earth(tmp_path, south_west):
    origin = gps_at([0.0, 0.0, 0.0])
    if south_west:
        origin = type(origin)(-33.9, -70.7, -5.0)
    write_tagged(tmp_path / "a.jpg", SMALL, gps_at([100.0, 200.0, 3.0], origin))
    (found,) = east_north_up_m([read_tags(tmp_path / "a.jpg").gps], origin)
    np.testing.assert_allclose(found, [100.0, 200.0, 3.0], atol=0.002)


def test_files_without_a_place(tmp_path):
    write_tagged(tmp_path / "a.jpg", SMALL)
    # what some write without a fix
    write_tagged(tmp_path / "b.jpg", SMALL, type(ORIGIN)(0.0, 0.0, 0.0))
    (tmp_path / "c.jpg").write_bytes(b"no picture")
    assert read_tags(tmp_path / "a.jpg").gps is read_tags(tmp_path / "b.jpg").gps is None
    with pytest.raises(InputError, match=r"c\.jpg: cannot be read"):
        read_tags(tmp_path / "c.jpg")


def drawn_model(rng, line=False):
    """(p_model, p_enu, R_model_cam, scale): cameras within 40 m that look about level, in a world
    of its own."""
    n = 12
    p_enu = rng.uniform(-20, 20, (n, 3)) * ([1, 0, 0] if line else [1, 1, 0.2])
    R_enu_cam = [camera_pose([0, 0, 0], (0, *rng.normal(0, 10, 2)))[:3, :3] for _ in range(n)]
    R, scale = (
        Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix(),
        rng.uniform(0.1, 10),
    )
    p_model = (p_enu - rng.normal(0, 100, 3)) @ R / scale
    return p_model, p_enu, np.array([R.T @ c for c in R_enu_cam]), scale


@pytest.mark.parametrize("line", [False, True])
def test_the_scale_is_as_good_as_it_says(line):
    """30 draws with GPS of 0.5 m (up: 1 m), two of twelve 30 m off: the squared error over variance
    averages one (the mean of 30 scatters by 0.26; two of these and what the prior of GPS's own
    scatter adds), and the two are named."""
    rng = np.random.default_rng(5)
    scores, turns = [], []
    sigmas = np.tile([0.5, 0.5, 1.0], (12, 1))
    for _ in range(30):
        p_model, p_enu, R_model_cam, scale = drawn_model(rng, line)
        noisy = p_enu + rng.normal(0, sigmas)
        noisy[:2] += rng.choice([-1, 1], (2, 3)) * 17.0
        found = fit(p_model, noisy, sigmas, R_model_cam, [None] * 12)
        assert found.outliers[:2].all() and found.outliers[2:].sum() <= 1
        scores.append((np.log(found.scale / scale) / found.scale_sigma) ** 2)
        level = np.mean([(found.R_enu_model @ R)[2, 1] for R in R_model_cam])
        turns.append(level)
    assert 0.4 < np.mean(scores) < 1.6
    assert max(turns) < -0.9, "the cameras' down is down, on a line too"


@pytest.mark.parametrize(
    "places, words",
    [
        (2, "2 photographs have both GPS and a pose; scale and turn need 3"),
        (3, "within .* m, which GPS cannot tell apart"),
    ],
)
def test_places_that_fix_no_scale(places, words):
    p = np.eye(3)[:places] * 0.4
    with pytest.raises(InputError, match=words):
        fit(p, p, np.full((places, 3), 2.0), np.tile(np.eye(3), (places, 1, 1)), [None] * places)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return flown_photographs(tmp_path_factory.mktemp("flown"))


def require_true_places(out, tolerance_m=0.1):
    """Distances from the first photograph to all others, whatever way home is turned."""
    places = {
        p.name: p.T_home_cam[:3, 3] for p in colmap.read_images(out / "images.txt", {1: CAMERA})
    }
    found = [np.linalg.norm(places[f"{i}.jpg"] - places["0.jpg"]) for i in range(len(PLACES_M))]
    np.testing.assert_allclose(
        found, np.linalg.norm(PLACES_M - PLACES_M[0], axis=1), atol=tolerance_m
    )


def binary(folder, target):
    """COLMAP's binary model of one in text, as its documentation has it."""
    cameras, posed = read_model(folder)
    target.mkdir()
    c = cameras[1]
    values = (c.fx, c.fy, c.cx + 0.5, c.cy + 0.5, 0, 0, 0, 0)
    (target / "cameras.bin").write_bytes(
        struct.pack("<QiiQQ8d", 1, 1, 4, c.width, c.height, *values)
    )
    octets = struct.pack("<Q", len(posed))
    for i, p in enumerate(posed, 1):
        T = transforms.invert(p.T_home_cam)
        x, y, z, w = transforms.quaternion_xyzw(T)
        octets += struct.pack("<i7di", i, w, x, y, z, *T[:3, 3], 1) + p.name.encode() + b"\0"
        octets += struct.pack("<Q", 2) + struct.pack("<ddqddq", 1, 2, -1, 3, 4, 7)
    (target / "images.bin").write_bytes(octets)
    return target


@pytest.mark.parametrize("kind", ["text", "binary"])
def test_photographs_that_colmap_has_posed(flown, tmp_path, kind, capsys):
    model = flown / "model" if kind == "text" else binary(flown / "model", tmp_path / "sparse")
    command = ["import-photos", flown / "photos", "-o", tmp_path / "out", "--model", model]
    assert fcsv_command.main([*map(str, command)]) == 0, capsys.readouterr().err
    said = capsys.readouterr().out
    assert "0.jpg" in said and "known to" in said and "images/ (5)" in said
    require_true_places(tmp_path / "out")
    given = colmap.read_photographs(tmp_path / "out", "2.jpg")
    assert (
        len(given.configurations) == 4 and given.configurations[0].others[0].covariance is not None
    )
    up = [
        -p.T_home_cam[2, 1]
        for p in colmap.read_images(tmp_path / "out" / "images.txt", {1: CAMERA})
    ]
    assert min(up) > 0.99, "home's z is up"


def test_what_is_wrong_is_said_and_nothing_is_left(flown, tmp_path, monkeypatch):
    photos, out = flown / "photos", tmp_path / "out"
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "precious").touch()
    with pytest.raises(OutputError, match="is not empty"):
        import_photos(photos, tmp_path / "full", ImportOptions(flown / "model"))
    sparse = binary(flown / "model", tmp_path / "sparse")
    (sparse / "images.bin").write_bytes((sparse / "images.bin").read_bytes()[:-30])
    (tmp_path / "few").mkdir()
    write_tagged(tmp_path / "few" / "0.jpg", SMALL, ORIGIN)
    write_tagged(tmp_path / "few" / "1.jpg", SMALL)
    for folder, model, words in (
        (tmp_path / "none", None, "is no folder of photographs"),
        (sparse, None, "holds no photographs"),
        (tmp_path / "few", flown / "model", "1 of 2 photographs have a GPS position"),
        (photos, sparse, "images.bin: ends early"),
        (photos, tmp_path, "cameras.txt is missing"),
    ):
        monkeypatch.setitem(sys.modules, "pycolmap", object())
        with pytest.raises(InputError, match=words):
            import_photos(folder, out, ImportOptions(model))
    assert not out.exists() and not list(tmp_path.glob(".out*"))


def test_without_pycolmap_the_command_says_how_to_get_it(flown, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    assert main([str(flown / "photos"), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "pip install pycolmap" in said and "--model" in said
    assert not (tmp_path / "out").exists()


def test_a_picture_that_is_stored_turned_is_written_upright(tmp_path):
    """Bright above as shown; stored turned by a quarter, bright on the left."""
    from fcsv_stereo.photos.pictures import copy_upright

    stored = np.zeros((300, 400, 3), np.uint8)
    stored[:, :100] = 255
    (tmp_path / "to").mkdir()
    write_tagged(tmp_path / "a.jpg", stored, ORIGIN, orientation=6)
    copy_upright(read_tags(tmp_path / "a.jpg"), tmp_path / "to", 200)
    tags = read_tags(tmp_path / "to" / "a.jpg")
    assert (tags.size, tags.orientation) == ((150, 200), 1)
    assert tags.gps.latitude_deg == pytest.approx(ORIGIN.latitude_deg)
    pixels = np.asarray(Image.open(tmp_path / "to" / "a.jpg"))
    assert pixels[:40].mean() > 240 and pixels[60:].mean() < 15


@pytest.mark.slow
def test_poses_by_pycolmap(flown, tmp_path, capfd):
    """Five photographs of two walls, from the pixels and GPS of 5 cm alone, within 3 % of 6 m."""
    pytest.importorskip(
        "pycolmap", reason="pycolmap is optional: pip install -r tools/bench/requirements.txt"
    )
    # in this Python, whose pycolmap it is: rosrun's is that of the checkout
    status = fcsv_command.main(
        ["import-photos", str(flown / "photos"), "-o", str(tmp_path / "out")]
    )
    assert status == 0, capfd.readouterr().err[-2000:]
    require_true_places(tmp_path / "out", 0.2)
