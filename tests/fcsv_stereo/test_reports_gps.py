# SPDX-License-Identifier: Apache-2.0
"""Photographs with GPS as strangers' cameras leave them: read right, or named and left out, or
refused by name."""

import numpy as np
import pytest
from support import gps_reports
from support.gps_reports import (
    AREA,
    ORIGIN,
    block,
    exif_gps,
    imported,
    refusal,
    require_right,
    sexagesimal,
    with_angles,
    write,
)
from support.gps_tags import gps_at

from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.command import table
from fcsv_stereo.photos.gps import read_gps
from fcsv_stereo.photos.tags import read_tags
from fcsv_stereo.posed import colmap

# ---- the reports ---------------------------------------------------------------------------------


def report(shared_data, name):
    return shared_data / "reports" / f"import_{name}"


#: By report: bounds of the scale's error (a share) and of the turn's (degrees), three times what
#: GPS of 2 m (up: 4 m) over 60 x 40 m gives (Cramér and Rao's bound); with RTK a tenth.
READ = {
    "altitude_only_in_xmp": (0.07, 5.0),
    "altitude_ref_3": (0.07, 11.0),
    "comma_in_name": (0.07, 11.0),
    "exif_whole_seconds": (0.02, 2.0),
    "first_gps_far": (0.08, 12.0),
    "gimbal_angles_zero": (0.07, 11.0),
    "gimbal_roll_180": (0.07, 5.0),
    "orientation6_model_turned": (0.07, 11.0),
    "rtk_good": (0.001, 0.2),
    "subfolder_only": (0.07, 11.0),
    "two_blanks": (0.07, 11.0),
}


@pytest.mark.parametrize("name", READ)
def test_reports_that_are_read(shared_data, tmp_path, name):
    """Scale 10; the world is level and looks north, by the cameras of these drawings: all straight
    down."""
    folder, (scale, turn_deg) = report(shared_data, name), READ[name]
    done = imported(folder, tmp_path / "out")
    assert done.similarity.scale == pytest.approx(10.0, rel=scale)
    posed = colmap.read_images(
        tmp_path / "out" / "images.txt", colmap.read_cameras(tmp_path / "out" / "cameras.txt")
    )
    down = np.mean([p.T_home_cam[:3, 2] for p in posed], axis=0)
    assert np.degrees(np.arccos(-down[2] / np.linalg.norm(down))) < turn_deg
    flown = {p.name[-8:-4]: p.T_home_cam[:3, 3] for p in posed}
    east = flown["0004"] - flown["0000"]
    assert abs(np.degrees(np.arctan2(east[1], east[0]))) < 5.0, "the first row was flown east"
    assert colmap.read_photographs(tmp_path / "out").prior is not None, "map reads what was written"


def test_report_whose_heights_are_below_the_ellipsoid(shared_data, tmp_path):
    done = imported(report(shared_data, "altitude_ref_3"), tmp_path / "out")
    assert done.origin.height_m == pytest.approx(-142.3, abs=0.1)


def test_report_whose_first_fix_is_far(shared_data, tmp_path):
    done = imported(report(shared_data, "first_gps_far"), tmp_path / "out")
    assert done.origin.latitude_deg == pytest.approx(48.0, abs=0.01)
    assert done.remarks["DJI_0000.JPG"] == "its place is not used: 458 km from the others"


@pytest.mark.parametrize(
    "name, words",
    [
        (
            "altitude_ref_half",
            r"5 of 10 places are elsewhere, 5 of them in height alone: DJI_000\d.JPG, .*GPSAltitudeRef",
        ),
        (
            "nadir_strip_rows_along",
            "level is known to .* degrees, .* because the photographs lie on a line",
        ),
        (
            "wrong_longitude_ref",
            "GPS's places are the mirror image of the poses: .*GPSLongitudeRef",
        ),
    ],
)
def test_reports_that_are_refused(shared_data, tmp_path, name, words):
    with pytest.raises(InputError, match=words):
        imported(report(shared_data, name), tmp_path / "out")


# ---- the same kinds, drawn here ------------------------------------------------------------------


