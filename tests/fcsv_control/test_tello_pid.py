# SPDX-License-Identifier: Apache-2.0
"""PID and observer of the Tello link: each rule by itself, then in closed loop with fcsv_sim's
dynamics."""

from pathlib import Path

import numpy as np
import pytest
from support.tello_loop import GIMBALS, MOCAP, LinkedTello, drone, fly

from fcsv_control.tello.observer import Observer, ObserverRules
from fcsv_control.tello.pid import Gains, PidConfig, PositionPid, StickModel, Sticks
from fcsv_geometry import config, transforms

_CONFIG = Path(__file__).resolve().parents[2] / "config" / "tello"
_HELD_M, _HELD_DEG = 0.15, 5.0  # the system's bound on set-points
_HERE = np.eye(4)
_TARGET = transforms.from_xyz_yaw([1.5, -1.0, 2.0], 3.0)
_ARRIVED_S = 16.0


def _pid(**axes):
    return PositionPid(PidConfig(**axes))


def _at(x=0.0, y=0.0, z=0.0, yaw=0.0):
    return transforms.from_xyz_yaw([x, y, z], yaw)


# ---- the controller ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["velocity", "attitude"])
def test_gains_are_read_from_their_file(name):
    assert config.load(_CONFIG / f"{name}.yaml", PidConfig).command == name


def test_a_wrong_gain_names_its_field():
    with pytest.raises(ValueError, match="p, most"):
        Gains(0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="command"):
        PidConfig(command="position")


def test_sticks_are_in_the_headings_axes():
    """Looking along y, a target along y is ahead, one along x to the right."""
    pid = _pid()
    ahead = pid.sticks(0.04, _at(yaw=np.pi / 2), np.zeros(3), _at(y=0.2, yaw=np.pi / 2))
    assert ahead.forward > 0.1 and abs(ahead.left) < 1e-9
    right = _pid().sticks(0.04, _at(yaw=np.pi / 2), np.zeros(3), _at(x=0.2, yaw=np.pi / 2))
    assert right.left < -0.1 and abs(right.forward) < 1e-9


def test_yaw_turns_the_short_way():
    turn = (
        _pid()
        .sticks(0.04, _at(yaw=np.radians(175.0)), np.zeros(3), _at(yaw=np.radians(-175.0)))
        .turn
    )
    assert 0.1 < turn < 0.3  # 10 degrees to the left, not 350 to the right


def test_speed_is_saturated_as_a_vector():
    c = PidConfig(command="attitude")
    s = PositionPid(c).sticks(0.04, _HERE, np.zeros(3), _at(x=30.0, y=40.0))
    forward, left = c.sticks.share(s.forward), c.sticks.share(s.left)
    assert np.hypot(forward, left) * c.sticks.most_mps2 == pytest.approx(c.horizontal.most)
    assert left / forward == pytest.approx(4.0 / 3.0)  # its direction is the target's


def test_integrators_wait_while_output_is_saturated_and_far_away():
    pid = _pid(horizontal=Gains(1.0, 1.0, 0.0, 0.3, 5.0, 10.0))
    for _ in range(200):
        pid.sticks(0.04, _HERE, np.zeros(3), _at(x=5.0))  # 8 s at the end of its stick
    # beyond it: back at once
    assert pid.sticks(0.04, _at(x=5.1), np.zeros(3), _at(x=5.0)).forward < 0.0
    pid = _pid(horizontal=Gains(0.1, 1.0, 0.0, 9.0, 5.0, 0.5))
    pid.sticks(1.0, _HERE, np.zeros(3), _at(x=2.0))
    assert pid.sticks(0.04, _HERE, np.zeros(3), _HERE).forward == 0.0


def test_an_integrator_is_bounded_and_can_be_forgotten():
    gains = Gains(0.1, 1.0, 0.0, 9.0, 0.2, 9.0)
    pid = _pid(command="attitude", horizontal=gains)
    for _ in range(100):
        pid.sticks(1.0, _HERE, np.zeros(3), _at(x=1.0))
    model = StickModel()
    left_over = model.share(pid.sticks(1e-6, _HERE, np.zeros(3), _HERE).forward) * model.most_mps2
    assert left_over == pytest.approx(0.2, abs=1e-3)
    pid.reset()
    assert pid.sticks(1e-6, _HERE, np.zeros(3), _HERE) == Sticks()


def test_a_new_set_point_gives_no_kick_by_the_derivative():
    """It is on the measured velocity: where it does not move, d says nothing, whatever the target
    did."""
    with_d, without = Gains(1.0, 0.0, 5.0, 9.0, 0.0, 0.0), Gains(1.0, 0.0, 0.0, 9.0, 0.0, 0.0)
    a, b = (
        _pid(command="attitude", horizontal=g).sticks(0.04, _HERE, np.zeros(3), _at(x=0.3)).forward
        for g in (with_d, without)
    )
    assert a == b
    assert (
        _pid(command="attitude", horizontal=with_d)
        .sticks(0.04, _HERE, np.array([0.1, 0.0, 0.0]), _HERE)
        .forward
        < 0.0
    )


# ---- where it is now -----------------------------------------------------------------------------


