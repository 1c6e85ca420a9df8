# SPDX-License-Identifier: Apache-2.0
"""The report: its figures are what they say, its warnings come when they should, and its page is
whole."""

import base64
import gzip
import json
import re
import warnings as python_warnings
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from plotly.offline import get_plotlyjs
from scipy.spatial import cKDTree
from support.scenes import CAMERA, given, texture, true_depth

from fcsv_geometry import transforms
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.evaluating.depth_metrics import TITLES
from fcsv_stereo.evaluating.evaluation import evaluate
from fcsv_stereo.map_files import output
from fcsv_stereo.map_files.table import demo_table
from fcsv_stereo.products.ground import GroundShown
from fcsv_stereo.report import (
    cloud_view,
    evidence,
    figures,
    page,
    plain_words,
    sections,
    write_report,
)
from fcsv_stereo.report.figures import _with_none
from fcsv_stereo.report.parts import Paragraph, Tone
from fcsv_stereo.thesis import ThesisOptions, map_thesis

WIDE = ErrorThreshold(5.0, False)


def mapped(scene):
    return map_thesis(scene, ThesisOptions(threshold=WIDE), lambda *_: None)


def turned(scene, rpy_deg):
    """The scene with every other picture's pose wrong by a rotation (camera axes)."""
    error = transforms.from_xyz_rpy([0, 0, 0], np.radians(rpy_deg))
    configurations = [
        replace(c, others=[replace(p, T_home_cam=p.T_home_cam @ error) for p in c.others])
        for c in scene.configurations
    ]
    return replace(scene, configurations=configurations)


@pytest.fixture(scope="module")
def scene():
    return given(
        ((0, -0.6, 0), "horizontal"), ((0, -1.2, 0), "horizontal"), ((0, 0, 0.8), "vertical")
    )


@pytest.fixture(scope="module")
def result(scene):
    return mapped(scene)


def test_epipolar_offset_is_the_pose_error(scene, result):
    """0.4 degrees about the camera's x move everything by f tan(0.4) across a horizontal
    baseline."""
    assert all(evidence.pair_evidence(result, i).epipolar_rms_px < 0.3 for i in range(2))
    wrong = mapped(turned(scene, [0.4, 0.0, 0.0]))
    expected_px = CAMERA.fx * np.tan(np.radians(0.4))
    for i in range(2):
        found = evidence.pair_evidence(wrong, i)
        assert found.corners >= 20 and found.epipolar_median_px == pytest.approx(
            expected_px, abs=0.35
        )
    words = plain_words.warnings(
        wrong, [evidence.pair_evidence(wrong, i) for i in range(3)], [], None
    )
    assert any("epipolar line" in w and "horizontal 0 (2." in w for w in words)


def test_overlap_is_that_of_the_views(result):
    """Baseline b at depth z leaves 1 - b f / (z w) of the view (h for a vertical one); rotations of
    0.7 degrees in sum move the view by some 4 px."""
    for pair, size, found in zip(
        result.pairs, (CAMERA.width, CAMERA.width, CAMERA.height), range(3)
    ):
        z = np.where(np.isfinite(result.depth), result.depth, evidence._FAR_M)
        expected = 1.0 - np.mean(pair.configuration.baseline_m * CAMERA.fx / z) / size
        assert evidence.pair_evidence(result, found).overlap == pytest.approx(expected, abs=0.05)


def test_points_and_depths_of_a_pair(result):
    found = [evidence.pair_evidence(result, i) for i in range(3)]
    assert sum(e.points for e in found) == result.points
    many = [e for e in found if e.points > 1000]  # a handful are strays
    assert many and all(11.0 < e.carried_m[0] <= e.carried_m[1] < 24.0 for e in many)


def test_a_seam_is_the_step_between_two_baselines(result):
    near, far = result.pairs[:2]
    step = replace(
        result,
        pairs=[
            replace(near, depth=np.full((10, 10), 20.0, np.float32), effective_range_m=(0.0, 20.0)),
            replace(far, depth=np.full((10, 10), 22.0, np.float32), effective_range_m=(20.0, 40.0)),
        ],
    )
    (seam,) = evidence.seams(step)
    assert seam.step == pytest.approx(0.1, abs=1e-6) and seam.at_m == 20.0 and seam.pixels == 100
    words = plain_words.warnings(step, [], [seam], None)
    assert any("+10% at 20 m" in w for w in words)