def test_places_better_than_the_model(tmp_path, wrong_input):
    """RTK of 1 cm, a model that is off by 8 cm: the model's error is found, nothing is refused."""
    rng, photos = np.random.default_rng(4), block(sigma_m=0.01)
    for p in photos:
        p.xmp.update(RtkFlag="50", RtkStdLon="0.010", RtkStdLat="0.010", RtkStdHgt="0.020")
        p.enu_m = p.enu_m + rng.normal(0, 0.08, 3)
    done = require_right(write(tmp_path, with_angles(photos)), tmp_path / "out", photos, 0.01, 0.5)
    assert not done.similarity.outliers.any() and 0.04 < done.similarity.model_sigma_m < 0.16
    wrong_input(AREA, "RTK of 1 cm, poses that are worse than that", "read right")


@pytest.mark.parametrize("nadir", [True, False])
@pytest.mark.parametrize("angles", ["0", "roll 180", "yaw"])
def test_wrong_gimbal_angles(tmp_path, wrong_input, angles, nadir):
    photos = with_angles(block(nadir=nadir))
    for p in photos if angles == "0" else photos[2:5]:
        values = {
            "0": ("+0.00",) * 3,
            "roll 180": (None, None, "180.0"),
            "yaw": ("+77.0", None, None),
        }[angles]
        for name, value in zip(("Yaw", "Pitch", "Roll"), values):
            p.xmp[f"Gimbal{name}Degree"] = value or p.xmp[f"Gimbal{name}Degree"]
    done = require_right(write(tmp_path, photos), tmp_path / "out", photos)
    if angles == "0":
        assert len(done.remarks) == 10
        (said,) = set(done.remarks.values())
    else:
        assert list(done.remarks) == ["DJI_0002.JPG", "DJI_0003.JPG", "DJI_0004.JPG"]
        said = done.remarks["DJI_0002.JPG"]
    kind = {
        "0": "gimbal angles all 0",
        "roll 180": "gimbal roll of 180° in some",
        "yaw": "gimbal yaw wrong in some",
    }
    wrong_input(AREA, kind[angles], "left out and named", said)


def test_gimbal_angles_that_are_all_wrong(tmp_path, wrong_input):
    """Pitch of all -90 degrees, cameras that look 40 down: GPS of 2 m decides, though half would
    fit a tilted world."""
    photos = with_angles(block(nadir=False, sigma_m=2.0))
    for p in photos:
        p.xmp["GimbalPitchDegree"] = "-90.0"
    done = require_right(write(tmp_path, photos), tmp_path / "out", photos, 0.1, 9.0)
    assert done.similarity.wrong_angles.all()
    wrong_input(
        AREA, "gimbal pitch wrong in all", "left out and named", done.remarks["DJI_0000.JPG"]
    )


def test_portrait_without_a_tag(tmp_path, wrong_input):
    """Its rows are upright, not level: GPS of 2 m decides, in two rows."""
    photos = block(nadir=False, sigma_m=2.0)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    require_right(write(tmp_path, photos, lambda p: quarter), tmp_path / "out", photos, 0.1, 9.0)
    wrong_input(AREA, "pictures held upright without EXIF orientation, in two rows", "read right")


def test_whole_seconds(tmp_path, wrong_input):
    """Steps of 20 and 30 m are no receiver's 2 m: over 60 m they tell little, and say so. XMP's
    place does."""
    photos = block()
    true = [gps_at(p.enu_m, ORIGIN) for p in photos]
    for p, gps in zip(photos, true):
        p.exif_gps.update(
            {2: sexagesimal(gps.latitude_deg, 1), 4: sexagesimal(gps.longitude_deg, 1)}
        )
        del p.exif_gps[31]
    said = refusal(write(tmp_path / "exif", photos), tmp_path / "out")
    assert "north to" in said
    wrong_input(
        AREA, "places in whole seconds, photographs within 80 m", "refused", said.split(":")[0]
    )
    for p, gps in zip(photos, true):
        p.xmp.update(GpsLatitude=f"{gps.latitude_deg:.8f}", GpsLongitude=f"{gps.longitude_deg:.8f}")
    require_right(write(tmp_path / "xmp", photos), tmp_path / "xmp_out", photos)
    wrong_input(AREA, "places in whole seconds, finer ones in XMP", "read right")


