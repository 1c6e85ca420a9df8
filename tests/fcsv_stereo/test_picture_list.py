# SPDX-License-Identifier: Apache-2.0
"""What a report says of its pictures: what a pixel covers, on which pictures the map rests, and why
not on others."""

import doctest
from dataclasses import replace

import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, given, picture

from fcsv_geometry import transforms
from fcsv_stereo import pipeline
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.evaluating import ground_sample
from fcsv_stereo.evaluating.ground_sample import GroundSample
from fcsv_stereo.joint.method import _unfit_to_match
from fcsv_stereo.joint.tuning import PAIRS
from fcsv_stereo.map_files import output
from fcsv_stereo.map_files.picture_list import picture_list, spare
from fcsv_stereo.model import PoseUncertainty
from fcsv_stereo.refinement import RefinedPicture
from fcsv_stereo.report import write_report
from fcsv_stereo.thesis import ThesisOptions, map_thesis


@pytest.fixture(scope="module")
def scene():
    return given(((0, -0.5, 0), "horizontal"), ((0, -0.8, 0), "horizontal"))


@pytest.fixture(scope="module")
def result(scene):
    return map_thesis(scene, ThesisOptions(threshold=ErrorThreshold(5.0, False)), lambda *_: None)


def test_a_pixel_covers_what_its_rays_span(result):
    assert doctest.testmod(ground_sample).failed == 0
    found = GroundSample.of(result)
    median_m = float(np.nanmedian(result.depth))
    rays = CAMERA.rays()[120, 160:162] * median_m  # of two neighbours in the picture's middle
    assert found.at_m(found.median_depth_m) == pytest.approx(
        np.linalg.norm(rays[1] - rays[0]), rel=1e-6
    )
    assert (median_m, found.at_m(median_m)) in found.table() and len(found.table()) == 8
    nothing = GroundSample.of(replace(result, depth=np.full_like(result.depth, np.nan)))
    assert nothing.to_dict()["at_median_m"] is None and len(nothing.table()) == 7


def test_every_picture_has_its_role_and_its_shift(result):
    turned = transforms.from_xyz_rpy([0.0, 0.0, 0.3], np.radians([0.5, 0.0, 0.0]))
    images = [
        i
        if i.name != "uav2/1"
        else replace(
            i, T_home_cam=i.prior_T_home_cam @ turned, refined=True, left_out="it is blurred"
        )
        for i in result.images
    ]
    found = {p.name: p for p in picture_list(replace(result, images=images))}
    assert (
        list(found)[0] == result.reference.name and found[result.reference.name].role == "reference"
    )
    assert found[result.reference.name].configurations == ("horizontal 0", "horizontal 1")
    moved = found["uav2/1"]
    assert (moved.role, moved.configurations, moved.used, moved.why_not) == (
        "other",
        ("horizontal 1",),
        False,
        "it is blurred",
    )
    assert moved.turned_deg == pytest.approx(0.5, abs=1e-6) and moved.moved_m == pytest.approx(
        0.3, abs=1e-9
    )
    assert (
        found["uav2/0"].used and found["uav2/0"].why_not is None and found["uav2/0"].moved_m == 0.0
    )


def test_pictures_that_a_map_did_not_need_are_counted(scene, result):
    first = scene.configurations[0]
    more = [*first.others, picture("uav2/7", "uav2", 10.2, camera_pose([0, -0.5, 0]))]
    assert spare(scene, result) == {}
    assert spare(replace(scene, configurations=[replace(first, others=more)]), result) == {
        "uav2": 1
    }


def test_report_and_page_have_the_list(scene, result, tmp_path):
    images = [
        replace(i, left_out="<b>blurred</b>") if i.name == "uav2/1" else i for i in result.images
    ]
    shown = replace(result, images=images, spare={"uav2": 17})
    document = output.report_document(shown)
    assert [p["name"] for p in document["pictures"]] == ["uav1/0", "uav2/0", "uav2/1"]
    assert document["pictures"][2]["why_not"] == "<b>blurred</b>" and document[
        "spare_pictures"
    ] == {"uav2": 17}
    assert document["ground_sample"]["m_per_px_at_1_m"] == pytest.approx(1.0 / CAMERA.fx)
    text = write_report(shown, tmp_path).read_text()
    assert (
        "no: &lt;b&gt;blurred&lt;/b&gt;" in text
        and "17 of uav2" in text
        and "(median of the map)" in text
    )


def test_the_command_counts_what_a_recording_holds_beyond(scene, tmp_path, monkeypatch):
    first = scene.configurations[0]
    more = [*first.others, picture("uav2/7", "uav2", 10.2, camera_pose([0, -0.5, 0]))]
    monkeypatch.setattr(
        pipeline,
        "load",
        lambda path, reference, view: replace(scene, configurations=[replace(first, others=more)]),
    )
    options = ThesisOptions(threshold=ErrorThreshold(5.0, False))
    document = pipeline.run(pipeline.MapRequest(tmp_path, tmp_path / "out", "thesis", options))
    assert document["spare_pictures"] == {"uav2": 1} and len(document["pictures"]) == 2


def refined_or_not(name, refined, off_px):
    covariance = np.eye(6) * (off_px / CAMERA.fx) ** 2
    p = picture(name, "uav2", 10.0, camera_pose([0, -0.5, 0]))
    return RefinedPicture(
        p, p.T_home_cam, refined, "few matches", 0, 1.0, 1.0, PoseUncertainty(covariance)
    )


def test_who_is_too_far_off_is_left_out_with_its_reason():
    far_px = PAIRS.most_pose_off_px(CAMERA.fx) * 2.0
    good, off = refined_or_not("a", True, 0.1), refined_or_not("b", False, far_px)
    assert _unfit_to_match([good, off]) == {
        1: f"its pose is only known to {far_px:.1f} px (few matches)"
    }
    assert _unfit_to_match([off, off]) == {}  # nobody serves in its place