def test_warnings_in_plain_words(result):
    found = [evidence.pair_evidence(result, i) for i in range(3)]
    assert not plain_words.warnings(result, found, [], None)
    moved = [
        replace(i, stamp_s=i.stamp_s + 3.0 * n, refined=n == 1) for n, i in enumerate(result.images)
    ]
    moved[1] = replace(
        moved[1],
        T_home_cam=moved[1].T_home_cam
        @ transforms.from_xyz_rpy([0, 0, 0], np.radians([0, 2.0, 0])),
    )
    bad = replace(
        result,
        images=moved,
        sigma=result.depth * 0.3,
        depth=np.where(result.depth > 15, np.nan, result.depth),
    )
    pairs = [replace(found[0], overlap=0.3), *found[1:]]
    truth = evaluate(
        replace(result, sigma=result.sigma * 1e-3), None, true_depth(result.reference.T_home_cam)
    )
    words = "\n".join(plain_words.warnings(bad, pairs, [], truth))
    for expected in (
        "of the picture has a depth",
        "tilt it inwards: horizontal 0 (30%)",
        "not taken at one time",
        "(2.0°, 0.00 m)",
        "could not be refined",
        "above 10% of the distance",
        "sigma is too small",
    ):
        assert expected in words, words
    photographs = replace(bad, images=[replace(i, vehicle="camera") for i in bad.images])
    words = "\n".join(plain_words.warnings(photographs, pairs, [], truth))
    assert (
        "tilt it inwards" not in words
        and "photographs that show more of the same: horizontal 0 (30%)" in words
    )
    # what moved was looked for, and left out
    watched = replace(bad, watched=[p.other_name for p in bad.pairs])
    assert not any(
        "not taken at one time" in w for w in plain_words.warnings(watched, pairs, [], truth)
    )


def test_a_picture_of_another_place_stands_out(scene, result):
    """Block matching finds depths for half of it all the same; corners are not where these say."""
    foreign = [
        replace(c, others=[replace(p, image=texture(9)[:240, :320].copy()) for p in c.others])
        for c in scene.configurations[1:2]
    ]
    found = mapped(replace(scene, configurations=foreign))
    assert found.coverage > plain_words.LEAST_COVERAGE
    words = plain_words.warnings(found, [evidence.pair_evidence(found, 0)], [], None)
    assert any("shows another place" in w for w in words), words
    assert all(evidence.pair_evidence(result, i).found > 0.5 for i in range(3))


def test_who_takes_poses_as_they_come_is_told_what_does_not_show(result):
    """A baseline 20 % too long makes all depths so, and no picture says it."""
    refined = replace(result, images=[replace(i, refined=True) for i in result.images])
    said = [sections.summary(sections.ReportData(r, [], []))[0].text for r in (result, refined)]
    assert said[0].startswith("Nothing stands out as wrong. Poses were taken as they came")
    assert said[1] == "Nothing stands out as wrong."


def test_what_refinement_cannot_know_is_told(result):
    """On the page, where all is well or something else is not; in report.json; and as a last line
    of the command."""
    refined = replace(
        result,
        images=[replace(i, refined=True) for i in result.images],
        unseen=["The focal length."],
    )
    good, *_ = sections.summary(sections.ReportData(refined, [], []))
    assert (good.text, good.tone) == ("Nothing stands out as wrong. The focal length.", Tone.GOOD)
    bad = sections.summary(sections.ReportData(replace(refined, warnings=["Dark."]), [], []))
    assert [(p.text, p.tone) for p in bad[:2]] == [
        ("Dark.", Tone.WARNING),
        ("The focal length.", Tone.PLAIN),
    ]
    document = output.report_document(refined)
    assert (
        document["unseen"] == ["The focal length."] and not output.report_document(result)["unseen"]
    )
    document["timing_s"] = {"total": 1.0}
    assert demo_table(document).splitlines()[-1] == "not seen: The focal length."