@pytest.mark.parametrize(
    "ref, height", [(0, 560.0), (1, -560.0), (2, 560.0), (3, -560.0), (None, 560.0)]
)
def test_all_references_of_height(ref, height):
    tags = exif_gps(gps_at([0.0, 0.0, 0.0], ORIGIN))
    tags.pop(5)
    found, _ = read_gps(tags if ref is None else {**tags, 5: bytes([ref])}, {})
    assert found.height_m == pytest.approx(height)


def test_height_that_is_in_xmp_alone(tmp_path, wrong_input):
    photos = block()
    for p in photos:
        p.xmp["AbsoluteAltitude"] = f"{gps_at(p.enu_m, ORIGIN).height_m:+.2f}"
        del p.exif_gps[6]
    require_right(write(tmp_path, photos), tmp_path / "out", photos)
    wrong_input(AREA, "no GPSAltitude, but AbsoluteAltitude in XMP", "read right")


@pytest.mark.parametrize("wrong", [3, 5, 10])
def test_height_above_and_below(tmp_path, wrong_input, wrong):
    """A minority is left out and named, of halves nobody knows which is right; all: EXIF says
    so."""
    photos = block()
    for p in photos[:wrong]:
        p.exif_gps[5] = b"\1"
    write(tmp_path, photos)
    if wrong == 10:
        assert imported(tmp_path, tmp_path / "out").origin.height_m == pytest.approx(
            -560.0, abs=5.0
        )
    elif wrong == 3:
        done = require_right(tmp_path, tmp_path / "out", photos)
        assert list(done.remarks) == ["DJI_0000.JPG", "DJI_0001.JPG", "DJI_0002.JPG"]
        wrong_input(
            AREA, "GPSAltitudeRef wrong in some", "left out and named", done.remarks["DJI_0000.JPG"]
        )
    else:
        said = refusal(tmp_path, tmp_path / "out")
        assert (
            "5 of 10 places are elsewhere, 5 of them in height alone" in said
            and "GPSAltitudeRef" in said
        )
        wrong_input(AREA, "GPSAltitudeRef wrong in half of them", "refused", said.split(": DJI")[0])


@pytest.mark.parametrize("which", ["longitude", "latitude", "exchanged"])
@pytest.mark.parametrize("angles", [False, True])
def test_mirrored_places(tmp_path, wrong_input, which, angles):
    photos = with_angles(block()) if angles else block()
    for p in photos:
        if which == "exchanged":
            p.exif_gps[2], p.exif_gps[4] = p.exif_gps[4], p.exif_gps[2]
        else:
            p.exif_gps.update({3: "W"} if which == "longitude" else {1: "S"})
    said = refusal(write(tmp_path, photos), tmp_path / "out")
    if which == "exchanged":
        assert said.startswith("latitude and longitude are exchanged in all")
        wrong_input(AREA, "latitude and longitude exchanged in all", "refused", said)
        return
    assert said.startswith("GPS's places are the mirror image of the poses")
    assert not angles or f"the reference of {which} (" in said
    wrong_input(AREA, "E for W or N for S in all", "refused", said.split(":")[0])


def test_one_longitude_on_the_other_side(tmp_path, wrong_input):
    photos = block()
    photos[0].exif_gps[3] = "W"
    done = require_right(write(tmp_path, photos), tmp_path / "out", photos)
    assert done.origin.longitude_deg > 0.0
    wrong_input(
        AREA, "E for W in one, the first", "left out and named", done.remarks["DJI_0000.JPG"]
    )


