# SPDX-License-Identifier: Apache-2.0
"""From tags and angles to the vehicle's pose in the ground robot's frame; everything bad that may
come in between."""

import dataclasses

import numpy as np
import pytest
from support.gimbal_scene import CAMERA, GIMBAL, body, seen, sides

from fcsv_geometry import transforms as tf
from fcsv_geometry.errors import PoseUnavailable
from fcsv_tracking.errors import HomeRefused, SampleRejected
from fcsv_tracking.gimbal.geometry import Angles
from fcsv_tracking.gimbal.system import GimbalSystem
from fcsv_tracking.gimbal.tracker import GimbalRules, GimbalTracker

T_D_C = tf.from_xyz_rpy([0.045, 0.0, 0.0], [0.0, 0.17, 0.0]) @ tf.transform(
    tf.R_FLU_OPTICAL, np.zeros(3)
)


def middle(T_G_D):
    """Of the tags."""
    return tf.apply(T_G_D, np.array([0.0, 0.0, 0.06]))


class Loop:
    """A gimbal that obeys at once, and a vehicle that moves; ideal corners."""

    def __init__(self, first=20, rules=None):
        self.tags = sides(first=first)
        self.angles = GIMBAL.aim(body()[:3, 3])
        self.tracker = GimbalTracker(GIMBAL, self.tags, CAMERA, rules or GimbalRules(), self.angles)
        self.now_s = 100.0

    def readings(self, seconds=0.1, rate_radps=0.0):
        for _ in range(int(round(seconds / 0.01))):
            self.now_s += 0.01
            self.angles = Angles(self.angles.pan_rad + 0.01 * rate_radps, self.angles.tilt_rad)
            self.tracker.add_angles(self.now_s, self.angles)

    def observations(self, T_G_D, angles=None):
        return seen(self.tags, tf.invert(GIMBAL.T_ground_cam(angles or self.angles)) @ T_G_D)

    def picture(self, T_G_D, stamp_s=None, observations=None):
        stamp_s = self.now_s - 0.02 if stamp_s is None else stamp_s
        observations = self.observations(T_G_D) if observations is None else observations
        return self.tracker.add_tags(self.now_s, stamp_s, observations)

    def rejected(self, reason, *args, **kwargs):
        before = self.tracker.counts[reason]
        with pytest.raises(SampleRejected) as error:
            self.picture(*args, **kwargs)
        assert error.value.reason == reason and self.tracker.counts[reason] == before + 1


def test_readings_and_commands_go_on_while_a_picture_is_looked_at():
    """begin(), see(), finish() with readings and a command between them give what add_tags() gives
    at once."""
    at_once, between = Loop(), Loop()
    for loop in (at_once, between):
        loop.readings(0.3)
    pose = at_once.picture(body())
    stamp_s = between.now_s - 0.02
    picture = between.tracker.begin(between.now_s, stamp_s, between.observations(body()))
    between.readings(0.2, rate_radps=0.3)
    seen = between.tracker.find_body(picture)
    between.tracker.command(between.now_s)
    other = between.tracker.finish(picture, seen)
    assert other.stamp_s == pose.stamp_s == stamp_s
    assert np.array_equal(other.T_G_D, pose.T_G_D) and np.array_equal(
        other.covariance, pose.covariance
    )


def test_a_picture_that_a_newer_one_overtook_is_none():
    loop = Loop()
    loop.readings(0.3)
    stamp_s = loop.now_s - 0.02
    picture = loop.tracker.begin(loop.now_s, stamp_s, loop.observations(body()))
    loop.readings(0.1)
    newer = loop.picture(body())
    with pytest.raises(SampleRejected) as error:
        loop.tracker.finish(picture, loop.tracker.find_body(picture))
    assert error.value.reason == "overtaken" and loop.tracker.counts["overtaken"] == 1
    assert loop.tracker.latest is newer


@pytest.fixture
def loop():
    loop = Loop()
    loop.readings(0.3)
    return loop


