# SPDX-License-Identifier: Apache-2.0
"""Calibration of neighbouring vehicles (thesis 6.1, corrected) on simulated truth."""

import dataclasses

import numpy as np
import pytest
from support.simulated_column import Column, DriftingColumn

from fcsv_geometry import transforms
from fcsv_geometry.home import home_of, odoms_in_home
from fcsv_tracking.column.calibration import CalibrationRules, calibrate_link, position_std
from fcsv_tracking.column.detection import single_link
from fcsv_tracking.column.link_model import LinkModel, LinkNoise
from fcsv_tracking.errors import CalibrationRefused
from fcsv_tracking.tags import planar_poses

EXACT = {"corner_noise_px": 0.0, "attitude_noise_deg": 0.0, "position_noise_m": 0.0}


def test_equation_6_1_is_exact_without_noise():
    column = Column(0, **EXACT)
    for t in (0.0, 1.7, 5.0):
        T_world_D1, T_world_D2 = column.bodies(t)
        T_cam_tag = (
            transforms.invert(T_world_D2 @ column.back.T_body_cam)
            @ T_world_D1
            @ column.front.T_body_tag
        )
        assert np.allclose(
            single_link(column.detection(t), T_cam_tag), column.true_link(), atol=1e-9
        )


def test_without_noise_the_adjustment_is_exact():
    column = Column(1, **EXACT)
    link = calibrate_link("uav1", "uav2", column.detections())
    assert np.allclose(link.T_parent_child, column.true_link(), atol=1e-5)  # the solver's tolerance
    assert link.rejected == 0 and link.reprojection_rms_px < 1e-3


@pytest.mark.parametrize("there_px, taken_px", [(0.05, 0.05), (0.1, 0.1), (0.4, 0.15)])
def test_corners_are_taken_for_as_sharp_as_they_are_but_no_worse_than_assumed(there_px, taken_px):
    column = Column(3, corner_noise_px=there_px)
    model, T = LinkModel(column.detections(), LinkNoise(corner_noise_px=0.15)), column.true_link()
    x = np.array([*transforms.apply(T, model.mean_Oc_C), transforms.yaw(T)])
    # five residuals of each of 30 detections and more: known to 6 %; three of them
    assert model.with_measured_corners(x).noise.corner_noise_px == pytest.approx(taken_px, rel=0.18)


def test_figures_over_ten_seeds():
    """Measured 2026-11-24: median 0.011 m, 0.11 deg, worst 0.015, 0.29; ten more seeds 0.008, 0.06,
    0.016, 0.18."""
    errors = []
    for seed in range(10):
        column = Column(seed)
        errors.append(
            column.relative_pose_error(
                calibrate_link("uav1", "uav2", column.detections()).T_parent_child
            )
        )
    errors = np.array(errors)
    assert (np.median(errors, axis=0) <= [0.014, 0.14]).all(), errors
    assert (errors.max(axis=0) <= [0.02, 0.35]).all(), errors


def test_figures_over_ten_seeds_of_drifting_odometry():
    """The whole simulated T265 (walk, heading, scale, level, noise), four quick sways.

    Measured 2026-11-24: median 0.014 m, 0.16 deg, worst 0.023 m, 0.30 deg; ten more seeds 0.014,
    0.20, 0.019, 0.47. The walk sets the yaw: 0.2 deg (1 sigma) is the best that 8 s give, more and
    quicker sways give less.
    """
    errors = []
    for seed in range(10):
        column = DriftingColumn(seed, sway_period_s=5.0)
        errors.append(
            column.relative_pose_error(
                calibrate_link("uav1", "uav2", column.detections()).T_parent_child
            )
        )
    errors = np.array(errors)
    assert (np.median(errors, axis=0) <= [0.018, 0.2]).all(), errors
    assert (errors.max(axis=0) <= [0.03, 0.4]).all(), errors


@pytest.mark.parametrize("kind, least", [(Column, 0.1), (DriftingColumn, 0.3)])
def test_covariance_covers_the_error(kind, least):
    """Normalised yaw error over seeds: mean square near one (chi square of 20, 99.9 % within 0.3 to
    2.3).

    Below where there is none of the drift that is assumed.
    """
    normalised = []
    for seed in range(20):
        column = kind(100 + seed)
        link = calibrate_link("uav1", "uav2", column.detections())
        error = transforms.yaw(link.T_parent_child @ transforms.invert(column.true_link()))
        normalised.append(error**2 / link.covariance[3, 3])
    assert least < np.mean(normalised) < 2.3, normalised


