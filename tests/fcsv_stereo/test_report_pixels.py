# SPDX-License-Identifier: Apache-2.0
"""Picture and depth in the report: what the page tells of a pixel, and between two, is what the map
says."""

import base64
import gzip
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.scenes import CAMERA

from fcsv_stereo import report
from fcsv_stereo.model.kinds import WORDS, masks
from fcsv_stereo.report import pixel_view, sections, write_report

MEASURE = Path(report.__file__).parent / "templates" / "measure.js"
PLACES = [(0, 0), (17, 40), (100, 7), (CAMERA.width - 1, CAMERA.height - 1)]


@pytest.fixture
def result(tiny_map):
    return tiny_map


def codes(view):
    """What a browser unpacks."""
    opened = {
        n: gzip.decompress(base64.b64decode(getattr(view, n)))
        for n in ("about", "depth_codes", "sigma_codes", "kind_codes")
    }
    about = json.loads(opened["about"])
    arrays = {
        n: np.frombuffer(opened[f"{n}_codes"], t).tolist()
        for n, t in (("depth", "<u2"), ("sigma", "<u2"), ("kind", "u1"))
    }
    return about, arrays


def in_node(script, *given):
    """``script`` with fcsvMeasure and ``given``; what it returns. NaN comes as null."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    text = f"{MEASURE.read_text()}\nconst given = {json.dumps(given)};\nconsole.log(JSON.stringify({script}));"
    return json.loads(
        subprocess.run([node, "-"], input=text, capture_output=True, text=True, check=True).stdout
    )


def at(view, places):
    return in_node(
        "given[2].map(([u, v]) => fcsvMeasure.pixel(given[0], given[1], u, v))",
        *codes(view),
        places,
    )


def test_a_pixel_is_told_as_the_map_has_it(result):
    """To half a step of the codes: 0.05 % of depth, 0.5 % of sigma."""
    for (u, v), p in zip(PLACES, at(pixel_view.pixel_view(result), PLACES)):
        assert (p["u"], p["v"]) == (u, v)
        assert p["depth_m"] == pytest.approx(result.depth[v, u], rel=0.51 * pixel_view.DEPTH_STEP)
        assert p["sigma_m"] == pytest.approx(result.sigma[v, u], rel=0.51 * pixel_view.SIGMA_STEP)
        ray = (
            np.array([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0, 0.0])
            * p["depth_m"]
        )
        assert p["place_m"] == pytest.approx(
            (result.reference.T_home_cam @ (ray + [0, 0, 0, 1]))[:3]
        )
        assert p["code"] == result.kind[v, u] and masks(result.kind)[p["kind"]][v, u]


def test_a_pixel_without_depth_has_none(result):
    (p,) = at(pixel_view.pixel_view(result), [(5, 0)])
    assert p["depth_m"] is None and p["sigma_m"] is None


def test_large_pictures_are_thinned_and_places_stay(result, monkeypatch):
    monkeypatch.setattr(pixel_view, "MOST_PIXELS", result.depth.size // 8)
    view = pixel_view.pixel_view(result)
    about, arrays = codes(view)
    assert about["step"] == 3 and len(arrays["depth"]) == result.depth[::3, ::3].size
    (p,) = at(view, [(31, 61)])
    assert (p["u"], p["v"]) == (30, 60) and p["depth_m"] == pytest.approx(
        result.depth[60, 30], rel=6e-4
    )


def test_an_origin_is_added(result):
    shifted = replace(result, origin_m=np.array([389000.0, 5819000.0, 40.0]))
    (near,), (far,) = (at(pixel_view.pixel_view(r), [(17, 40)]) for r in (result, shifted))
    assert np.subtract(far["place_m"], near["place_m"]) == pytest.approx(shifted.origin_m)


def test_distance_and_height_have_the_sigma_of_both_depths(result):
    """Against draws of both depths: their spread is the page's, to 3 % (20,000 draws: 0.5 %; second
    order: 1 %)."""
    depth = np.full_like(result.depth, 50.0)
    depth[:, 160:] = 40.0
    sigma = np.full_like(depth, 0.5)
    view = pixel_view.pixel_view(replace(result, depth=depth, sigma=sigma))
    a, b = at(view, [(30, 200), (300, 20)])
    found = in_node("fcsvMeasure.between(...given)", a, b)
    places = [
        np.array(p["place_m"]) + np.random.default_rng(s).normal(0.0, 0.5, (20000, 1)) * p["way"]
        for s, p in enumerate((a, b))
    ]
    apart = places[1] - places[0]
    assert found["distance_m"] == pytest.approx(np.linalg.norm(apart.mean(axis=0)), rel=1e-3)
    assert found["distance_sigma_m"] == pytest.approx(np.linalg.norm(apart, axis=1).std(), rel=0.03)
    assert found["height_m"] == pytest.approx(apart[:, 2].mean(), abs=0.01)
    assert found["height_sigma_m"] == pytest.approx(apart[:, 2].std(), rel=0.03)


def test_a_point_of_the_cloud_has_the_way_of_its_pixel(result):
    (p,) = at(pixel_view.pixel_view(result), [(100, 70)])
    T = result.reference.T_home_cam
    way = in_node("fcsvMeasure.wayOf(...given)", p["place_m"], T[:3, 3].tolist(), T[:3, 2].tolist())
    assert way == pytest.approx(p["way"])


def test_words(result):
    words = in_node(
        "fcsvMeasure.pixelWords(...given)",
        "A",
        {
            "u": 3,
            "v": 4,
            "kind": "agreed",
            "code": 5,
            "depth_m": 12.345,
            "sigma_m": 0.21,
            "place_m": [12.0, 1.0, -2.0],
        },
        WORDS,
    )
    assert (
        words
        == "A: pixel (3, 4), agreed (5 pairs); depth 12.35 ± 0.21 m; in home x 12.00, y 1.00, z -2.00 m"
    )
    assert in_node("fcsvMeasure.metres(120, 15)") == "120 ± 15 m"
    points = [{"place_m": [0, 0, z], "sigma_m": 0.0, "way": [1, 0, 0]} for z in (1, 3)]
    assert in_node("fcsvMeasure.betweenWords(...given)", *points, True).endswith(
        "height 2.00 ± 0.00 m"
    )
    assert "height" not in in_node("fcsvMeasure.betweenWords(...given)", *points, False)
    assert "cannot be measured" in in_node(
        "fcsvMeasure.betweenWords(...given)",
        {**points[0], "place_m": [None] * 3},
        {**points[1], "place_m": ["NaN"] * 3},
        True,
    )


def test_kinds_are_named_as_in_concepts():
    """Each kind's words begin with its name; the page of concepts explains those of a map without
    depth cameras."""
    page = (Path(__file__).parents[2] / "docs/user/concepts.md").read_text()
    for name, words in WORDS.items():
        assert words.split(": ")[0] == name
        assert name in ("near", "nothing") or f"**{name}**" in page


def test_depth_is_as_large_as_the_picture(result, tmp_path):
    view = pixel_view.pixel_view(result)
    shapes = {
        cv2.imdecode(np.frombuffer(base64.b64decode(j), np.uint8), 1).shape
        for j in (view.picture, view.depth)
    }
    assert shapes == {(CAMERA.height, CAMERA.width, 3)}
    text = write_report(result, tmp_path).read_text()
    assert re.search(r'<input type="range" id="pixel-view-slider"', text)
    assert "http" not in text.replace("http-equiv", "")


def test_a_map_without_depth_shows_its_picture_alone(result):
    none = replace(result, depth=np.full_like(result.depth, np.nan))
    assert [p.kind for p in sections.picture_and_depth(sections.ReportData(none, [], []))] == [
        "figures"
    ]
