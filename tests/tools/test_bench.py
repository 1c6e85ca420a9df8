# SPDX-License-Identifier: Apache-2.0
"""The bench's own arithmetic: a map that is the truth scores all, a known error scores what it
is."""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, photograph, picture, true_depth

from bench import __main__ as bench_main
from bench import colmap_poses, growth, measure, real, tables
from bench.__main__ import main
from bench.scenes import HORIZONTAL, NOISES, Scene, SceneName, smaller
from fcsv_geometry import transforms
from fcsv_stereo import pipeline
from fcsv_stereo.errors import MatchingError
from fcsv_stereo.model import Cloud, ImageEntry, MapResult, Reference, silent
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.thesis import Thesis


class Oracle(Thesis):
    """A method that answers what a test wants."""

    name = "oracle"

    def __init__(self, answer):
        self._answer = answer

    def map(self, given, options=None, progress=silent):
        return self._answer()


@pytest.fixture(scope="module")
def scene():
    reference = picture("uav1/reference", "uav1", 0.0, camera_pose([0, 0, 0]))
    others = [picture(f"uav2/{b:g}", "uav2", 0.0, camera_pose([0, -b, 0])) for _, b in HORIZONTAL]
    return Scene(
        SceneName("walls", 1), HORIZONTAL, reference, others, true_depth(reference.T_home_cam), {}
    )


def result_of(scene, depth, sigma, poses):
    reference = scene.reference
    view = Reference(
        reference.name, 0.0, "uav1", reference.image, reference.camera, reference.T_home_cam
    )
    images = [ImageEntry(n, "uav2", 0.0, T, T) for n, T in poses.items()]
    empty = Cloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    return MapResult("oracle", view, images, [], depth, sigma, empty)


def test_truth_scores_all_and_noise_is_what_it_says(scene, monkeypatch):
    truth = scene.true_depth.astype(np.float32)

    def oracle():
        noise = np.random.default_rng(1).normal(0.0, 0.2, truth.shape).astype(np.float32)
        return result_of(scene, truth + noise, np.full_like(truth, 0.2), scene.true_poses())

    monkeypatch.setitem(pipeline.METHODS, "oracle", Oracle(oracle))
    f = measure.measure("oracle", scene.given(HORIZONTAL, NOISES[0]), scene)
    assert f.within_10 == 1.0 and f.covered == 1.0 and f.wrong_of_answered == 0.0
    # normal errors of 0.2 m against sigma 0.2 m: 68.3 and 95.4 %, to within the scatter of 76800
    # draws
    assert f.within_1_sigma == pytest.approx(0.683, abs=0.01) and f.within_2_sigma == pytest.approx(
        0.954, abs=0.01
    )
    assert f.rotation_worst_deg < 1e-5 and np.isnan(f.median_far)


