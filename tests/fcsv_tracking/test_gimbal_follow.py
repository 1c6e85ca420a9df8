# SPDX-License-Identifier: Apache-2.0
"""The dead zone (figure 4.4), meeting a moving target, and the search."""

import numpy as np
import pytest
from support.gimbal_scene import CAMERA, GIMBAL

from fcsv_geometry import transforms as tf
from fcsv_tracking.gimbal.follow import Follower, FollowRules, Target
from fcsv_tracking.gimbal.geometry import Angles

START = Angles(0.1, 0.2)


def place(angles, bearing_deg=(0.0, 0.0), distance_m=3.0):
    """A point so many degrees right and down of the axis of a gimbal that stands so."""
    right, down = np.tan(np.radians(bearing_deg))
    p = np.array([right, down, 1.0]) * distance_m / np.linalg.norm([right, down, 1.0])
    return tf.apply(GIMBAL.T_ground_cam(angles), p)


def at_rest(bearing_deg, **kwargs):
    return Target(10.0, place(START, bearing_deg, **kwargs), np.zeros(3))


def test_still_inside_the_zone_and_back_to_the_middle_outside():
    follower = Follower(GIMBAL, CAMERA, FollowRules(), START)
    zone_deg = np.degrees(follower.zone_rad(3.0))
    assert 4.0 < zone_deg[0] < 10.75 and 1.5 < zone_deg[1] < 6.1
    for bearing in ((0.95, 0.0), (-0.95, 0.0), (0.0, 0.95), (0.9, -0.9)):
        assert follower.command(10.0, at_rest(zone_deg * bearing)) is None
    for bearing in ((1.05, 0.0), (-1.05, 0.5), (0.0, 1.05), (0.2, -1.05)):
        follower = Follower(GIMBAL, CAMERA, FollowRules(), START)
        target = at_rest(zone_deg * bearing)
        goal = follower.command(10.0, target)
        x, y, _ = tf.apply(tf.invert(GIMBAL.T_ground_cam(goal)), target.p_ground_m)
        assert np.hypot(x, y) < 1e-6  # one that rests is met in the middle
        assert follower.command(10.02, target) is None  # on the way there: told once


def test_the_zone_is_narrower_for_a_near_target():
    follower = Follower(GIMBAL, CAMERA, FollowRules(), START)
    assert (follower.zone_rad(1.0) < follower.zone_rad(2.0)).all()
    assert (follower.zone_rad(2.0) < follower.zone_rad(4.0)).all()
    assert (follower.zone_rad(0.01) > 0).all()


@pytest.mark.parametrize("lead", [0.0, 0.5])
def test_a_moving_target_is_met_where_it_will_be(lead):
    """On arrival it is in the middle, with a lead it is on the side it comes from, by no more than
    the lead."""
    rules = FollowRules(lead=lead)
    follower = Follower(GIMBAL, CAMERA, rules, START)
    left = -GIMBAL.T_ground_cam(START)[:3, 0]
    target = Target(10.0, place(START, (-8.0, 0.0)), 1.0 * left)
    goal = follower.command(10.15, target)  # the picture is 0.15 s old
    way = abs(goal.pan_rad - START.pan_rad)
    arrival_s = (
        10.15 + rules.servo_delay_s + 2.0 * np.sqrt(way / np.radians(rules.acceleration_degps2))
    )
    x, _, z = tf.apply(tf.invert(GIMBAL.T_ground_cam(goal)), target.at(arrival_s))
    bearing_rad = np.arctan2(x, z)
    if lead:
        assert 0.3 * lead < bearing_rad / follower.zone_rad(3.0)[0] < 1.1 * lead
    else:
        assert abs(np.degrees(bearing_rad)) < 0.5


def test_the_thesis_rule_turns_by_the_last_bearing():
    follower = Follower(GIMBAL, CAMERA, FollowRules(predict=False, lead=0.0), START)
    target = Target(10.0, place(START, (9.0, 0.0)), np.array([0.0, -1.0, 0.0]))
    assert follower.command(10.2, target) == pytest.approx(GIMBAL.aim(target.p_ground_m))