@pytest.mark.parametrize(
    "factor, times, words",
    [
        (1.0, 1.0, ""),
        (1.0, 50.0, "sigma is too large"),
        (1.0, 1e-3, "sigma is too small"),
        (1.2, 50.0, "wrong by more than 10 %"),
        (1.06, 1.0, "% too far, more than sigma says"),
    ],
)
def test_what_truth_says_against_a_map_is_said(result, factor, times, words):
    true = true_depth(result.reference.T_home_cam)
    off = np.abs(result.depth - true)
    sigma = np.full_like(result.depth, max(float(np.nanpercentile(off, 68)), 1e-4)) * np.float32(
        times
    )
    made = replace(result, depth=result.depth * np.float32(factor), sigma=sigma)
    said = [
        w
        for w in plain_words.warnings(made, [], [], evaluate(made, None, true))
        if "Against truth" in w
    ]
    assert bool(said) == bool(words) and words in "".join(said)


def test_a_seam_of_one_depth_for_all_pairs(scene, result):
    """What a pair alone would say: a shorter one turned by 0.2 degrees about the other axis sees f
    tan(0.2) px more."""
    baselines = (0.6, 1.2)

    def shared(turn_deg):
        off_px = CAMERA.fx * np.tan(np.radians(turn_deg))
        shorter, longer = (
            replace(p, effective_range_m=(0.0, 20.0), shares_depth=True) for p in result.pairs[:2]
        )
        shorter = replace(shorter, disparity=shorter.disparity + np.float32(off_px))
        return replace(result, pairs=[shorter, longer])

    (level,), (stepped,) = evidence.seams(shared(0.0)), evidence.seams(shared(0.2))
    assert level.pixels >= evidence._LEAST_CORNERS and abs(level.step) < 0.01
    # the depth that all share is too near for the shorter pair by so much
    d_px = CAMERA.fx * baselines[0] / 20.0
    assert stepped.step == pytest.approx(
        1.0 / (1.0 + CAMERA.fx * np.tan(np.radians(0.2)) / d_px) - 1.0, abs=0.02
    )


def test_the_page_has_every_section_and_says_what_is_new(result, tmp_path, monkeypatch):
    truth = true_depth(result.reference.T_home_cam)
    monkeypatch.setattr(
        page,
        "SECTIONS",
        [*page.SECTIONS, ("Another page", lambda data: [Paragraph("something new")])],
    )
    evaluation = evaluate(result, None, truth)
    result = replace(result, ground=GroundShown("half of it is free", "/9j/"))
    path = write_report(result, tmp_path, evaluation, truth)
    text = path.read_text()
    assert "half of it is free" in text
    for words in (*TITLES, *evaluation.metrics.cells()):
        assert f"<td>{words}</td>" in text
    for title, _ in (s for s in page.SECTIONS if s[0] not in ("Points of interest", "Near field")):
        assert f">{title}</h2>" in text
    assert (
        "something new" in text
        and text.count("<img src=") > 10
        and "http:" not in text
        and "https:" not in text
    )
    # browsers load nothing from elsewhere, whatever a script asks for
    assert "default-src 'none'" in text
    without = write_report(result, tmp_path).read_text()
    assert "Against truth" not in without and "Points of interest" not in text


def test_a_map_of_hardly_anything_has_a_page(result, tmp_path):
    nan = np.full_like(result.depth, np.nan)
    cloud = type(result.cloud)(
        *(getattr(result.cloud, n)[:0] for n in result.cloud.__dataclass_fields__)
    )
    empty = replace(result, depth=nan, sigma=nan, cloud=cloud, timing_s={})
    pairs = [replace(p, disparity=nan, depth=nan, candidates=[]) for p in result.pairs]
    text = write_report(replace(empty, pairs=pairs), tmp_path).read_text()
    assert "Only 0% of the picture" in text and "not measured" in text


def unpacked(text, name):
    """What the browser unpacks of the page."""
    (packed,) = re.findall(
        f'<script type="text/plain" id="cloud-view-{name}">([^<]*)</script>', text
    )
    return gzip.decompress(base64.b64decode(packed)).decode()


