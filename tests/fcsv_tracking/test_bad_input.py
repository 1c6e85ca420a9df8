# SPDX-License-Identifier: Apache-2.0
"""What must not become a pose: tags and calibrations that are wrong, each rejected with a reason
and counted."""

import dataclasses

import numpy as np
import pytest
from support.simulated_column import Column
from support.tag_pictures import CAMERA, pose, render

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.trials.formation import Formation, FormationParameters
from fcsv_tracking.column.calibration import calibrate_link
from fcsv_tracking.devices.clocks import ClockExchange, ClockOffset, difference, in_words
from fcsv_tracking.errors import CalibrationRefused, TagError
from fcsv_tracking.tags import TagDetector, corner_points


def test_two_tags_with_one_id_are_neither():
    """Which of them is the vehicle's cannot be known."""
    detector = TagDetector({1: 0.16})
    left, right = render(pose(2.5, x=-0.4)), render(pose(2.5, x=0.4))
    both = np.concatenate([left[:, :320], right[:, 320:]], axis=1)
    assert len(detector.detect(left, CAMERA)) == 1
    assert detector.detect(both, CAMERA) == [] and detector.rejected == {"same id twice": 2}


def test_other_ids_are_counted():
    detector = TagDetector({2: 0.16})
    assert detector.detect(render(pose(2.0)), CAMERA) == [] and detector.rejected == {
        "unknown id": 1
    }


def test_a_picture_of_another_size_than_camera_info_is_refused():
    half = PinholeCamera.from_fov(320, 240, np.radians(56.0))
    with pytest.raises(TagError, match="picture is 640x480, camera_info is of 320x240"):
        TagDetector({1: 0.16}).detect(render(pose(2.0)), half)


def test_a_tag_that_is_bent_is_rejected_and_counted():
    """One corner a sixth of the edge out of its place: no plane has such corners."""
    detector = TagDetector({1: 0.16})
    (seen,) = detector.detect(render(pose(1.5)), CAMERA)
    corners = seen.corners_px.copy()
    corners[0] += [seen.edge_px / 6, seen.edge_px / 12]
    from fcsv_tracking.tags import observation

    bent = observation(1, 0.16, corners, CAMERA)
    assert detector._good([bent, seen], 2) == [seen] and detector.rejected == {"not square": 1}


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.25, 2.0])
def test_a_wrong_focal_length_or_tag_size_is_refused_or_inside_its_sigma(factor):
    """Right or absent, never wrong with a small covariance: the sway of the vehicle in front gives
    the scale away."""
    for seed in range(3):
        column = Column(40 + seed)
        detections = [dataclasses.replace(d, size_m=d.size_m * factor) for d in column.detections()]
        try:
            link = calibrate_link("uav1", "uav2", detections)
        except CalibrationRefused:
            continue
        error_m, _ = column.relative_pose_error(link.T_parent_child)
        assert error_m < 3 * np.sqrt(np.trace(link.covariance[:3, :3])), (factor, seed, error_m)


def test_a_mirrored_odometry_is_refused():
    """The parent's odometry with y mirrored, as by a driver with the wrong convention."""
    column = Column(50)
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    detections = [
        dataclasses.replace(d, T_odom_tag=mirror @ d.T_odom_tag @ mirror)
        for d in column.detections()
    ]
    with pytest.raises(CalibrationRefused):
        calibrate_link("uav1", "uav2", detections)


def test_not_seen_and_oblique_are_named():
    with pytest.raises(CalibrationRefused, match="uav2 does not see uav1's tag"):
        calibrate_link("uav1", "uav2", [])
    with pytest.raises(CalibrationRefused, match="deg off its normal"):
        calibrate_link("uav1", "uav2", _oblique())


