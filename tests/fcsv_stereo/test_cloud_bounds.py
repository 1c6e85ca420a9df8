# SPDX-License-Identifier: Apache-2.0
"""Bounds of a cloud: what lies beyond is left out of map.ply and every product, is counted, and
stays in depth.npy."""

import doctest
import json
from dataclasses import replace

import numpy as np
import pytest
from support.scenes import CAMERA, DEPTH_M, given

from fcsv_geometry import transforms
from fcsv_stereo import cli, pipeline
from fcsv_stereo.equations import ErrorThreshold, depth_error
from fcsv_stereo.errors import InputError, OutputError
from fcsv_stereo.map_files import cloud_bounds, output
from fcsv_stereo.map_files.cloud_bounds import CloudBounds, bound_cloud, held_range_m
from fcsv_stereo.thesis import ThesisOptions, map_thesis

BASELINE_M = 0.8


@pytest.fixture(scope="module")
def scene():
    return given(((0, -0.5, 0), "horizontal"), ((0, -BASELINE_M, 0), "horizontal"))


@pytest.fixture(scope="module")
def result(scene):
    """With a sigma that has nothing to do with the depth: up to 40 % of it."""
    found = map_thesis(scene, ThesisOptions(threshold=ErrorThreshold(5.0, False)), lambda *_: None)
    share = np.random.default_rng(3).uniform(0.01, 0.4, len(found.cloud)).astype(np.float32)
    return replace(
        found,
        cloud=replace(found.cloud, sigma_m=share * depth_of(found, found.cloud).astype(np.float32)),
    )


def depth_of(result, cloud):
    return transforms.apply(
        transforms.invert(result.reference.T_home_cam), cloud.points_home_m.astype(float)
    )[:, 2]


def test_examples():
    done = doctest.testmod(cloud_bounds)
    assert done.attempted >= 3 and not done.failed


def test_the_widest_baseline_holds_the_range(result):
    """Where equation 2.12 gives a fifth of the distance for a pixel; the reference looks along x to
    a degree."""
    range_m = held_range_m(result)
    assert depth_error(range_m, BASELINE_M, CAMERA.fx) == pytest.approx(0.2 * range_m, rel=0.001)
    # no baseline at all
    ahead = [replace(p, T_home_cam_other=p.T_home_cam_reference) for p in result.pairs]
    assert (
        held_range_m(replace(result, pairs=ahead)) is None
        and held_range_m(replace(result, pairs=[])) is None
    )


def test_points_beyond_the_bounds_go_and_are_counted(result):
    depth, sigma = depth_of(result, result.cloud), result.cloud.sigma_m
    at_m, share = 16.0, float(np.median(sigma / depth))
    found = bound_cloud(result, CloudBounds(at_m, ErrorThreshold(share, True)))
    far, unsure = depth > at_m, sigma > share * depth
    # else the test says nothing
    assert far.any() and (unsure & ~far).any() and (~far & ~unsure).any()
    assert found.cut.beyond_range == far.sum() and found.cut.beyond_sigma == (unsure & ~far).sum()
    for name in result.cloud.__dataclass_fields__:
        assert np.array_equal(
            getattr(found.cloud, name), getattr(result.cloud, name)[~far & ~unsure]
        )
    assert found.depth is result.depth and found.sigma is result.sigma  # the pixels stay
    metres = bound_cloud(result, CloudBounds(None, ErrorThreshold(float(np.median(sigma)), False)))
    assert (
        metres.cut.beyond_range == 0 and metres.cut.beyond_sigma == (sigma > np.median(sigma)).sum()
    )


def test_a_point_whose_sigma_is_not_known_is_unsure(result):
    sigma = result.cloud.sigma_m.copy()
    sigma[:7] = np.nan
    found = bound_cloud(
        replace(result, cloud=replace(result.cloud, sigma_m=sigma)), CloudBounds(None)
    )
    assert found.cut.beyond_sigma == 7 + int(
        (~(sigma[7:] <= 0.2 * depth_of(result, result.cloud)[7:])).sum()
    )


def test_none_leaves_nothing_out(result):
    found = bound_cloud(result, CloudBounds(None, None))
    assert (
        len(found.cloud) == len(result.cloud)
        and found.cut.beyond_range == found.cut.beyond_sigma == 0
    )
    assert cloud_bounds.in_words(found.cut) == "" and found.warnings == result.warnings


def test_a_cloud_that_loses_everything_is_said(scene, result, tmp_path):
    found = bound_cloud(result, CloudBounds(0.5))
    assert len(found.cloud) == 0 and len(found.warnings) == len(result.warnings) + 1
    assert "the cloud is empty" in found.warnings[-1] and "--cloud-range-m" in found.warnings[-1]
    with pytest.raises(OutputError, match="beyond the cloud's bounds"):
        pipeline.write_products(["pcd"], found, scene, tmp_path)


@pytest.mark.parametrize(
    "range_m, sigma, words",
    [
        ("far", None, "--cloud-range-m 'far'"),
        ("0", None, "--cloud-range-m '0'"),
        ("-5", None, "--cloud-range-m '-5'"),
        ("nan", None, "--cloud-range-m 'nan'"),
        ("auto", "120%", "--cloud-sigma '120%'"),
        ("auto", "x", "--cloud-sigma 'x'"),
    ],
)
def test_bounds_that_are_none_are_refused_by_name(range_m, sigma, words):
    with pytest.raises(InputError, match=words.replace("(", "\\(")):
        CloudBounds.of_words(range_m, sigma)


def test_the_command_bounds_the_cloud_and_every_product(scene, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(pipeline, "load", lambda path, reference, view: scene)
    near_m = (DEPTH_M + 12.0) / 2
    sizes = {}
    for name, words in (("all", ("none", "none")), ("near", (f"{near_m}", "none"))):
        out = tmp_path / name
        arguments = [
            str(tmp_path),
            "-o",
            str(out),
            "--method",
            "thesis",
            "--error",
            "5",
            "--products",
            "pcd,laz",
        ]
        assert cli.main([*arguments, "--cloud-range-m", words[0], "--cloud-sigma", words[1]]) == 0
        document = json.loads((out / "report.json").read_text())
        sizes[name] = len(output.read_ply(out / "map.ply"))
        assert sizes[name] == document["points"]
        assert f"POINTS {sizes[name]}\n".encode() in (out / "map.pcd").read_bytes()[:400]
        said = capsys.readouterr().out
        left = document["cloud"]["beyond_range"]
        assert (f"left out of the cloud: {left} points too far, 0 too unsure" in said) == (
            name == "near"
        )
        assert ("left out of the cloud" in (out / "report.html").read_text()) == (name == "near")
        assert left == sizes["all"] - sizes[name] and document["cloud"]["sigma_share"] is None
    assert 0 < sizes["near"] < sizes["all"]
    same = [np.load(tmp_path / name / "depth.npy") for name in sizes]
    assert np.array_equal(*same, equal_nan=True)
    points = output.read_ply(tmp_path / "near" / "map.ply").points_home_m
    # the reference camera stands at home and looks along x, to a degree
    assert points[:, 0].max() < near_m + 0.5


def test_the_command_refuses_bounds_that_are_none(tmp_path, capsys):
    assert cli.main([str(tmp_path), "-o", str(tmp_path / "out"), "--cloud-sigma", "a lot"]) == 2
    assert "--cloud-sigma 'a lot' is not understood" in capsys.readouterr().err
