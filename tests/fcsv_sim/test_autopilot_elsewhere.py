# SPDX-License-Identifier: Apache-2.0
"""ArduCopter's own simulation in the place of the simulated autopilot: its true pose, and who may
stand there."""

import math
import time

import numpy as np
import pytest
from support.copter_elsewhere import CopterElsewhere, M, sim_state

from fcsv_geometry import transforms
from fcsv_geometry.errors import FcsvError
from fcsv_sim.autopilot.elsewhere import ElsewhereError, TrueMotion
from fcsv_sim.autopilot.simulation_line import SimulationLine, require_simulation
from fcsv_sim.demo import demo
from fcsv_sim.demo.autopilots import addresses, require_there
from fcsv_sim.machines.machines import MachineError, free_port

HZ = 100.0
LSB_M = 1e-7 * 111319.49


def circle(t):
    """Position and velocity (east, north, up) of a vehicle that circles and climbs."""
    p = np.array([4 * math.sin(0.5 * t), 4 - 4 * math.cos(0.5 * t), 0.3 * t])
    return p, np.array([2 * math.cos(0.5 * t), 2 * math.sin(0.5 * t), 0.3])


def flown(start=(0.0, 0.0, 0.0, 0.0), seconds=30.0, heading=0.0, jitter_s=0.002):
    """States, and the truth that the messages rounded, in the start's frame."""
    motion, random = TrueMotion(start), np.random.default_rng(3)
    T_start = transforms.from_xyz_yaw(start[:3], start[3]) @ transforms.invert(
        transforms.from_xyz_yaw([0] * 3, heading)
    )
    states, true = [], []
    for k in range(int(seconds * HZ)):
        p, v = circle(k / HZ)
        came_s = 1000.0 + k / HZ + abs(random.normal(0, jitter_s))
        states.append(motion.on_sim_state(came_s, sim_state(p, (0.0, 0.0, heading), v)))
        true.append(transforms.apply(T_start, p))
    return states, np.array(true)


def test_the_pose_is_finer_than_the_rounded_position_and_does_not_jitter():
    states, true = flown()
    found = np.array([s.T_world_body[:3, 3] for s in states])
    # a cell, and 2 m/s times the odd time of arrival
    assert np.abs(found - true).max() < 1.6 * LSB_M
    steps = np.linalg.norm(np.diff(found, axis=0) - np.diff(true, axis=0), axis=1)
    assert np.percentile(steps, 99) < 0.004, "rounded positions alone step by 11 mm"
    stamps = np.array([s.stamp_s for s in states])
    assert (
        np.all(np.diff(stamps) > 0)
        and np.abs(stamps - 1000.0 - np.arange(len(stamps)) / HZ).max() < 0.008
    )


@pytest.mark.parametrize("heading", [0.0, 1.2, -2.0])
def test_it_starts_where_the_column_stands_whatever_its_heading_was(heading):
    start = (-3.5, 2.0, 0.0, 0.4)
    states, true = flown(start, 8.0, heading)
    assert states[0].T_world_body == pytest.approx(
        transforms.from_xyz_yaw(start[:3], start[3]), abs=1e-6
    )
    assert states[-1].T_world_body[:3, 3] == pytest.approx(true[-1], abs=1.6 * LSB_M)
    p, v = circle(8.0 - 1 / HZ)
    turned = transforms.from_xyz_yaw([0] * 3, 0.4 - heading)[:3, :3] @ v
    assert states[-1].v_world_mps == pytest.approx(turned, abs=1e-6)


def test_messages_that_are_late_move_nothing_that_stands():
    """A step of a rounded position within a tracker's period would look like metres a second."""
    motion, random = TrueMotion((0.0, 0.0, 0.0, 0.0)), np.random.default_rng(5)
    found, came_s = [], 50.0
    for k in range(2000):
        came_s = max(came_s, 50.0 + k / HZ + (0.2 if random.random() < 0.02 else 0.0))
        p = np.array([0.004 * math.sin(k / 100.0), 1.2345, 2.0])
        state = motion.on_sim_state(
            came_s, sim_state(p, (0, 0, 0), (0.004 * math.cos(k / 100.0), 0.0, 0.0))
        )
        found.append([state.stamp_s, *state.T_world_body[:3, 3]])
    found = np.array(found)
    assert np.abs(np.diff(found[:, 1:], axis=0)).max() < 0.001


def test_a_gap_in_its_messages_is_no_flight_through_it():
    motion = TrueMotion((0.0, 0.0, 0.0, 0.0))
    motion.on_sim_state(10.0, sim_state((0, 0, 0), (0, 0, 0), (2.0, 0, 0)))
    state = motion.on_sim_state(13.0, sim_state((5.0, 0, 1.0), (0, 0, 0), (2.0, 0, 0)))
    assert state.stamp_s == 13.0 and state.T_world_body[:3, 3] == pytest.approx(
        [5.0, 0, 1.0], abs=LSB_M
    )


