# SPDX-License-Identifier: Apache-2.0
"""Ground of a survey's folder: views joined by similarities, and a route that no view shows
alone."""

import json

import cv2
import numpy as np
import pytest
import rasterio

from fcsv_geometry import transforms
from fcsv_guidance.errors import GroundError
from fcsv_guidance.files import command
from fcsv_guidance.ground.site_views import read_site_views
from fcsv_stereo.survey import tuning

ROBOT = "config/robots/rescue.yaml"
WALL = (14.0, 14.4, -9.0, 2.0, 0.0, 3.0)
ORIGIN_M = [391000.0, 5817000.0, 30.0]
#: Where the second flight's home is in the site (m), its heading, and metres of the site per metre
#: of its map.
PLACE_M, TURN_RAD, SCALE = np.array([24.0, 2.0, 0.0]), np.pi, 1.25


@pytest.fixture
def survey(scene, write_map, tmp_path):
    """Two views that look at each other; the map of the second is too small. Sigma of its scale is
    0.2 %."""
    folder = tmp_path / "site"
    (folder / "views").mkdir(parents=True)
    first = scene([WALL]).view(size=(320, 240), sigma_share=0.001)
    size = {"size": (320, 240), "sigma_share": 0.001}
    box = (24.0 - 14.4, 24.0 - 14.0, 0.0, 11.0, 0.0, 3.0)  # the wall from the other side
    small = [tuple(v / SCALE for v in box)]
    second = scene(small, eye=(0.0, 0.0, 8.0 / SCALE)).view(**size)
    views, told = [], {}
    for name, view, at, turn, scale in (
        ("a", first, np.zeros(3), 0.0, 1.0),
        ("b", second, PLACE_M, TURN_RAD, SCALE),
    ):
        write_map(view, folder / "views" / name)
        add_picture(folder / "views" / name, view.depth.shape)
        S_site_home = transforms.from_xyz_yaw(at + ORIGIN_M, turn)
        S_site_home[:3, :3] *= scale
        views.append({"name": name, "input": "gone", "T_site_home": S_site_home.tolist()})
        told[name] = {
            "S_site_cam": (S_site_home @ view.T_home_cam).tolist(),
            "alone": False,
            "datum": "a",
            "scale_sigma": 0.01,
            "covariance": np.diag([0.0] * 6 + [0.002**2]).tolist(),
            "covariance_to_datum": np.diag([0.0] * 6 + [0.002**2]).tolist(),
        }
    site = {"crs": "EPSG:32633", "origin": ORIGIN_M, "views": views}
    (folder / "site.json").write_text(json.dumps(site))
    (folder / "adjustment.json").write_text(json.dumps({"views": told}))
    return folder


def add_picture(folder, shape):
    report = json.loads((folder / "report.json").read_text())
    report["reference"].update(height=shape[0], width=shape[1])
    (folder / "report.json").write_text(json.dumps(report))
    cv2.imwrite(str(folder / "reference.png"), np.full((*shape, 3), 90, np.uint8))


def ground_words(root, folder, out, *more):
    return [str(folder), "--robot", str(root / ROBOT), "-o", str(out), "--cell-m", "0.2", *more]


def test_depth_sigma_and_pose_are_those_of_the_site(survey):
    views, place = read_site_views(survey)
    assert views.names == ("a", "b") and place.crs == "EPSG:32633"
    assert np.allclose(views[1].T_home_cam[:3, 3], [24.0, 2.0, 8.0])
    read = np.load(survey / "views/b/depth.npy")
    both = np.isfinite(views[1].depth)
    assert np.allclose(views[1].depth[both], SCALE * read[both], rtol=1e-5)
    own = np.load(survey / "views/b/sigma.npy")[both] * SCALE
    of_scale = tuning.POSE_SIGMA * 0.002 * views[1].depth[both]
    most = np.hypot(tuning.PLANE_SIGMA, tuning.BEND_SIGMA * tuning.MOST_BEND)
    assert (views[1].sigma[both] <= 1.001 * np.hypot(most * own, of_scale)).all()
    assert (views[1].sigma[both] >= of_scale).all()


def test_a_route_crosses_from_one_view_to_the_other(survey, root, tmp_path, capsys):
    """The first view shows nothing of the wall's far side, the second nothing of its near side."""
    ends = ("--route", "10.5", "-2", "16", "-2", "--octomap", "0.5")
    out = tmp_path / "out"
    assert command.main(ground_words(root, survey, out, *ends)) == 0
    document = json.loads((out / "ground.json").read_text())
    route = np.array(document["route"]["points_m"])
    assert document["crs"] == "EPSG:32633" and document["origin_m"] == ORIGIN_M
    beside = np.abs(route[:, 0] - 14.2) < 3.0
    assert document["route"]["length_m"] > 8.0 and route[beside, 1].max() > 2.3
    with rasterio.open(out / "height.tif") as height:
        assert height.crs.to_epsg() == 32633
        ((before,), (wall,), (behind,)) = (
            next(height.sample([(x + ORIGIN_M[0], y + ORIGIN_M[1])]))
            for x, y in ((10.5, -2.0), (14.0, -2.0), (16.0, -2.0))
        )
    assert before == pytest.approx(30.0, abs=0.05) and behind == pytest.approx(30.0, abs=0.05)
    assert wall > 30.3
    names = {p.name for p in out.iterdir()}
    assert {"map.pgm", "map.yaml", "map_scaled.png", "map.bt", "map.ot", "ground.png"} <= names


@pytest.mark.parametrize("alone", ["a", "b"])
def test_no_view_alone_shows_that_route(survey, root, tmp_path, capsys, alone):
    for name in ("site", "adjustment"):
        document = json.loads((survey / f"{name}.json").read_text())
        if name == "site":
            document["views"] = [v for v in document["views"] if v["name"] == alone]
        (survey / f"{name}.json").write_text(json.dumps(document))
    ends = ("--route", "10.5", "-2", "16", "-2")
    assert command.main(ground_words(root, survey, tmp_path / "out", *ends)) != 0


def test_a_survey_stands_alone_and_must_be_whole(survey, root, tmp_path, capsys):
    both = [str(survey / "views/a"), *ground_words(root, survey, tmp_path / "out")]
    assert command.main(both) == 2
    assert "is a survey's, which stands alone" in capsys.readouterr().err
    (survey / "adjustment.json").write_text('{"views": {}}')
    assert command.main(ground_words(root, survey, tmp_path / "out")) == 2
    assert "run survey again" in capsys.readouterr().err
    with pytest.raises(GroundError, match="is not a whole survey"):
        read_site_views(survey)