@pytest.mark.parametrize(
    "kind", ["0, 0", "no GPSLatitudeRef", "no GPSAltitude", "no place", "latitude of 95"]
)
def test_places_that_are_none(tmp_path, wrong_input, kind, capsys):
    """Of two photographs: the others are used. Of all: refused, with why."""
    photos = block()
    for p in photos[:2]:
        spoil(p.exif_gps, kind)
    done = require_right(write(tmp_path / "two", photos), tmp_path / "out", photos)
    assert list(done.remarks) == ["DJI_0000.JPG", "DJI_0001.JPG"]
    assert sum("its place is not used" in line for line in table(done).splitlines()) == 2
    wrong_input(AREA, f"{kind} in some", "left out and named", done.remarks["DJI_0000.JPG"])
    for p in photos[2:]:
        spoil(p.exif_gps, kind)
    said = refusal(write(tmp_path / "all", photos), tmp_path / "none")
    assert "0 of 10 photographs have a GPS position" in said
    assert done.remarks["DJI_0000.JPG"].split(": ", 1)[1] in said


def spoil(tags, kind):
    if kind == "0, 0":
        tags.update({2: sexagesimal(0.0), 4: sexagesimal(0.0)})
    elif kind == "latitude of 95":
        tags[2] = sexagesimal(95.0)
    else:
        for number in {
            "no GPSLatitudeRef": [1],
            "no GPSAltitude": [6],
            "no place": [1, 2, 3, 4, 5, 6],
        }[kind]:
            tags.pop(number, None)


@pytest.mark.parametrize(
    "orientation, R_upright_stored",
    [(6, [[0, -1, 0], [1, 0, 0], [0, 0, 1]]), (8, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])],
)
@pytest.mark.parametrize("model_of", ["shown", "stored"])
def test_models_of_turned_pixels(tmp_path, wrong_input, orientation, R_upright_stored, model_of):
    photos = block(nadir=False)
    for p in photos:
        p.orientation = orientation
    if model_of == "stored":
        write(tmp_path, photos, lambda p: np.array(R_upright_stored, float))
    else:
        write(tmp_path, photos, size=gps_reports.SIZE[::-1])
    require_right(tmp_path, tmp_path / "out", photos)
    wrong_input(AREA, "EXIF orientation, a model of the pixels as shown or as stored", "read right")


@pytest.mark.parametrize("angles", [False, True])
@pytest.mark.parametrize("model_of", ["shown", "stored"])
def test_pictures_upside_down(tmp_path, wrong_input, model_of, angles):
    """Their size does not tell what the model is of; which way is up does. The copy's pixels are
    those of the model."""
    photos = with_angles(block(nadir=False)) if angles else block(nadir=False)
    for p in photos:
        p.orientation = 3
    half = np.diag([-1.0, -1.0, 1.0]) if model_of == "stored" else np.eye(3)
    require_right(write(tmp_path, photos, lambda p: half), tmp_path / "out", photos)
    kept = read_tags(tmp_path / "out" / "images" / photos[0].name).orientation
    assert kept == (3 if model_of == "stored" else 1)
    wrong_input(
        AREA, "EXIF orientation 3, a model of the pixels as shown or as stored", "read right"
    )


def test_a_model_of_other_pixels(tmp_path, wrong_input):
    said = refusal(write(tmp_path, block(), size=(32, 24)), tmp_path / "out")
    assert "DJI_0000.JPG: is 64x48, and the model's camera" in said
    wrong_input(AREA, "a model of pictures of another size", "refused", said)


@pytest.mark.parametrize("rows", ["along", "across"])
@pytest.mark.parametrize("angles", [False, True])
def test_a_strip(tmp_path, wrong_input, rows, angles):
    """Rows across the strip are level, or gimbal angles tell the turn about it; rows along it tell
    nothing."""
    photos, rng = block(columns=8, rows=1), np.random.default_rng(1)
    for p in photos:
        p.enu_m = p.enu_m * [1.0, 0.05, 0.3]
        p.exif_gps = exif_gps(gps_at(p.enu_m + rng.normal(0, 0.3, 3), ORIGIN), 0.3)
        p.angles_deg[0] += 90.0 * (rows == "across")
    write(tmp_path, with_angles(photos) if angles else photos)
    if angles or rows == "across":
        require_right(tmp_path, tmp_path / "out", photos, turn_deg=6.0)
        return
    said = refusal(tmp_path, tmp_path / "out")
    assert "because the photographs lie on a line" in said
    wrong_input(
        AREA,
        "straight down in one line, rows along it, no angles",
        "refused",
        "the photographs lie on a line",
    )
