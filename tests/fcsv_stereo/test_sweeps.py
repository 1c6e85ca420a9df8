# SPDX-License-Identifier: Apache-2.0
"""Sweeps: which pictures a map takes of a camera that moves all the time, and the clock offset that
they show."""

import doctest
from dataclasses import replace

import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, photograph
from support.sessions import T0, Moving, write_session

from fcsv_geometry import transforms
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo import pipeline
from fcsv_stereo.model import Axis, Configuration, ConfigurationInput, Picture
from fcsv_stereo.sessions import read_session
from fcsv_stereo.sweeps import choice, clock, clock_offset, moves, spread

GREY = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
HZ = 6.0
R_FLU_OPTICAL = transforms.R_FLU_OPTICAL


def seen(vehicle, stamp_s, xyz, rpy_deg=(0.0, 0.0, 0.0), name=None):
    return Picture(
        f"{vehicle}/{stamp_s:.3f}", vehicle, stamp_s, GREY, CAMERA, camera_pose(xyz, rpy_deg)
    )


def swept(places, begin_s=0.0, rpy_deg=lambda k: (0.0, 0.0, 0.0), name="sweep"):
    """A recording in which uav2 is at these places, one picture after the other."""
    stamps = [begin_s + k / HZ for k in range(len(places))]
    others = [seen("uav2", t, xyz, rpy_deg(k)) for k, (t, xyz) in enumerate(zip(stamps, places))]
    references = [seen("uav1", t, (0.0, 0.0, 0.0)) for t in stamps]
    return ConfigurationInput(Configuration(Axis.HORIZONTAL, 8.0, name=name), references, others)


def line(start, end, number=40):
    return [tuple(p) for p in np.linspace(start, end, number)]


RIGHT, UP = line((0, -2, 0), (0, -8, 0)), line((0, -8, 0), (0, -8, 7))


# ---- which pictures ------------------------------------------------------------------------------


def test_baselines_grow_in_equal_ratios_and_end_with_the_longest():
    found = spread([swept(RIGHT)])
    baselines_m = [c.configuration.baseline_m for c in found]
    assert baselines_m[0] == pytest.approx(2.0) and baselines_m[-1] == pytest.approx(8.0)
    assert all(1.25 < b / a < 1.6 for a, b in zip(baselines_m, baselines_m[1:])) and len(found) == 5
    assert found[1].configuration.name == f"sweep: {baselines_m[1]:.1f} m"
    for c in found:  # each with its own pose, and reference pictures of its moment
        (other,) = c.others
        assert len(c.references) == 3
        assert min(abs(r.stamp_s - other.stamp_s) for r in c.references) < 1e-9


def test_the_other_way_round_gives_the_same_baselines():
    forth, back = spread([swept(RIGHT)]), spread([swept(RIGHT[::-1])])
    lengths = [[round(c.configuration.baseline_m, 6) for c in found] for found in (forth, back)]
    assert lengths[0] == lengths[1]


def test_two_sweeps_share_the_place_where_they_meet():
    found = spread([swept(RIGHT), swept(UP, 10.0, name="up")])
    up = [c for c in found if c.configuration.name.startswith("up")]
    heights_m = [c.others[0].T_home_cam[2, 3] for c in up]
    assert heights_m[0] > 2.0 and heights_m[-1] == pytest.approx(7.0), (
        "the corner is the first sweep's last picture"
    )


def test_who_stands_is_left_alone_and_the_whole_is_bounded():
    still = swept([(0, -4, 0.01 * k) for k in range(12)])
    assert not moves(still) and spread([still]) == [still]
    assert not moves(replace(still, others=still.others[:1]))
    many = [swept(line((0, -2, h), (0, -50, h)), 100.0 * h) for h in range(4)]
    assert len(spread([still, *many])) <= 9 and spread([still, *many])[0] is still


def test_of_pictures_about_a_step_away_the_sharpest_is_taken():
    jolted = {k: (0.0, 0.0, 1.5 if k in (11, 12, 13) else 0.0) for k in range(40)}
    found = spread([swept(RIGHT, rpy_deg=lambda k: jolted[k])])
    taken = {c.others[0].stamp_s for c in found}
    # between a picture that is turned and one that is not
    shaken = {k / HZ for k in (10, 11, 13, 14)}
    assert not taken & shaken


def test_pictures_that_look_elsewhere_serve_only_where_nothing_else_is_left():
    away = swept(RIGHT, rpy_deg=lambda k: (0.0, 0.0, 80.0 if k > 25 else 0.0))
    found = spread([away])
    assert max(c.configuration.baseline_m for c in found) == pytest.approx(
        RIGHT[24][1] * -1.0, abs=0.2
    )
    blind = swept(RIGHT, rpy_deg=lambda k: (0.0, 0.0, 80.0))
    assert len(spread([blind])) >= 4, "the map says that they do not overlap"


def test_overlap_is_what_both_see():
    reference = seen("uav1", 0.0, (0, 0, 0))
    assert choice.overlap(reference, reference) == 1.0
    assert choice.overlap(reference, seen("uav2", 0.0, (0, 0, 0), (0, 0, 180.0))) == 0.0
    assert 0.4 < choice.overlap(reference, seen("uav2", 0.0, (0, -10.5, 0))) < 0.62, (
        "half of 21 m at 20 m"
    )


# ---- what time they are of -----------------------------------------------------------------------