def test_jacobian_of_the_link_model():
    """Against central differences of 1e-6: exact to their rounding."""
    detections = Column(8).detections(1.0)
    model = LinkModel(detections, LinkNoise())
    link = calibrate_link("uav1", "uav2", Column(8).detections()).T_parent_child
    x = np.array([*transforms.apply(link, model.mean_Oc_C), transforms.yaw(link)])
    steps = 1e-6 * np.eye(4)
    numeric = np.stack(
        [(model.residuals(x + s) - model.residuals(x - s)) / 2e-6 for s in steps], axis=-1
    )
    assert np.allclose(model.jacobian(x), numeric, rtol=1e-5, atol=1e-3)


def test_detections_that_do_not_agree_are_refused():
    column, random = Column(9), np.random.default_rng(9)
    detections = [
        dataclasses.replace(d, corners_normalized=d.corners_normalized + random.normal(0, 0.3, 2))
        for d in column.detections()
    ]
    with pytest.raises(CalibrationRefused, match="uav2 sees uav1's tag, but only .* agree"):
        calibrate_link("uav1", "uav2", detections)


def test_outliers_are_rejected_and_counted():
    column = Column(3)
    detections = column.detections()
    for i in (4, 11, 23):
        detections[i] = dataclasses.replace(
            detections[i], corners_normalized=detections[i].corners_normalized + 0.05
        )
    link = calibrate_link("uav1", "uav2", detections)
    assert link.rejected >= 3 and column.relative_pose_error(link.T_parent_child)[1] < 0.5


def test_flipped_normals_do_not_matter():
    """A square-on tag has two poses that look alike; the link must not depend on which was
    chosen."""
    column = Column(4, sway_m=0.8)
    flips = sum(len(planar_poses(d.corners_normalized, 0.16)) > 1 for d in column.detections())
    assert flips > 10
    assert (
        column.relative_pose_error(
            calibrate_link("uav1", "uav2", column.detections()).T_parent_child
        )[1]
        < 0.5
    )


@pytest.mark.parametrize(
    "column, seconds, word",
    [
        (Column(5), 2.0, "10 usable pictures"),
        (Column(5, sway_m=0.0), 8.0, "sway uav1"),
        (Column(5, distance_m=12.0), 8.0, "come nearer"),
        (Column(5, sway_m=4.0), 8.0, "faster than"),
    ],
)
def test_refusals_tell_the_operator_what_to_do(column, seconds, word):
    with pytest.raises(CalibrationRefused, match=word):
        calibrate_link(
            "uav1", "uav2", column.detections(seconds), CalibrationRules(corner_noise_px=0.4)
        )


def test_position_std_grows_with_the_lever_arm():
    covariance = np.diag([1e-6, 1e-6, 1e-6, np.radians(1.0) ** 2])
    assert position_std(covariance, np.eye(4), np.array([10.0, 0, 0])) == pytest.approx(
        0.1745, rel=0.01
    )


def test_chain_brings_every_vehicle_into_home():
    first, second = Column(6, **EXACT), Column(7, **EXACT)
    link12 = calibrate_link("uav1", "uav2", first.detections())
    link23 = calibrate_link("uav2", "uav3", second.detections())
    T_O1_home = transforms.from_xyz_yaw([1.0, 2.0, 3.0], 0.4)
    homes = odoms_in_home([link23, link12], "uav1", T_O1_home)
    expected = transforms.invert(T_O1_home) @ link12.T_parent_child @ link23.T_parent_child
    assert np.allclose(homes["uav3"], expected)
    # an unknown link is no identity
    assert set(odoms_in_home([link23], "uav1", T_O1_home)) == {"uav1"}


def test_home_is_level_and_looks_where_the_camera_looks():
    T_odom_body = transforms.from_xyz_rpy([1, 2, 3], [0.1, -0.05, 0.7])
    T_odom_home = home_of(T_odom_body @ Column(0).front.T_body_cam)
    assert np.allclose(T_odom_home[2, :3], [0, 0, 1]) and transforms.yaw(
        T_odom_home
    ) == pytest.approx(0.7, abs=0.01)