def _moving(observer: Observer, delay_s: float, seconds: float = 4.0, mps: float = 0.5) -> float:
    """At a constant speed that the commands say; error (m) along the way at the end."""
    model, now_s, under_way = StickModel(), 0.0, []
    # against its drag
    stick = Sticks(forward=model.stick(model.drag_per_s * mps / model.most_mps2))
    while now_s < seconds:
        now_s += 0.04
        observer.step(now_s, stick)
        under_way.append((now_s, _at(x=mps * now_s)))
        while under_way and under_way[0][0] <= now_s - delay_s:
            observer.pose(now_s, *under_way.pop(0))
    return float(observer.T_odom_body[0, 3]) - mps * now_s


def test_late_poses_are_predicted_to_now():
    """0.25 s late at 0.5 m/s are 0.125 m; what is left is a hundredth of that."""
    assert abs(_moving(Observer(ObserverRules(), StickModel()), 0.25)) < 0.005


def test_what_the_commands_do_not_explain_is_found():
    observer, now_s = Observer(ObserverRules(), StickModel()), 0.0
    for _ in range(150):
        now_s += 0.04
        observer.step(now_s, Sticks())
        observer.pose(now_s, now_s - 0.12, _at(y=0.2 * (now_s - 0.12)))
    assert observer.v_mps[1] == pytest.approx(0.2, abs=0.01)
    assert observer.T_odom_body[1, 3] == pytest.approx(0.2 * now_s, abs=0.01)


@pytest.mark.parametrize(
    "stamp_s, T, why",
    [
        (np.nan, _HERE, "not finite"),
        (10.0, np.full((4, 4), np.nan), "not finite"),
        (9.0, _HERE, "s old"),
        (10.5, _HERE, "ahead"),
        (9.9, _HERE, "not after"),
        (10.0, _at(x=3.0), "3.0 m from"),
        (10.0, _at(yaw=1.0), "turned by 57"),
    ],
)
def test_poses_that_cannot_be_are_refused(stamp_s, T, why):
    observer = Observer(ObserverRules(), StickModel())
    assert observer.pose(9.9, 9.9, _HERE)
    observer.step(10.0, Sticks())
    assert not observer.pose(10.0, stamp_s, T)
    assert why in observer.why_refused and observer.refused == 1
    assert np.allclose(observer.T_odom_body, _HERE)


def test_its_own_velocity_is_believed_between_poses():
    """Blown sideways without a pose: the log says so, the commands do not."""
    observer = Observer(ObserverRules(), StickModel())
    observer.pose(0.0, 0.0, _HERE)
    for k in range(1, 26):
        observer.step(0.04 * k, Sticks())
        observer.velocity(0.04 * k, 0.04 * k, np.array([0.0, 0.3, 0.0]), 0.04)
    # per s: the log's time constant, and the model of an axis that is let go
    pulls, brakes = 1.0 / 0.4, 1.8
    rate = pulls + brakes
    moved_m = 0.3 * pulls / rate * (1.0 - (1.0 - np.exp(-rate)) / rate)
    assert observer.T_odom_body[1, 3] == pytest.approx(moved_m, abs=0.02)
    observer.velocity(1.0, 1.0, np.array([np.nan, 0.0, 0.0]), 0.04)
    assert np.isfinite(observer.v_mps).all()


# ---- in closed loop ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [MOCAP, GIMBALS], ids=["mocap", "gimbals"])
@pytest.mark.parametrize("name", ["velocity", "attitude"])
@pytest.mark.parametrize("seed", [1, 2])
def test_set_points_are_held(tmp_path, name, kind, seed):
    """Thesis 5.3 and 4.3, in wind of 0.5 m/s with gusts, with a flow sensor that is off by 2
    cm/s."""
    gains = config.load(_CONFIG / f"{name}.yaml", PidConfig)
    flown = fly(drone(tmp_path, seed), kind, gains, _TARGET, 30.0, seed)
    held = flown.time_s > _ARRIVED_S
    assert flown.off_m[held].max() < _HELD_M
    assert flown.off_deg[held].max() < _HELD_DEG


def test_a_stick_gets_over_its_dead_band_or_is_let_go():
    model = StickModel()
    assert model.stick(0.001) == 0.0 and model.stick(np.nan) == 0.0
    assert model.stick(0.01) > model.dead_band
    assert model.share(model.stick(-0.3)) == pytest.approx(-0.3)


@pytest.mark.parametrize("name, most_m", [("velocity", 0.2), ("attitude", 0.3)])
def test_a_way_is_straight_whichever_axis_is_the_slow_one(tmp_path, name, most_m):
    """Level legs are flown faster than climbs: a way from beside another vehicle to above it once
    went past it, 0.7 m off its line (docs/lab/autopilot.md). Wind as in the other flights."""
    link = LinkedTello(tmp_path, 2)
    link.core._pid = PositionPid(config.load(_CONFIG / f"{name}.yaml", PidConfig))
    link.guided(transforms.from_xyz_yaw([0.0, 0.0, 2.0], 0.0))
    for target in ([0.0, 1.0, 5.0], [-2.0, 1.0, 4.5]):
        begin, way, off_m = link.p_m.copy(), np.array(target) - link.p_m, []
        for _ in range(300):
            link.step(transforms.from_xyz_yaw(target, 0.0))
            share = np.clip((link.p_m - begin) @ way / (way @ way), 0.0, 1.0)
            off_m.append(np.linalg.norm(link.p_m - begin - share * way))
        print(f"{name}: off its line by {max(off_m):.2f} m")
        assert max(off_m) < most_m and link.off_m(transforms.from_xyz_yaw(target, 0.0)) < 0.15
