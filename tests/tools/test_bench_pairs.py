# SPDX-License-Identifier: Apache-2.0
"""Rectified pairs in the bench: what counts as inside an interval, and how Pandora is asked and
read."""

import json
import sys

import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, photograph, true_depth

from bench import interval_maps, pairs, pandora_intervals, rectified
from bench.interval_maps import IntervalMap, interval_table, pair_rows
from bench.scenes import SceneName
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import MatchingError
from fcsv_stereo.model import Picture

DOFFS_PX = 7.0
#: What Pandora's command does with a configuration: disparities and bounds as it writes them.
COMMAND = """
import json, sys
from pathlib import Path
import numpy as np, tifffile
config, out = json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2])
(Path({folder!r}) / "seen.json").write_text(json.dumps(config))
made = np.load(Path({folder!r}) / "made.npz")
out.mkdir()
for name in ("disparity", "confidence_measure", "validity_mask"):
    tifffile.imwrite(out / ("left_" + name + ".tif"), made[name])
"""


@pytest.fixture
def case():
    """A wall and a smaller one before it; the right camera has another principal point."""
    shifted = PinholeCamera(320, 240, CAMERA.fx, CAMERA.fy, CAMERA.cx + DOFFS_PX, CAMERA.cy)
    left, right = (
        Picture(
            name,
            name,
            0.0,
            photograph(camera_pose([0, y, 0]), camera),
            camera,
            camera_pose([0, y, 0]),
        )
        for name, y, camera in (("a", 0.0, CAMERA), ("b", -1.0, shifted))
    )
    return rectified.RectifiedCase("walls", left, right, true_depth(left.T_home_cam))


def test_disparities_of_a_pair_with_two_principal_points(case):
    wanted = CAMERA.fx * 1.0 / 20.0 - DOFFS_PX
    assert case.disparity(np.array([20.0, np.inf])) == pytest.approx([wanted, -DOFFS_PX])
    (pair,) = case.given().configurations
    assert pair.configuration.baseline_m == pytest.approx(1.0)


def test_bounds_in_disparity_and_sigma_in_depth_that_are_alike_give_the_same_figures(case):
    """Both 2 % too far, with intervals of 3 % to either side: all inside."""
    depth = (1.02 * case.true_depth).astype(np.float32)
    disparity = case.disparity(depth)
    half_px = 0.03 * case.focal_baseline_px_m / depth
    bounds = IntervalMap.of_disparity(
        case, disparity, disparity - half_px, disparity + half_px, 1.0
    )
    sigma = type("Map", (), {"depth": depth, "sigma": 0.03 * depth / 1.6448536})
    by_sigma = IntervalMap.of_sigma(case, sigma, 1.0)
    a, b = pair_rows(case, {"bounds": bounds, "sigma": by_sigma})
    assert a.figures == pytest.approx(b.figures, rel=1e-4)
    assert a.figures["inside"] == a.figures["both_inside"] == 1.0
    assert a.figures["width"] == pytest.approx(0.06, rel=1e-4)
    narrow = IntervalMap.of_disparity(
        case, disparity, disparity - half_px / 3, disparity + half_px / 3, 1.0
    )
    assert pair_rows(case, {"narrow": narrow})[0].figures["inside"] == 0.0


def test_what_both_answer_is_what_all_with_intervals_answer(case):
    left, right = (np.where(half, case.true_depth, np.nan) for half in (LEFT, RIGHT))
    maps = {
        "left": IntervalMap(left, np.ones_like(LEFT), np.ones(LEFT.shape), 1.0),
        "right": IntervalMap(right, RIGHT & LEFT, np.full(LEFT.shape, 2.0), 1.0),
        "plain": IntervalMap(np.where(LEFT, 1.5, 1.0) * case.true_depth, None, None, 3.0),
        "none": "refused: nothing matched",
    }
    rows = pair_rows(case, maps)
    known = np.isfinite(case.true_depth)
    assert rows[0].figures["answered"] == pytest.approx((LEFT & known).sum() / known.sum())
    assert rows[1].figures["inside"] == pytest.approx(
        (LEFT & RIGHT & known).sum() / (RIGHT & known).sum()
    )
    assert rows[1].figures["both_inside"] == 1.0 and rows[1].figures["both_width_px"] == 2.0
    assert "ause" not in rows[2].figures and rows[2].figures["wrong"] == pytest.approx(
        LEFT[known].mean()
    )
    lines = interval_table([*rows, *rows])
    assert (
        "| walls | none | refused: nothing matched | – | – | – | – | – | – | – | – | – | – | – |"
        in lines
    )
    (mean,) = [line for line in lines if line.startswith("| **mean** | plain |")]
    assert mean.split("|")[3].strip() == "100.0%" and mean.split("|")[-2].strip() == "3.0"
    assert len({line.count("|") for line in lines}) == 1