def _oblique():
    """The tag turned by 65 degrees: T_body_tag as the file has it, the truth otherwise."""
    column = Column(51)
    turn = transforms.from_xyz_yaw(np.zeros(3), np.radians(65.0))
    found = []
    for t_s in np.arange(0, 8, 0.2):
        T_world_D1, T_world_D2 = column.bodies(t_s)
        T_world_D1 = T_world_D1 @ turn
        T_cam_tag = (
            transforms.invert(T_world_D2 @ column.back.T_body_cam)
            @ T_world_D1
            @ column.front.T_body_tag
        )
        p = transforms.apply(T_cam_tag, corner_points(0.16))
        corners = p[:, :2] / p[:, 2:] + column.random.normal(0, 0.1 / 601.8, (4, 2))
        T_O1_D1 = column.noisy(transforms.invert(column.T_world_O1) @ T_world_D1)
        T_O2_D2 = column.noisy(transforms.invert(column.T_world_O2) @ T_world_D2)
        found.append(
            dataclasses.replace(
                column.detection(t_s),
                corners_normalized=corners,
                T_odom_tag=T_O1_D1 @ column.front.T_body_tag,
                T_odom_cam=T_O2_D2 @ column.back.T_body_cam,
            )
        )
    return found


@pytest.mark.parametrize("late_s", [0.02, 0.05, 0.1, 0.3])
def test_clocks_that_differ_unknown_to_the_calibration(late_s):
    """The parent's odometry comes late while it sways, and nobody measured it: refused, or inside
    three sigma; the link model has the clocks' difference among its errors."""
    for seed in range(4):
        flight = Formation(seed, FormationParameters())
        detections = [
            dataclasses.replace(
                d,
                T_odom_tag=flight.states[0].at(d.stamp_s + late_s) @ flight.vehicles[0].T_body_tag,
            )
            for d in flight.detections(1, 0)
            if d.stamp_s + late_s < flight.end_s
        ]
        try:
            link = calibrate_link("uav1", "uav2", detections)
        except CalibrationRefused:
            continue
        estimated, true = flight.relative({"uav2": link.T_parent_child}, 1)
        assert np.linalg.norm((estimated - true)[:3, 3]) < 3 * np.sqrt(
            np.trace(link.covariance[:3, :3])
        ), seed


class TestClocks:
    def exchange(self, offset_s, delays, seed=0):
        random, exchange = np.random.default_rng(seed), ClockExchange()
        for i, (there_s, back_s) in enumerate(delays):
            sent_s = 1000.0 + i
            received_s = sent_s + there_s + offset_s
            answered_s = received_s + random.uniform(0, 0.002)
            exchange.add(sent_s, received_s, answered_s, answered_s - offset_s + back_s)
        return exchange

    @pytest.mark.parametrize("offset_s", [-3.0, 0.0, 0.04])
    def test_the_offset_is_inside_its_uncertainty(self, offset_s):
        delays = np.random.default_rng(1).exponential(0.02, (40, 2)) + 0.002
        offset = self.exchange(offset_s, delays).offset()
        assert abs(offset.offset_s - offset_s) <= offset.uncertainty_s < 0.02
        assert offset.beyond(0.02) == (abs(offset_s) > 0.03)

    def test_a_clock_that_is_set_is_followed_at_once(self):
        exchange = self.exchange(0.0, [(0.01, 0.01)] * 10)
        assert exchange.add(2000.0, 2005.01, 2005.01, 2000.02)
        assert exchange.offset().offset_s == pytest.approx(5.0, abs=0.001)

    @pytest.mark.parametrize(
        "stamps",
        [
            (10.0, 10.0, 9.0, 10.1),
            (10.0, float("nan"), 10.0, 10.1),
            (10.0, 0.0, 0.0, 10.1),
            (10.0, 10.0, 10.5, 10.1),
            (10.0, 11.0, 11.0, 20.0),
        ],
    )
    def test_what_is_no_exchange_is_rejected_and_counted(self, stamps):
        exchange = ClockExchange()
        assert not exchange.add(*stamps) and exchange.rejected == 1 and exchange.offset() is None

    def test_words_and_differences(self):
        ahead = ClockOffset(1.0, 0.35, 0.001)
        assert "uav2's clock is 0.350 s ahead" in in_words("uav2", ahead) and "chrony" in in_words(
            "uav2", ahead
        )
        assert difference(ahead, None) is None
        assert difference(ahead, ClockOffset(1.0, 0.05, 0.002)) == pytest.approx((0.3, 0.003))