def test_a_simulation_that_restarts_leaves_its_vehicle_where_it_stood():
    """ArduCopter's puts it back to its home, which a real one whose autopilot restarts does not
    do."""
    motion = TrueMotion((1.0, 0.0, 0.0, 0.0))
    motion.on_sim_state(10.0, sim_state((0, 0, 0), (0, 0, 0), (0, 0, 0)))
    landed = motion.on_sim_state(11.0, sim_state((3.0, -2.0, 0.02), (0, 0, 0.5), (0, 0, 0)))
    again = motion.on_sim_state(14.0, sim_state((0, 0, 0), (0, 0, 0), (0, 0, 0)))
    assert again.T_world_body[:2, 3] == pytest.approx(landed.T_world_body[:2, 3], abs=1e-6)
    assert transforms.yaw(again.T_world_body) == pytest.approx(0.5, abs=1e-6)
    moved = motion.on_sim_state(14.01, sim_state((0.02, 0, 0), (0, 0, 0), (2.0, 0, 0)))
    assert np.linalg.norm(moved.T_world_body[:3, 3] - again.T_world_body[:3, 3]) == pytest.approx(
        0.02, abs=0.005
    )


@pytest.mark.parametrize(
    "rpy, words", [((2.0, 0, 0), "on its side"), ((math.nan, 0, 0), "not finite")]
)
def test_a_pose_that_cannot_be_begins_no_flight(rpy, words):
    with pytest.raises(ElsewhereError, match=words):
        TrueMotion((0.0, 0.0, 0.0, 0.0)).on_sim_state(1.0, sim_state((0, 0, 0), rpy, (0, 0, 0)))


# ---- who may stand there -------------------------------------------------------------------------


@pytest.fixture
def elsewhere():
    made = []

    def make(**given):
        made.append(CopterElsewhere(**given))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_a_copter_that_tells_its_true_pose_may_fly(elsewhere):
    copter = elsewhere(speed=0.5)
    require_simulation(copter.url, "uav1", 1, 0.5)
    line, states, motion, until_s = (
        SimulationLine(copter.url),
        [],
        TrueMotion((0.0, 0.0, 0.0, 0.0)),
        time.monotonic() + 9,
    )
    while len(states) < 50 and time.monotonic() < until_s:
        message = line.receive(0.05)
        if message is not None and message.get_type() == "SIM_STATE":
            states.append(motion.on_sim_state(time.time(), message))
    line.close()
    assert len(states) == 50 and states[-1].T_world_body == pytest.approx(np.eye(4), abs=2e-2)


@pytest.mark.parametrize(
    "given, system, words",
    [
        ({"system": 2}, 1, "has system id 2, uav1.yaml says 1: start it with --sysid 1"),
        ({"truth": False}, 1, "tells no true pose"),
        (
            {"speed": 1.0},
            1,
            "the demo at 0.5: start it with --speedup 0.5, or the demo with SPEED=1",
        ),
        ({"vehicle": M.MAV_TYPE_GROUND_ROVER}, 1, "ArduRover answers"),
    ],
)
def test_who_cannot_fly_is_refused_by_name(elsewhere, monkeypatch, given, system, words):
    monkeypatch.setattr("fcsv_sim.autopilot.simulation_line._TELLS_S", 2.0)
    copter = elsewhere(**{"speed": 0.5, **given})
    with pytest.raises(ElsewhereError, match="uav1: ") as refused:
        require_simulation(copter.url, "uav1", system, 0.5)
    assert words in str(refused.value)


def test_one_that_flies_already_is_refused(elsewhere):
    copter = elsewhere(armed=True)
    with pytest.raises(ElsewhereError, match="is armed: land it"):
        require_simulation(copter.url, "uav1", 1)


def test_where_nobody_listens_it_is_said_at_once_and_what_to_do():
    began_s = time.monotonic()
    with pytest.raises(
        ElsewhereError,
        match=r"uav1: nobody listens at tcp:127.0.0.1:\d+ .*start ArduCopter's simulation",
    ):
        require_there([f"tcp:127.0.0.1:{free_port()}", "tcp:127.0.0.1:5770"], ["uav1", "uav2"], 1.0)
    assert time.monotonic() - began_s < 5.0


@pytest.mark.parametrize(
    "words, why",
    [
        ("udpin:127.0.0.1:14550", "give tcp:127.0.0.1:PORT"),
        ("tcp:192.168.1.5:5760", "give tcp:127.0.0.1:PORT"),
        ("tcp:127.0.0.1:80", "5760 or a port above it"),
        ("tcp:127.0.0.1:5760,tcp:localhost:5760", "stands there twice"),
    ],
)
def test_addresses_that_cannot_be_are_refused(words, why):
    with pytest.raises(MachineError, match=why):
        addresses(words)


@pytest.mark.parametrize(
    "arguments, why",
    [
        (
            ["--autopilot", "tcp:127.0.0.1:5760"],
            "names 1 autopilots, the mission flies 2: uav1, uav2",
        ),
        (
            ["--autopilot", "tcp:127.0.0.1:5760", "--system", "gimbal"],
            "in system gimbal no autopilot flies",
        ),
        (["--autopilot", "tcp:127.0.0.1:5760,x"], "--autopilot x: give tcp"),
    ],
)
def test_the_demo_refuses_before_anything_is_started(tmp_path, capsys, arguments, why):
    assert demo.main([*arguments, "--out", str(tmp_path / "out"), "--rviz", "0"]) == 2
    assert why in capsys.readouterr().err and not (tmp_path / "out" / "run").exists()


def test_errors_are_those_of_the_package():
    assert issubclass(ElsewhereError, FcsvError)