def test_the_cloud_can_be_turned_without_a_network(result, tmp_path, monkeypatch):
    """The page holds plotly's script and points of the cloud in their colours, to a centimetre."""
    monkeypatch.setattr(cloud_view, "MOST_POINTS", 500)
    text = write_report(result, tmp_path).read_text()
    assert unpacked(text, "plotly") == get_plotlyjs()
    figure = json.loads(unpacked(text, "figure"))
    points, cameras, measured = figure["data"]
    found = np.stack(
        [np.frombuffer(base64.b64decode(points[a]["bdata"]), points[a]["dtype"]) for a in "xyz"], -1
    )
    assert found.shape == (500, 3) and f"500 drawn at random of {result.points:,} points" in text
    distance, nearest = cKDTree(result.cloud.points_home_m).query(found)
    assert distance.max() < 0.01  # half a centimetre along each axis
    colours = ["#" + bytes(c).hex() for c in result.cloud.colors[nearest]]
    # of neighbours within 1 cm: any
    assert np.mean([a == b for a, b in zip(colours, points["marker"]["color"])]) > 0.9
    sigma = np.frombuffer(
        base64.b64decode(points["customdata"]["bdata"]), points["customdata"]["dtype"]
    )
    assert np.mean(np.abs(sigma - result.cloud.sigma_m[nearest]) < 6e-4) > 0.9  # rounded to 1 mm
    assert (
        np.allclose(figure["view"]["camera_m"], result.reference.T_home_cam[:3, 3])
        and measured["x"] == []
    )
    assert cameras["text"] == [i.name for i in result.images]
    assert "This browser has no WebGL" in text and "needs a browser that runs scripts" in text


def test_a_page_without_points_has_no_view(result, tmp_path):
    nothing = type(result.cloud)(
        *(getattr(result.cloud, n)[:0] for n in result.cloud.__dataclass_fields__)
    )
    text = write_report(replace(result, cloud=nothing), tmp_path).read_text()
    assert "In three dimensions" not in text and 'id="cloud-view' not in text


def test_names_cannot_break_the_page(result, tmp_path):
    word = "<script>alert('&\"')</script>"
    pairs = [replace(p, configuration=replace(p.configuration, name=word)) for p in result.pairs]
    images = [replace(i, vehicle=word) for i in result.images]
    evil = replace(result, warnings=[word], pairs=pairs, images=images, method=word)
    text = write_report(evil, tmp_path).read_text()
    own, scripts = re.subn(
        r"<script( type=\"text/plain\" id=\"[a-z_-]+\")?>.*?</script>", "", text, flags=re.DOTALL
    )
    assert scripts == 9 and not any(
        word in s for s in re.findall(r"<script.*?</script>", text, re.DOTALL)
    )
    assert "<script>" not in own and text.count("&lt;script&gt;alert(") >= 2 + 1 + 2 * len(
        pairs
    ) + len(images)


def test_colours_of_nothing_without_deprecated_ways():
    with python_warnings.catch_warnings():
        python_warnings.simplefilter("error")
        colormap = _with_none("turbo", "#ff0000")
        assert colormap(np.ma.masked_invalid([np.nan]))[0].tolist() == [1.0, 0.0, 0.0, 1.0]


_SPANS_M = [(95.0, 105.0), (11.0, 13.0), (2.0, 9.0), (10.0, 600.0), (0.02, 900.0), (0.001, 900.0)]


@pytest.mark.parametrize("low, high", _SPANS_M)
def test_numbers_of_a_logarithmic_axis_stay_apart(low, high):
    """On a chart's axis and on a colour bar: two labels or more, none on another."""
    figure, axes = plt.subplots(figsize=(6.0, 3.2))
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    figures.round_numbers(axes.xaxis)
    bar = figures.depth(np.geomspace(low, high, 400).reshape(20, 20), "depth").axes[-1]
    for drawn, labels in ((figure, axes.xaxis), (bar.figure, bar.yaxis)):
        drawn.canvas.draw()
        boxes = [
            t.get_window_extent()
            for t in labels.get_ticklabels(which="both")
            if t.get_text() and seen(labels, t)
        ]
        assert len(boxes) >= 2
        assert not [1 for i, a in enumerate(boxes) for b in boxes[:i] if a.overlaps(b)]
        plt.close(drawn)


def seen(axis, label):
    low, high = sorted(axis.get_view_interval())
    return low <= label.get_position()[0 if axis.axis_name == "x" else 1] <= high