def pose(t_s, moving=True):
    """T_odom_body of a vehicle that flies aside at 1.5 m/s, leans as gusts want, and vibrates by
    0.1 degrees."""
    lean = 1.2 * np.array([np.sin(2.1 * t_s), np.sin(1.7 * t_s + 1.0), 0.5 * np.sin(0.9 * t_s)])
    shake = 0.08 * np.array(
        [
            [np.sin(2 * np.pi * hz * t_s + phase + k) for k in range(3)]
            for hz, phase in ((23.0, 0.0), (31.0, 2.0), (47.0, 4.0))
        ]
    ).sum(0)
    aside_m = -1.5 * t_s if moving else 0.01 * np.sin(t_s)
    return transforms.from_xyz_rpy([0.0, aside_m + 4.0 * moving, 0.0], np.radians(lean + shake))


def flight(offset_s, seconds=5.0, noise_deg=0.01, moving=True):
    """Pictures whose stamps are ``offset_s`` too early, with the prior that follows from them, and
    the track."""
    random = np.random.default_rng(4)
    track = Trajectory()
    for t_s in np.arange(-0.5, seconds + 0.5, 0.005):
        noise = np.radians(noise_deg) * random.standard_normal(3)
        track.add(t_s, pose(t_s, moving) @ transforms.from_xyz_rpy([0, 0, 0], noise))
    T_body_cam = transforms.transform(R_FLU_OPTICAL, np.zeros(3))
    pictures = []
    for stamp_s in np.arange(0.0, seconds, 1.0 / HZ):
        image = photograph(pose(stamp_s + offset_s, moving) @ T_body_cam)
        T = track.at(stamp_s) @ T_body_cam
        pictures.append(Picture(f"uav2/{stamp_s:.3f}", "uav2", stamp_s, image, CAMERA, T))
    return pictures, track


@pytest.mark.parametrize(
    "offset_s, moving", [(0.005, True), (-0.012, True), (0.0, False), (0.005, False)]
)
def test_an_offset_is_found_to_a_millisecond(offset_s, moving):
    found = clock_offset(*flight(offset_s, moving=moving), R_FLU_OPTICAL)
    assert found.known and found.sigma_s < 0.001
    assert abs(found.offset_s - offset_s) < max(3.0 * found.sigma_s, 0.0007)


def test_an_offset_that_cannot_be_seen_is_not_told():
    pictures, track = flight(0.005)
    blank = [replace(p, image=np.full_like(p.image, 90)) for p in pictures]
    assert clock_offset(blank, track, R_FLU_OPTICAL) is None
    assert clock_offset(pictures[:5], track, R_FLU_OPTICAL) is None
    assert clock_offset(pictures, Trajectory(), R_FLU_OPTICAL) is None
    rare = Trajectory()
    for t_s in np.arange(-0.5, 5.5, 0.1):
        rare.add(t_s, pose(t_s))
    assert clock_offset(pictures, rare, R_FLU_OPTICAL) is None, (
        "ten poses a second do not show a vibration"
    )
    still = Trajectory()
    for t_s in np.arange(-0.5, 5.5, 0.005):
        still.add(t_s, np.eye(4))
    lost = clock_offset(pictures, still, R_FLU_OPTICAL)
    assert lost is None or not lost.known


def test_a_session_with_a_sweep_is_mapped_from_its_pictures_at_the_trackers_time(tmp_path):
    """uav2 flies from 1 to 4 m aside in 3 s; its tracker's clock is 5 ms late against its
    camera's."""

    def at(vehicle, t_s):
        T_home_body = pose(t_s + 3.0 * (vehicle == "uav2"), moving=False)
        T_home_body[:3, 3] = (0.0, -1.0 - t_s, 0.0) if vehicle == "uav2" else np.zeros(3)
        return T_home_body @ transforms.transform(R_FLU_OPTICAL, np.zeros(3))

    moving = Moving(at, 3.0, 2.0 * HZ, tracker_late_s=0.005)
    given = read_session(write_session(tmp_path / "s", window=(T0 - 0.1, T0 + 3.1), moving=moving))
    lengths_m = [c.configuration.baseline_m for c in given.configurations]
    assert (
        lengths_m == sorted(lengths_m)
        and lengths_m[0] < 1.05
        and lengths_m[-1] > 3.8
        and len(lengths_m) >= 4
    )
    assert given.clocks["uav2"].known and given.clocks["uav2"].offset_s == pytest.approx(
        0.005, abs=0.001
    )
    assert any(
        "uav2: its camera's stamps and its tracker's differ by +" in w for w in given.warnings
    )
    for c in given.configurations:
        for p in (*c.references, *c.others):
            true = at(p.vehicle, p.stamp_s - T0)
            assert np.linalg.norm(p.T_home_cam[:3, 3] - true[:3, 3]) < 0.002, (
                "5 ms at 1 m/s are 5 mm"
            )
            # on each axis interpolation between samples of 5 ms takes 0.26 of 0.08 degrees at 47
            # Hz, 0.12 at 31 Hz
            assert transforms.rotation_angle(p.T_home_cam, true) < np.radians(
                np.sqrt(3.0) * 0.38 * 0.08
            )
    document = pipeline.run(pipeline.MapRequest(tmp_path / "s", tmp_path / "map", "joint"))
    assert document["time_offsets"]["uav2"]["offset_ms"] == pytest.approx(5.0, abs=1.0)
    assert "time offset of uav2" in (tmp_path / "map" / "report.html").read_text()


def test_examples():
    for module in (choice, clock):
        assert doctest.testmod(module).failed == 0