def test_pose_is_composed_of_angles_and_tags(loop):
    pose = loop.picture(body())
    assert np.allclose(pose.T_G_D, body(), atol=1e-6)
    assert np.linalg.eigvalsh(pose.covariance).min() > 0
    assert 0.001 < np.sqrt(np.trace(pose.covariance[:3, :3])) < 0.01


def test_angles_of_the_pictures_moment_not_of_now(loop):
    """The gimbal turned since the picture was taken: the pose is of the angles then."""
    then, angles = loop.now_s - 0.005, loop.angles
    loop.readings(0.1)
    loop.readings(0.2, rate_radps=1.0)
    assert np.allclose(
        loop.picture(body(), then, loop.observations(body(), angles)).T_G_D, body(), atol=1e-6
    )


def test_across_grows_with_distance_and_with_the_reading():
    sigmas = []
    for distance_m, angle_deg in ((2.0, 0.03), (4.0, 0.03), (4.0, 0.3)):
        loop = Loop(rules=GimbalRules(angle_deg=angle_deg))
        loop.angles = GIMBAL.aim(body(distance_m)[:3, 3])
        loop.readings(0.3)
        C = loop.picture(body(distance_m)).covariance
        sigmas.append(np.sqrt(C[1, 1]))
    assert sigmas[0] < sigmas[1] < sigmas[2] and sigmas[2] > np.radians(0.3) * 3.8


def test_no_pose_while_the_gimbal_turns_but_it_is_followed(loop):
    loop.readings(0.2, rate_radps=1.0)
    then = loop.now_s - 0.05
    angles = Angles(loop.angles.pan_rad - 0.05, loop.angles.tilt_rad)
    with pytest.raises(SampleRejected) as error:
        loop.picture(body(), then, loop.observations(body(), angles))
    assert error.value.reason == "gimbal turning" and loop.tracker.latest is None
    assert np.allclose(loop.tracker.target().p_ground_m, middle(body()), atol=1e-5)


def test_velocity_of_a_moving_target(loop):
    for _ in range(10):
        loop.readings(0.03)
        T = body()
        T[:3, 3] += (loop.now_s - 0.02 - 100.0) * np.array([0.1, 0.2, -0.05])
        loop.picture(T)
    assert loop.tracker.target().v_ground_mps == pytest.approx([0.1, 0.2, -0.05], abs=1e-3)


class TestBadInput:
    def test_stamps(self, loop):
        loop.picture(body())
        loop.rejected("stamp goes back", body())
        loop.rejected("stamp goes back", body(), loop.now_s - 0.1)
        loop.rejected("stamp ahead of the clock", body(), loop.now_s + 0.3)
        loop.rejected("stamp ahead of the clock", body(), np.nan)
        loop.rejected("too old", body(), loop.now_s - 3.0)

    def test_five_seconds_of_silence_and_a_clock_set_back(self, loop):
        loop.picture(body())
        loop.now_s += 5.0
        loop.rejected("no angles", body())  # readings are silent
        loop.readings(0.3)
        assert np.allclose(loop.picture(body()).T_G_D, body(), atol=1e-6)
        loop.now_s = 50.0
        loop.readings(0.3)
        assert np.allclose(loop.picture(body()).T_G_D, body(), atol=1e-6)

    def test_no_angles_yet(self):
        loop = Loop()
        loop.rejected("no angles", body())

    def test_angles_that_are_none(self, loop):
        for bad in (Angles(np.nan, 0.0), Angles(0.0, np.inf)):
            with pytest.raises(SampleRejected):
                loop.tracker.add_angles(loop.now_s + 0.01, bad)
        assert loop.tracker.counts["not angles"] == 2

    def test_another_vehicles_tags_are_not_ours(self, loop):
        other = Loop(first=30)
        loop.rejected("no tag", body(), observations=other.observations(body()))

    def test_a_tag_of_another_size(self, loop):
        wrong = [dataclasses.replace(o, size_m=0.05) for o in loop.observations(body())]
        loop.rejected("tag size", body(), observations=wrong)

    def test_a_jump_is_not_the_vehicle(self, loop):
        loop.picture(body())
        loop.readings(0.03)
        far = body(distance_m=3.9)
        loop.rejected("jump", far, observations=loop.observations(far))
        assert np.allclose(loop.tracker.target().p_ground_m, middle(body()), atol=1e-5)

    @pytest.mark.parametrize(
        "field", ["angle_deg", "mount_m", "stamp_s", "still_degps", "most_speed_mps"]
    )
    def test_rules_out_of_range_are_named(self, field):
        with pytest.raises(ValueError, match=field):
            GimbalRules(**{field: 0.0})