LEFT = np.zeros((240, 320), bool)
LEFT[:, :200] = True
RIGHT = np.zeros((240, 320), bool)
RIGHT[:, 100:] = True


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """This Python, with a command of Pandora's name."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "python").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    (tmp_path / "bin" / "python").chmod(0o755)
    (tmp_path / "bin" / "pandora").write_text(COMMAND.format(folder=str(tmp_path)))
    monkeypatch.setattr(pandora_intervals, "ENVIRONMENT", tmp_path)
    return tmp_path


def test_pandora_is_asked_for_the_range_and_read_with_its_signs(case, environment):
    disparity = case.disparity(case.true_depth).astype(np.float32)
    disparity[np.isnan(disparity)] = 5.0
    invalid = np.zeros(disparity.shape, np.uint16)
    # occluded; interval regularised, which informs alone
    invalid[:10], invalid[10:20] = 1 << 8, 1 << 11
    bounds = np.stack([0 * disparity, -disparity - 1.0, -disparity + 3.0], axis=-1)
    made = {"disparity": -disparity, "confidence_measure": bounds, "validity_mask": invalid}
    np.savez(environment / "made.npz", **made)
    found = pandora_intervals.pandora_on(case)
    assert np.isnan(found.depth[:10]).all()
    known = np.isfinite(case.true_depth[10:])
    np.testing.assert_allclose(found.depth[10:][known], case.true_depth[10:][known], rtol=1e-5)
    assert (
        found.width_px[100, 100] == pytest.approx(4.0, abs=1e-4) and found.inside[10:][known].all()
    )
    asked = json.loads((environment / "seen.json").read_text())
    truth = case.disparity(case.true_depth[np.isfinite(case.true_depth)])
    low, high = asked["input"]["left"]["disp"]
    assert (
        -high <= 0.9 * truth.min() and -low >= 1.1 * truth.max() and -low < 1.1 * truth.max() + 1.0
    )
    assert asked["pipeline"]["cost_volume_confidence.interval"]["possibility_threshold"] == 0.9


def test_where_pandora_is_missing_or_fails_the_reason_is_said(
    case, environment, tmp_path, monkeypatch
):
    """This Python cannot import it (and must not: its numpy is another)."""
    assert "pandora cannot be imported" in pandora_intervals.missing()
    (environment / "bin" / "pandora").write_text("raise SystemExit('no such measure')")
    assert pandora_intervals.pandora_on(case) == "Pandora failed: no such measure"
    monkeypatch.setattr(
        pandora_intervals, "ENVIRONMENT", pandora_intervals.ROOT / "build" / "is-not-there"
    )
    assert pandora_intervals.missing().startswith("there is no build/is-not-there; make bench")


def test_an_environment_that_cannot_be_made_ends_the_bench_with_the_reason(
    environment, tmp_path, monkeypatch
):
    monkeypatch.setattr(pandora_intervals, "REQUIREMENTS", tmp_path / "absent.txt")
    with pytest.raises(SystemExit, match="Pandora's environment cannot be made: .*absent.txt"):
        pandora_intervals.install()


def test_the_pages_lines_leave_pandora_out_where_it_is_missing(case, monkeypatch):
    """A pair of the first scene of each world; a method that refuses has its row."""
    asked = []
    monkeypatch.setattr(pairs, "rectified_cases", lambda names: asked.extend(names) or [case])
    monkeypatch.setattr(pandora_intervals, "missing", lambda: "it is not asked here")

    def refuse(*_):
        raise MatchingError("nothing matched")

    monkeypatch.setattr(interval_maps.Joint, "map", refuse)
    scenes = [SceneName(w, s) for w in ("street", "plain") for s in (1, 2)]
    lines = pairs.measure_pairs(scenes)
    assert [str(n) for n in asked] == ["street 1", "plain 1"]
    assert any(line.startswith("| walls | `joint` | refused: nothing matched |") for line in lines)
    assert not any("| Pandora |" in line for line in lines)
    assert lines[-1] == "Pandora is left out: it is not asked here."
    (sgbm,) = [line for line in lines if line.startswith("| walls | SGBM |")]
    assert float(sgbm.split("|")[5].strip()[:-1]) > 80.0  # within 3 %: two textured walls


@pytest.mark.slow
def test_pandora_itself_on_a_drawn_pair():
    """Where its environment was made: what it answers is right, and its intervals hold the
    truth."""
    why_not = pandora_intervals.missing()
    if why_not is not None:
        pytest.skip(why_not)
    pair = rectified.drawn(SceneName("street", 3), (320, 240))
    (row,) = pair_rows(pair, {"Pandora": pandora_intervals.pandora_on(pair)})
    assert not row.failed and row.figures["answered"] > 0.5
    assert row.figures["within_3"] > 0.6 and row.figures["inside"] > 0.9