def test_a_turned_pose_and_a_wrong_half_are_measured(scene):
    depth = scene.true_depth.astype(np.float32)
    depth[:, : depth.shape[1] // 2] *= 1.5
    poses = scene.true_poses()
    turned = scene.others[1].name
    poses[turned] = poses[turned] @ transforms.from_xyz_rpy([0, 0, 0], np.radians([0.0, 0.3, 0.0]))
    f = measure.figures(result_of(scene, depth, np.ones_like(depth), poses), scene, 1.0, 1.0)
    assert f.within_10 == pytest.approx(0.5) and f.wrong_of_answered == pytest.approx(0.5)
    assert f.rotation_worst_deg == pytest.approx(0.3, abs=1e-6) and f.rotation_median_deg < 1e-5


def test_noise_is_the_same_for_every_list_and_spares_the_reference(scene):
    few, all_ = scene.given(HORIZONTAL[:2], NOISES[0]), scene.given(HORIZONTAL, NOISES[0])
    for a, b in zip(few.configurations, all_.configurations):
        assert np.array_equal(a.others[0].T_home_cam, b.others[0].T_home_cam)
        assert np.array_equal(a.references[0].T_home_cam, scene.reference.T_home_cam)
    errors = measure.prior_errors_deg(all_, scene)
    assert 0.02 < np.median(errors) < 0.6 and len(errors) == 4  # 0.15 degrees per axis


def test_priors_state_the_noise_that_is_on_them(scene):
    """Over 400 worlds: rotation and position of the picture at 8 m against the standard deviations
    that are given."""
    noise, shares = NOISES[1], []
    true = scene.true_poses()["uav2/8"]
    for seed in range(400):
        given = replace(scene, name=SceneName("walls", seed)).given(HORIZONTAL, noise)
        error = transforms.invert(true) @ given.configurations[3].others[0].T_home_cam
        turn, _ = cv2.Rodrigues(error[:3, :3])
        shares.append(
            [
                *turn[:, 0] / given.prior.rotation_rad,
                *error[:3, 3] / given.prior.position_sigma_m(8.0),
            ]
        )
    # four times the scatter of 400 draws
    assert np.std(shares, axis=0) == pytest.approx(np.ones(6), abs=0.15)
    assert given.prior.position_sigma_m(8.0) * np.sqrt(3.0) == pytest.approx(0.03 * 8.0)


def test_a_method_that_refuses_scores_nothing(scene, monkeypatch):
    def refuse():
        raise MatchingError("nothing matched")

    monkeypatch.setitem(pipeline.METHODS, "oracle", Oracle(refuse))
    f = measure.measure("oracle", scene.given(HORIZONTAL, NOISES[0]), scene)
    assert f.within_10 == 0.0 and np.isnan(f.median)


def test_means_keep_the_worst_and_leave_out_what_is_not_known():
    a = measure.Figures(0.8, 0.9, 0.1, 0.01, float("nan"), 0.6, 0.9, 0.01, 0.02, 1.0, 2.0)
    b = replace(
        a, within_10=0.6, median_far=0.03, rotation_worst_deg=0.5, seconds=3.0, cpu_seconds=4.0
    )
    both = measure.mean([a, b])
    assert (
        both.within_10 == pytest.approx(0.7)
        and both.median_far == 0.03
        and both.rotation_worst_deg == 0.5
    )
    rows = tables.requirement_table(
        {("thesis", "H", "low"): [b], ("joint", "H", "low"): [a]}, ["H", "HV"], ["low", "hi"]
    )
    (ratio,) = [r for r in rows if "seconds" in r and ", H " in r]
    assert (
        "| 1.00 (1.00) | 0.33 (0.50) |" in ratio and sum("–" in r.split("|")[3] for r in rows) > 2
    )


def test_the_fields_metrics_stand_in_the_tables(scene):
    """Normal errors of 0.2 m against sigma 0.2 m, for one scene; half of that sigma for the
    other."""
    truth = scene.true_depth.astype(np.float32)
    noise = np.random.default_rng(1).normal(0.0, 0.2, truth.shape).astype(np.float32)
    maps = [
        result_of(scene, truth + noise, np.full_like(truth, s), scene.true_poses())
        for s in (0.2, 0.1)
    ]
    rows = [measure.figures(m, scene, 1.0, 2.0) for m in maps]
    both = measure.mean([*rows, measure.Figures(*[0.0] * 11)])  # the last one answered nothing
    shares = dict(both.metrics.interval_coverage)
    # 1.645 sigma and 0.822 of the errors' own
    assert shares[0.9] == pytest.approx((0.9 + 0.589) / 2, abs=0.01)
    assert both.metrics.worst_group == rows[1].metrics.worst_group
    assert both.metrics.sharpness == pytest.approx(0.75 * rows[0].metrics.sharpness, rel=1e-3)
    lines = tables.requirement_table({("joint", "H", "low"): rows}, ["H", "HV"], ["low", "high"])
    cells = {line.split("|")[1].strip(): line.split("|")[3].strip() for line in lines[2:]}
    assert cells["AUSE, H"] == f"{both.metrics.ause:.3f}"
    worst = rows[1].metrics.worst_group
    said = cells["worst band of distance, in its interval of 90 %, H"]
    assert said == f"{worst.coverage:.1%} ({worst.name})"
    refused = [measure.Figures(*[0.0] * 11)]
    assert measure.mean(refused).metrics is None
    lines = tables.scene_tables(
        {("joint", "H", n): [*rows, *refused] for n in ("low", "hi")}, ["a", "b", "c"]
    )
    at = lines.index("The field's metrics of the same maps:")
    assert lines.count(lines[at]) == 1 and at < lines.index("### H, pose noise hi")
    table = lines[at + 2 : at + 8]
    assert len({line.count("|") for line in table}) == 1 and table[-2].startswith(
        "| `joint`, c | – | –"
    )
    assert table[-1].split("|")[4].strip() == f"{both.metrics.ause:.3f}"


def test_what_is_answered_is_judged_by_its_kind(scene, monkeypatch):
    """A quarter agrees and is right, a quarter is by one pair and 20 % too far, the rest no pair
    supports."""
    truth = scene.true_depth.astype(np.float32)
    quarter = truth.shape[1] // 4
    depth, kind = truth.copy(), np.full(truth.shape, DepthKind.HIDDEN, np.uint8)
    kind[:, :quarter], kind[:, quarter : 2 * quarter] = 2, 1
    depth[:, quarter:] *= 1.2
    result = replace(result_of(scene, depth, 0.15 * truth, scene.true_poses()), kind=kind)
    monkeypatch.setattr(real, "Joint", lambda: Oracle(lambda: result))
    monkeypatch.setattr(real, "shoot", lambda *_: scene)
    lines = real.measure_answered([scene.name, scene.name])
    row = [s.strip() for s in lines[2].split("|")]
    assert row[1:9] == ["as it is", "walls 1", "50.0%", "50.0%", "0.0%", "–", "50.0%", "100.0%"]
    assert lines[4].split("|")[3:9] == lines[2].split("|")[3:9] and "2 maps" in lines[4]
    assert "| agreed: two pairs or more | 25.0% | 0.0% | 100.0% | 100.0% |" in lines


def test_growth_exponents_and_options():
    samples = [growth.Sample("size", "m", x, 1.0, 2.0 * x**1.5, 7.0) for x in (1.0, 2.0, 4.0)]
    assert growth.exponent(samples, "cpu_seconds") == pytest.approx(1.5)
    assert growth.exponent(samples, "memory_mib") == pytest.approx(0.0, abs=1e-9)
    options = growth._with_steps("thesis", 100)
    assert options.window.most_px - options.window.least_px == 100 and options.matcher == "sgbm"
    assert growth._with_steps("joint", 100).matching.most_levels == 100


def test_smaller_pictures_keep_their_rays(scene):
    small = smaller(scene.given(HORIZONTAL[:1], NOISES[0]), 2).configurations[0].references[0]
    assert small.image.shape[:2] == (120, 160)
    # the middle of four pixels is the pixel that they become
    assert (CAMERA.cx - 100.5) / CAMERA.fx == pytest.approx(
        (small.camera.cx - 50.0) / small.camera.fx
    )
    assert (
        np.abs(
            photograph(scene.reference.T_home_cam, small.camera).astype(int) - small.image
        ).mean()
        < 8
    )


@pytest.mark.slow
def test_the_page(tmp_path, monkeypatch):
    """Both methods on a real scene, in pictures of a quarter: what it takes is what is rendered and
    mapped."""
    small = partial(bench_main.shoot, size=(320, 240))
    monkeypatch.setattr(bench_main, "shoot", small)
    monkeypatch.setattr(colmap_poses, "missing", lambda: "COLMAP is not asked here")
    monkeypatch.setattr(bench_main, "measure_pairs", lambda scenes: ["| pair |"])
    out = tmp_path / "benchmarks.md"
    assert main(["--scenes", "field:1", "--no-growth", "--out", str(out)]) == 0
    text = out.read_text()
    for words in (
        "| figure (mean of the scenes) |",
        "field 1",
        "## COLMAP",
        "rotation error, worst",
        "noise 0.5°",
        "| AUSE, H 2, 4, 6, 8 m |",
        "## Pandora",
        "| pair |",
    ):
        assert words in text


def test_places_are_compared_without_turn_shift_and_scale():
    random = np.random.default_rng(1)
    true = random.normal(0.0, 3.0, (8, 3))
    T = transforms.from_xyz_rpy([5.0, -2.0, 1.0], [0.3, -0.4, 2.0])
    found = 0.2 * true @ T[:3, :3].T + T[:3, 3]
    assert colmap_poses.similarity_rms(found, true) < 1e-9
    scattered = true + random.normal(0.0, 0.01, (8, 3))
    # of 24 errors of 1 cm the similarity takes 7: rms of sqrt(17 / 8) cm, to within three times 1 /
    # sqrt(2 x 17)
    expected = 0.01 * np.sqrt(17.0 / 8.0)
    assert colmap_poses.similarity_rms(scattered, true) == pytest.approx(expected, rel=0.5)


def test_the_table_of_poses_and_what_failed():
    def found(errors, placed):
        return colmap_poses.PosesFound(errors, 0.01, placed, 8, 4.0, 6.0)

    street, field = SceneName("street", 1), SceneName("field", 1)
    ours = found([0.01, 0.02, 0.03], 8)
    lines = tables.pose_table(
        [(street, found([0.05] * 3, 7), ours), (field, "COLMAP failed: no model came out", ours)]
    )
    assert "| street 1 | COLMAP | 7 of 8 | 0.050° | 0.050° | 1.0 cm | 4.0 (6.0) |" in lines
    assert "| field 1 | COLMAP | COLMAP failed: no model came out | – | – | – | – |" in lines
    assert "| **all** | ours | 16 of 16 | 0.020° | 0.030° | 1.0 cm | 4.0 (6.0) |" in lines


def test_parts_alone_are_printed_and_leave_the_page_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    sample = growth.Sample("size", "joint", 0.3, 4.0, 6.0, 160.0)
    monkeypatch.setattr(
        growth, "measure_growth", lambda methods, quick: [sample, replace(sample, x=0.6)]
    )
    assert main(["--only", "growth"]) == 0
    said = capsys.readouterr().out
    assert "## Growth" in said and "## COLMAP" not in said and "figure (mean" not in said
    assert [str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.*")] == [
        "docs/pictures/growth.png"
    ]
