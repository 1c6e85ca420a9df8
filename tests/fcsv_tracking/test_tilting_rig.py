# SPDX-License-Identifier: Apache-2.0
"""The tilting rig: where its cameras are, how well that is known, which angle for which distance,
its servos."""

import time
from dataclasses import replace

import numpy as np
import pytest
import yaml
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_geometry.config import ConfigError
from fcsv_sim.gimbal.dynamixel_bus import SimulatedBus
from fcsv_tracking.gimbal import mx12w
from fcsv_tracking.gimbal.dynamixel import DynamixelBus
from fcsv_tracking.gimbal.servos import ServoError
from fcsv_tracking.tilting.aim import Aim, AimRules, crossing, in_both_views, nearest_m
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, TiltingRig, load_rig
from fcsv_tracking.tilting.servos import TiltServos

until = within(10.0)


@pytest.fixture(scope="module")
def rig(root) -> TiltingRig:
    return load_rig(root / "config/tilting/rig.yaml")


@pytest.fixture(scope="module")
def geared(rig):
    return replace(rig, right=replace(rig.right, servo=None))


class TestGeometry:
    def test_at_zero_the_cameras_are_parallel_and_side_by_side(self, rig):
        T = rig.T_left_right(TiltAngles(0.0, 0.0))
        assert np.allclose(T[:3, :3], np.eye(3)) and np.allclose(T[:3, 3], [0.3, 0.0, 0.0])
        assert rig.baseline_m == pytest.approx(0.3)

    def test_positive_angles_turn_inward(self, rig):
        for side, sign in (("left", -1.0), ("right", 1.0)):
            looks = rig.T_rig_cam(side, TiltAngles(0.2, 0.2))[:3, 2]
            assert looks == pytest.approx([np.cos(0.2), sign * np.sin(0.2), 0.0])

    def test_covariance_is_that_of_many_rigs(self, rig):
        """Readings and calibration as ``known`` says them; 4000 draws tell a standard deviation to
        1.1 %."""
        angles, random, n = TiltAngles(0.3, 0.2), np.random.default_rng(1), 4000
        T_l, T_r = (rig.T_rig_cam(s, angles) for s in SIDES)
        errors = np.empty((n, 6))
        for i in range(n):
            off = random.normal(0.0, rig.angle_std_rad, 2)
            left, right = (
                rig.left.T_rig_cam(angles[0] + off[0]),
                rig.right.T_rig_cam(angles[1] + off[1]),
            )
            turn = random.normal(0.0, np.radians(rig.known.rotation_deg), 3)
            right[:3, :3] = transforms.Rotation.from_rotvec(turn).as_matrix() @ right[:3, :3]
            right[:3, 3] += random.normal(0.0, rig.known.position_m, 3)
            held = T_l @ transforms.invert(left) @ right  # the right one where the left one is held
            errors[i, :3] = held[:3, 3] - T_r[:3, 3]
            errors[i, 3:] = transforms.Rotation.from_matrix(
                held[:3, :3] @ T_r[:3, :3].T
            ).as_rotvec()
        found, said = np.cov(errors.T), rig.relative_covariance(angles)
        scale = np.sqrt(np.outer(said.diagonal(), said.diagonal()))
        assert np.abs(found - said).max() < 0.07 * scale.max() and np.allclose(
            np.sqrt(found.diagonal()), np.sqrt(said.diagonal()), rtol=0.04
        )

    def test_a_geared_pair_errs_by_one_reading(self, rig, geared):
        """Both turn inward by the same error: their relative yaw is off by twice it, not by
        sqrt(2)."""
        angles = TiltAngles(0.2, 0.2)
        known2 = np.radians(rig.known.rotation_deg) ** 2
        own, one = (np.sqrt(r.relative_covariance(angles)[5, 5] - known2) for r in (rig, geared))
        assert one / own == pytest.approx(np.sqrt(2.0), rel=1e-3)

    @pytest.mark.parametrize(
        "path, value, words",
        [
            (("left", "servo"), None, "left.servo"),
            (("right", "servo", "id"), 1, "right.servo.id"),
            (("left", "axis", "direction"), [0.0, 0.0, 0.0], "left.axis"),
            (("limits_deg",), [10.0, 5.0], "limits_deg"),
            (("left", "mount", "xyz_m"), [0.0, -0.3, 0.0], "left.mount.xyz_m"),
            (("known", "reading_deg"), 0.0, "known.reading_deg"),
            (("tilt",), 1, "unknown key 'tilt'"),
        ],
    )
    def test_a_wrong_file_is_refused_by_field(self, root, tmp_path, path, value, words):
        document = yaml.safe_load((root / "config/tilting/rig.yaml").read_text())
        at = document
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = value
        (tmp_path / "rig.yaml").write_text(yaml.safe_dump(document))
        with pytest.raises(ConfigError, match=words.replace(".", r"\.")):
            load_rig(tmp_path / "rig.yaml")


