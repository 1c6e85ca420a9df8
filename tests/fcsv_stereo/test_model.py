# SPDX-License-Identifier: Apache-2.0
"""What methods take and give back: a configuration out of two poses, and what the model's modules
promise."""

import doctest
import json
from dataclasses import replace

import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, given, picture

from fcsv_stereo.errors import InputError
from fcsv_stereo.in_flight.live import MapStage
from fcsv_stereo.joint import JointOptions
from fcsv_stereo.model import (
    AXES,
    Axis,
    Configuration,
    MapInput,
    Pair,
    Reference,
    configuration,
    inputs,
)
from fcsv_stereo.pipeline import DEFAULT_METHOD, METHODS
from fcsv_stereo.refinement import KnownFeatures
from fcsv_stereo.thesis import ThesisOptions


@pytest.mark.parametrize("module", [configuration, inputs])
def test_examples(module):
    done = doctest.testmod(module)
    assert done.attempted and not done.failed


@pytest.mark.parametrize(
    "xyz, axis, baseline_m",
    [
        ([0.3, -2.0, 0.5], "horizontal", 2.0833),
        ([0.0, 0.4, 1.0], "vertical", 1.0770),
        ([0.0, 0.7, -0.7], "horizontal", 0.9899),
    ],
)
def test_a_configuration_of_two_poses(xyz, axis, baseline_m):
    """The reference's image plane decides, not home's axes: a reference rolled by 90 degrees swaps
    them."""
    found = Configuration.between(camera_pose([0, 0, 0]), camera_pose(xyz))
    assert (
        found.axis == axis
        and found.baseline_m == pytest.approx(baseline_m, abs=1e-4)
        and found.tilt_rad == 0.0
    )
    if abs(xyz[1]) != abs(xyz[2]):
        rolled = Configuration.between(camera_pose([0, 0, 0], (90.0, 0.0, 0.0)), camera_pose(xyz))
        assert {found.axis, rolled.axis} == {"horizontal", "vertical"}


def test_a_reference_is_its_picture():
    p = picture("uav1/0", "uav1", 10.0, camera_pose([0, 0, 0]))
    reference = Reference.of(p)
    assert reference.image is p.image and reference.camera == CAMERA and reference.is_level
    assert (reference.name, reference.vehicle, reference.stamp_s) == ("uav1/0", "uav1", 10.0)
    assert np.array_equal(reference.T_home_cam, p.T_home_cam)


def test_methods_say_what_they_take_and_can_do():
    assert DEFAULT_METHOD == "joint" and list(METHODS) == ["joint", "thesis"]
    for name, options in (("joint", JointOptions), ("thesis", ThesisOptions)):
        method = METHODS[name]
        assert method.name == name and method.options is options
        for each in (method.quick, method.monitor, method.with_depth_steps(options(), 64)):
            assert isinstance(each, options) and each != options()


def test_a_method_remembers_and_trusts_where_it_can():
    joint, thesis, known = METHODS["joint"], METHODS["thesis"], KnownFeatures()
    assert joint.refines_poses and not thesis.refines_poses
    assert joint.remembering(joint.quick, known).refinement.known is known
    assert joint.remembering(joint.quick, known).matching == joint.quick.matching
    assert not joint.trusting_poses(joint.monitor).refine_poses
    assert [joint.monitor.scale_of(w * h) for w, h in ((160, 120), (640, 480), (1280, 960))] == [
        1.0,
        1.0,
        0.5,
    ]
    assert joint.matches_bars and joint.with_bars(joint.monitor) == replace(
        joint.monitor, bars=True
    )
    options = ThesisOptions()
    assert (
        thesis.remembering(options, known) is options and thesis.trusting_poses(options) is options
    )
    assert not thesis.matches_bars and thesis.with_bars(options) is options


@pytest.mark.parametrize("method", METHODS)
def test_pairs_of_both_methods_have_one_interface(method):
    """Names and types of everything that ``Pair`` documents: no reader has to ask for a class."""
    size = (CAMERA.height, CAMERA.width)
    scene = given(((0, -0.6, 0), "horizontal"), ((0, 0, 0.8), "vertical"))
    result = METHODS[method].map(scene)
    assert len(result.pairs) == 2
    for p, c in zip(result.pairs, scene.configurations):
        assert p.configuration == c.configuration and p.camera_other == CAMERA
        assert (p.reference_name, p.other_name) == (c.references[0].name, c.others[0].name)
        assert p.T_home_cam_reference.shape == p.T_home_cam_other.shape == (4, 4)
        for image in (p.depth, p.disparity):
            assert image.shape == size and image.dtype == np.float32
        for image in (p.reference_rectified, p.other_rectified):
            assert image.shape == (*size, 3) and image.dtype == np.uint8
        assert p.shares_depth is (method == "joint")
        assert 0.0 < p.match_rate <= 1.0 and p.effective_range_m[0] <= p.effective_range_m[1]
        assert [n for n, _ in p.candidates] == [p.other_name]
        documented = {n for n in vars(Pair) if not n.startswith("_")}
        assert all(hasattr(p, n) for n in documented)
        known = np.isfinite(p.depth)
        assert not p.shares_depth or np.array_equal(p.depth[known], result.depth[known])


def test_words_are_themselves_on_files_and_refuse_others():
    c = Configuration("vertical", 2.0)
    assert (
        c.axis is Axis.VERTICAL
        and c.axis == "vertical"
        and f"{c.axis} {c.axis:>9}" == "vertical  vertical"
    )
    assert json.dumps([Axis.HORIZONTAL]) == '["horizontal"]' and {"vertical": 1}[c.axis] == 1
    assert AXES == ("horizontal", "vertical") and [a.coordinate for a in Axis] == [0, 1]
    with pytest.raises(InputError, match="Axis: 'diagonal' is not one of horizontal, vertical"):
        Configuration("diagonal", 2.0)
    with pytest.raises(
        InputError, match="Rectification: 'level' is not one of home, decoupled, bouguet"
    ):
        ThesisOptions(rectifier="level")
    with pytest.raises(InputError, match="InputKind: 'film'"):
        MapInput("film", [])
    # as in MapState.msg
    assert {str(s) for s in MapStage} == {"waiting", "mapping", "partial", "ready", "failed"}