def test_leaving_the_zone_is_seen_before_a_picture_shows_it():
    """0.2 s old, moving at 1 m/s two metres away: by now it is 5.7 degrees further."""
    left = -GIMBAL.T_ground_cam(START)[:3, 0]
    target = Target(10.0, place(START, (-3.0, 0.0), distance_m=2.0), left)
    assert Follower(GIMBAL, CAMERA, FollowRules(), START).command(10.0, target) is None
    assert Follower(GIMBAL, CAMERA, FollowRules(), START).command(10.2, target) is not None


class TestSearch:
    def places(self, seconds, target=None):
        rules = FollowRules()
        follower, found = Follower(GIMBAL, CAMERA, rules, START), []
        for now_s in np.arange(100.0, 100.0 + seconds, 0.02):
            goal = follower.command(float(now_s), target)
            if goal is not None:
                found.append((now_s, goal))
        assert follower.searching
        return found

    def test_it_sees_every_direction_and_begins_anew(self):
        found = self.places(200.0)
        looked = np.array([goal for _, goal in found])
        half = np.array([np.arctan2(960, CAMERA.fx), np.arctan2(540, CAMERA.fx)])
        limits = np.radians([GIMBAL.pan_limits_deg, GIMBAL.tilt_limits_deg])
        for pan in np.linspace(*limits[0], 40):
            for tilt in np.linspace(*limits[1], 30):
                assert (np.abs(looked - [pan, tilt]) <= half).all(axis=1).any(), np.degrees(
                    [pan, tilt]
                )
        assert (looked >= limits[:, 0] - 1e-9).all() and (looked <= limits[:, 1] + 1e-9).all()
        assert sum(np.allclose(g, START) for g in looked) >= 2

    def test_it_begins_where_the_target_went_and_waits_at_every_place(self):
        p, v = place(START, (5.0, 0.0)), np.array([0.0, -1.0, 0.0])
        found = self.places(4.0, Target(98.0, p, v))
        assert found[0][1] == pytest.approx(GIMBAL.aim(p + FollowRules().lost_s * v))
        assert np.diff([t for t, _ in found]).min() > FollowRules().search_dwell_s

    def test_it_waits_until_a_picture_of_the_place_was_looked_at(self):
        """One picture a second, looked at 0.3 s later: none of the places is passed unseen."""
        follower, found = Follower(GIMBAL, CAMERA, FollowRules(), START), []
        for k in range(1000):
            now_s = 100.0 + 0.02 * k
            goal = follower.command(now_s, None, looked_s=np.floor(now_s - 0.3))
            found += [] if goal is None else [now_s]
        taken_s = np.arange(100.0, 120.0)
        for come_s, gone_s in zip(found, found[1:]):
            assert any(come_s < t and t + 0.3 <= gone_s + 1e-6 for t in taken_s)
        assert len(found) > 8  # about one a second, two where it turned for long

    def test_without_any_pictures_it_goes_on_after_a_while(self):
        follower, rules, found = Follower(GIMBAL, CAMERA, FollowRules(), START), FollowRules(), []
        for k in range(1000):
            found += (
                [100.0 + 0.02 * k] if follower.command(100.0 + 0.02 * k, None, looked_s=0.0) else []
            )
        assert np.diff(found).min() > rules.search_patience_s and len(found) >= 4

    def test_what_nobody_looked_for_is_not_lost(self):
        follower, rules = Follower(GIMBAL, CAMERA, FollowRules(), START), FollowRules()
        target = Target(100.0, place(START), np.zeros(3))
        assert follower.command(101.5, target, looked_s=100.0) is None and not follower.searching
        follower.command(101.6, target, looked_s=101.0)
        assert follower.searching  # a picture without it
        follower.command(100.1 + rules.search_patience_s, target, looked_s=100.0)
        assert follower.searching  # no pictures for long

    def test_found_again_it_follows(self):
        follower = Follower(GIMBAL, CAMERA, FollowRules(), START)
        for k in range(100):
            follower.command(100.0 + 0.05 * k, None)
        assert follower.searching
        target = Target(105.0, place(follower.goal, (1.0, 0.0)), np.zeros(3))
        assert follower.command(105.01, target) is None and not follower.searching


@pytest.mark.parametrize(
    "change",
    [
        {"zone": (1.0, 0.5)},
        {"lead": 1.0},
        {"speed_degps": 0.0},
        {"servo_delay_s": -1.0},
        {"search_step": 2.0},
        {"lost_s": 0.0},
    ],
)
def test_rules_out_of_range_are_named(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        FollowRules(**change)