class TestAim:
    @pytest.mark.parametrize("distance_m", [0.3, 1.0, 3.0])
    def test_what_is_looked_at_is_in_the_middle_of_both(self, rig, distance_m):
        angles = crossing(rig, distance_m)
        for side in SIDES:
            T_cam_rig = transforms.invert(rig.T_rig_cam(side, angles))
            u, _ = getattr(rig, side).camera.project(
                transforms.apply(T_cam_rig, np.array([[distance_m, 0, 0]]))
            )[0]
            assert u == pytest.approx(319.5, abs=1e-3)

    def test_limits_hold(self, rig):
        assert crossing(rig, 0.05) == pytest.approx(np.radians([35.0, 35.0]))

    def test_far_is_parallel_with_a_hysteresis(self, rig):
        aim = Aim(rig, AimRules(parallel_beyond_m=5.0, again_share=0.8, dead_deg=0.1))
        aim.look(4.5)
        assert aim.goal == (0.0, 0.0)  # not yet nearer than 4 m
        aim.look(3.9)
        near = aim.goal
        assert near.left_rad > 0.0
        aim.look(4.5)
        assert 0.0 < aim.goal.left_rad < near.left_rad  # still tilted
        aim.look(5.5)
        assert aim.goal == (0.0, 0.0)

    def test_small_changes_do_not_turn_it(self, rig):
        aim = Aim(rig, AimRules(dead_deg=1.0))
        aim.look(1.0)
        goal = aim.goal
        for distance_m in (0.95, 1.05, 1.1):  # 0.15 / 1.1 against 0.15 / 1: 0.8 degrees
            aim.look(distance_m)
            assert aim.goal == goal
        aim.look(0.5)
        assert aim.goal.left_rad > goal.left_rad + np.radians(1.0)

    def test_it_turns_no_faster_than_the_speed(self, rig):
        aim = Aim(rig, AimRules(speed_degps=20.0))
        aim.step(10.0)
        aim.look(0.4)
        told = [aim.step(10.0 + 0.1 * k) for k in range(1, 12)]
        steps = np.diff([0.0, *(t.left_rad for t in told)])
        assert steps.max() <= np.radians(2.0) + 1e-9 and np.allclose(told[-1], aim.goal)
        assert aim.step(9.0) == told[-1]  # a clock that goes back turns nothing

    @pytest.mark.parametrize("distance_m", [0.0, -1.0, float("nan"), float("inf")])
    def test_what_is_no_distance_is_refused_and_changes_nothing(self, rig, distance_m):
        aim = Aim(rig)
        aim.look(1.0)
        goal = aim.goal
        with pytest.raises(ValueError, match="distance_m"):
            aim.look(distance_m)
        assert aim.goal == goal

    def test_nearest_distances(self, rig):
        """Parallel: 0.15 m to the side and half of the size within 28 degrees, behind lenses 15 mm
        ahead."""
        size_m = 0.1
        parallel = (0.15 + size_m / 2) / (319.5 / 601.8) + 0.015
        assert nearest_m(rig, size_m, tilt=False) == pytest.approx(parallel, abs=1e-3)
        tilted = nearest_m(rig, size_m)
        assert tilted < 0.75 * parallel  # then the 0.08 m below the lenses leave the picture
        assert in_both_views(rig, crossing(rig, tilted), tilted, size_m)
        assert not in_both_views(rig, crossing(rig, 0.98 * tilted), 0.98 * tilted, size_m)
        with pytest.raises(ValueError, match="at no distance"):
            nearest_m(rig, 30.0)


class TestServos:
    def test_both_turn_and_are_read(self, rig):
        with SimulatedBus([1, 2]) as bus:
            line = DynamixelBus(bus.port, answer_s=0.3)
            servos = TiltServos(line, rig, time.time)
            goal = TiltAngles(0.3, 0.2)
            servos.turn(goal)
            until(
                lambda: np.allclose(servos.read().angles, goal, atol=2 * mx12w.TICK_RAD),
                what="the cameras turned",
            )
            # its sign is -1
            assert bus.servos[1].get(mx12w.GOAL_POSITION) == 2048 - round(0.3 / mx12w.TICK_RAD)
            assert set(servos.health()) == {
                f"{s} {w}" for s in SIDES for w in ("servo", "lost answers")
            }
            servos.turn(TiltAngles(2.0, 2.0))  # inside the rig's limits
            most = 2048 + round(np.radians(35.0) / mx12w.TICK_RAD)
            until(
                lambda: bus.servos[2].get(mx12w.GOAL_POSITION) == most, what="the goal at the limit"
            )
            servos.close()
            line.close()

    def test_a_geared_side_has_the_others_angle(self, geared):
        with SimulatedBus([1]) as bus:
            line = DynamixelBus(bus.port, answer_s=0.3)
            servos = TiltServos(line, geared, time.time)
            servos.turn(TiltAngles(0.3, 0.0))
            until(
                lambda: abs(servos.read().angles.right_rad - 0.3) < 2 * mx12w.TICK_RAD,
                what="the cameras turned",
            )
            line.close()

    def test_a_servo_that_is_missing_is_named(self, rig):
        with SimulatedBus([1]) as bus:
            line = DynamixelBus(bus.port, answer_s=0.3)  # the machine may be busy
            with pytest.raises(ServoError, match="servo 2 does not answer"):
                TiltServos(line, rig, time.time)
            line.close()