class TestSystem:
    @pytest.fixture
    def pair(self):
        loops = {"tello1": Loop(first=20), "tello2": Loop(first=30)}
        for loop in loops.values():
            loop.readings(0.3)
        return loops, GimbalSystem(
            {n: l.tracker for n, l in loops.items()}, dict.fromkeys(loops, T_D_C)
        )

    def test_home_is_the_references_camera_level(self, pair):
        loops, system = pair
        with pytest.raises(HomeRefused, match="tello1 is not seen"):
            system.set_home("tello1", 100.3)
        T = body(tilt_deg=(3.0, -2.0))
        pose = loops["tello1"].picture(T)
        assert system.add("tello1", pose) is None
        T_G_home = system.set_home("tello1", 100.3)
        camera = system.camera("tello1", pose)
        assert np.allclose(T_G_home @ camera.T_home_cam, T @ T_D_C, atol=1e-6)
        assert np.allclose(camera.T_home_cam[:3, 3], 0.0, atol=1e-6) and T_G_home[
            2, 2
        ] == pytest.approx(1.0)
        assert np.linalg.eigvalsh(camera.covariance).min() > 0
        with pytest.raises(HomeRefused, match="not seen"):
            system.set_home("tello1", 102.0)

    def test_home_on_a_loose_pose_is_refused(self, pair):
        loops, system = pair
        loose = dataclasses.replace(loops["tello1"].picture(body()), covariance=0.01 * np.eye(6))
        loops["tello1"].tracker.latest = loose
        with pytest.raises(HomeRefused, match="bring it nearer"):
            system.set_home("tello1", 100.3)

    def test_relative_pose_at_a_stamp_between_pictures(self, pair):
        loops, system = pair
        for loop, name, shift in (
            (loops["tello1"], "tello1", 0.0),
            (loops["tello2"], "tello2", -0.4),
        ):
            for k in range(3):
                loop.readings(0.02)
                T = body()
                T[:3, 3] += [0.0, shift, 0.02 * k]
                loop.angles = GIMBAL.aim(T[:3, 3])
                loop.readings(0.1)
                system.add(
                    name, loop.picture(T, loop.now_s - 0.02 + (0.01 if name == "tello2" else 0.0))
                )
        stamp_s = loops["tello1"].now_s - 0.08
        T_ab, C = system.relative("tello1", "tello2", stamp_s)
        true = tf.invert(body())[:3, :3] @ [0.0, -0.4, 0.0]
        assert T_ab[:3, 3] == pytest.approx(true, abs=0.005)  # 10 ms between the two, 0.13 m/s
        assert np.linalg.eigvalsh(C).min() > 0
        assert system.relative("tello1", "tello2", stamp_s + 1.0) is None
        with pytest.raises(PoseUnavailable):
            system.body_at("tello1", stamp_s + 1.0)


def test_a_vehicle_just_lost_is_looked_for_first_where_it_should_be(loop):
    """A slow machine takes longer for a whole picture than `lost_s`; without this it would never be
    quicker again."""
    loop.picture(body())
    u, v = CAMERA.project(tf.apply(tf.invert(GIMBAL.T_ground_cam(loop.angles)), middle(body())))[0]
    loop.readings(2.0)
    window = loop.tracker.window(loop.now_s - 0.02)
    assert window.u0 < u < window.u1 and window.v0 < v < window.v1
    assert (window.u1 - window.u0) * (window.v1 - window.v0) < 0.75 * CAMERA.width * CAMERA.height
    loop.readings(2.0)
    assert loop.tracker.window(loop.now_s - 0.02) is None
