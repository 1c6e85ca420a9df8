# SPDX-License-Identifier: Apache-2.0
"""Matched points of two pictures against where trackers say that the cameras are."""

from dataclasses import replace

import numpy as np
import pytest
from support.photographs import fountain
from support.scenes import camera_pose, picture

from fcsv_geometry import transforms
from fcsv_sim.sensors.pair_scene import FOCAL_PX, NOISE_PX, MatchedScene
from fcsv_sim.sensors.scene import SimulatedScene
from fcsv_stereo.in_flight.pair_check import PairRules, PairsToLookAt, compare, look
from fcsv_stereo.model import LivePicture
from fcsv_stereo.posed import colmap
from fcsv_stereo.refinement import KnownFeatures

FRONT = camera_pose((0.0, 0.0, 10.0))
PLACES = {
    "2 m beside": (0.0, -2.0, 0.0),
    "8 m beside": (0.0, 8.0, 0.0),
    "5 m above": (0.0, 0.0, 5.0),
}


def pairs(flights, little_texture=False):
    """Of as many flights, which see scenes from 40 to 160 m away."""
    seed = 0
    while flights:
        scene = SimulatedScene(np.eye(4), seed := seed + 1)
        if scene.little_texture == little_texture:
            flights -= 1
            yield MatchedScene(scene, scene, seed)


def seen(pair, place, off_m=(0.0, 0.0, 0.0)):
    """``off_m``: by how much a tracker is wrong (home)."""
    T = camera_pose(np.array([0.0, 0.0, 10.0]) + place)
    told = transforms.transform(T[:3, :3], T[:3, 3] + off_m)
    return compare(transforms.invert(FRONT) @ told, *pair.rays(FRONT, T), FOCAL_PX, NOISE_PX)


def looked(a, b):
    return look(a, b, KnownFeatures())


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_trackers_that_tell_the_truth_are_never_doubted(place):
    looks = [seen(pair, place) for pair in pairs(60)]
    assert not any(l.off for l in looks) and max(l.off_m for l in looks) < 0.7
    assert np.median([l.agree / l.matches for l in looks]) > 0.75


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
@pytest.mark.parametrize("off_m", [1.5, 3.0, 10.0])
def test_a_drift_across_the_way_between_both_is_seen(place, off_m):
    way = np.cross(place, (1.0, 0.0, 0.0))
    looks = [seen(pair, place, off_m * way / np.linalg.norm(way)) for pair in pairs(30)]
    assert np.mean([l.off for l in looks]) > (0.6 if off_m < 2.0 else 0.85)
    found = [l.off_m for l in looks if l.off]
    assert np.median(found) == pytest.approx(off_m, rel=0.25)


def test_a_drift_along_that_way_is_not():
    assert not any(seen(pair, (0.0, -4.0, 0.0), (0.0, -2.0, 0.0)).off for pair in pairs(60))


def test_too_little_texture_says_nothing():
    looks = [
        seen(pair, (0.0, -2.0, 0.0), (0.0, 0.0, 3.0)) for pair in pairs(20, little_texture=True)
    ]
    assert not any(l.off or l.agree for l in looks)


def test_matches_that_agree_with_nothing_say_nothing():
    random = np.random.default_rng(3)
    for _ in range(30):
        rays = [
            np.column_stack([random.uniform(-0.5, 0.5, (150, 2)), np.ones(150)]) for _ in range(2)
        ]
        assert not compare(
            transforms.transform(np.eye(3), [2.0, 0.0, 0.0]), *rays, FOCAL_PX, NOISE_PX
        ).off


def test_pictures_of_a_wall():
    a = picture("a", "uav1", 0.0, camera_pose((0.0, 0.0, 0.0)))
    b = picture("b", "uav2", 0.0, camera_pose((0.0, -1.0, 0.0)))
    calm = looked(a, b)
    assert not calm.off and calm.matches > 60 and calm.off_m < 0.4
    drifted = replace(b, T_home_cam=transforms.from_xyz_yaw([0.0, 0.0, 1.5], 0.0) @ b.T_home_cam)
    assert looked(a, drifted).off
    assert looked(a, replace(b, image=np.full_like(b.image, 128))).matches == 0


def test_photographs_of_known_pose(shared_data, tmp_path):
    """Neighbours of the eleven of the fountain. Measured 2026-11-27 over all 82 pairs with 40
    matches, ten draws each: none of 820 off without a drift, 351 of 492 with one of 1.5 m and more
    than 0.9 m of it across."""
    names = [f"{k:04}.jpg" for k in range(2, 8)]
    folder = fountain(shared_data, tmp_path / "model", names)
    given = colmap.read_photographs(folder, names[0])
    photographs = [
        given.configurations[0].references[0],
        *(p for c in given.configurations for p in c.others),
    ]
    photographs = sorted(photographs, key=lambda p: p.name)
    for a, b in zip(photographs, photographs[1:]):
        calm = looked(a, b)
        assert not calm.off and calm.off_m < 0.3 and calm.matches > 90
        drifted = replace(
            b, T_home_cam=b.T_home_cam @ transforms.from_xyz_yaw([0.0, 2.0, 0.0], 0.0)
        )
        assert looked(a, drifted).off_m == pytest.approx(2.0, abs=0.4) and looked(a, drifted).off


@pytest.mark.parametrize(
    "change", [{"off_m": 0.0}, {"surprise": float("nan")}, {"rotation_rad": -1.0}]
)
def test_bounds_that_are_none_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        PairRules(**change)


def live(vehicle, stamp_s):
    return LivePicture(vehicle, stamp_s, b"", None, np.eye(4))


def taken(pairs_to_look_at):
    pair = pairs_to_look_at.next_pair()
    return pair and tuple((p.vehicle, p.stamp_s) for p in pair)


def test_the_newest_of_both_at_most_once_a_second():
    pairs_ = PairsToLookAt(["uav1", "uav2", "uav3"], every_s=1.0, apart_s=0.5)
    pairs_.add(live("uav2", 10.0))
    assert taken(pairs_) is None, "nothing of the reference"
    pairs_.add(live("uav1", 10.6))
    assert taken(pairs_) is None, "too far apart"
    pairs_.add(live("uav2", 10.3))
    assert taken(pairs_) == (("uav1", 10.6), ("uav2", 10.3))
    pairs_.add(live("uav2", 11.0))
    assert taken(pairs_) is None, "not yet"
    pairs_.add(live("uav3", 10.9))
    pairs_.add(live("uav9", 10.6))  # of another fleet
    assert taken(pairs_) == (("uav1", 10.6), ("uav3", 10.9))
    pairs_.add(live("uav1", 11.4))
    pairs_.add(live("uav2", 11.4))
    assert taken(pairs_) == (("uav1", 11.4), ("uav2", 11.4)) and taken(pairs_) is None


def test_who_waited_longest_is_next_and_a_clock_that_is_set_back_stops_nothing():
    pairs_ = PairsToLookAt(["uav1", "uav2", "uav3"], every_s=1.0, apart_s=0.5)
    for name in ("uav1", "uav2", "uav3"):
        pairs_.add(live(name, 50.0))
    assert {taken(pairs_)[1][0], taken(pairs_)[1][0]} == {"uav2", "uav3"}
    pairs_.add(live("uav1", 20.0))
    pairs_.add(live("uav2", 20.0))
    assert taken(pairs_) == (("uav1", 20.0), ("uav2", 20.0))
