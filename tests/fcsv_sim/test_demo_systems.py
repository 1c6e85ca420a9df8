# SPDX-License-Identifier: Apache-2.0
"""What a demo refuses before it starts anything, and which maps belong to which mission."""

import errno
import json
import os
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.missions.mission import Mission, StereoConfiguration, load_mission
from fcsv_geometry.programs.writing import in_words
from fcsv_sim.bringup import mission_file
from fcsv_sim.demo import demo
from fcsv_sim.demo.fleet import FleetPlan, SimulatedFleet
from fcsv_sim.demo.pose_errors import tracked_errors
from fcsv_sim.demo.systems import SYSTEMS, T_WORLD_MOCAP
from fcsv_sim.machines.machines import MachineError
from fcsv_sim.ros.mocap_node import MocapNodeParameters
from fcsv_stereo.evaluating.truth import Truth


@pytest.fixture(autouse=True)
def free_processors(monkeypatch):
    """Tests that run beside these take nothing from a demo: tests/fcsv_sim/test_crowd.py."""
    monkeypatch.setattr(demo.CrowdWatch, "look_before", lambda self, say: None)


def mission(axis, baseline_m, height_m=1.7):
    return Mission(
        "m", [StereoConfiguration(axis, baseline_m)], "tello1", 0.7, home_height_m=height_m
    )


@pytest.mark.parametrize("system", SYSTEMS)
def test_every_system_can_fly_its_own_mission(system, root):
    own = load_mission(root / "config" / "missions" / f"{SYSTEMS[system].mission}.yaml")
    own.check_vehicles(SYSTEMS[system].vehicles)
    SYSTEMS[system].require(own)


def test_the_fleet_is_as_large_as_the_mission_wants(root):
    def fleet(name):
        return SYSTEMS["tags"].fleet(load_mission(root / "config" / "missions" / f"{name}.yaml"))

    assert fleet("short") == ("uav1", "uav2") and fleet("at_once") == ("uav1", "uav2", "uav3")


@pytest.mark.parametrize(
    "system, axis, baseline_m, height_m, words",
    [
        (
            "gimbal",
            "horizontal",
            7.0,
            1.7,
            ["configurations[0].baseline_m", "tello2", "from its gimbal"],
        ),
        (
            "gimbal",
            "vertical",
            3.0,
            1.7,
            ["configurations[0].baseline_m", "tello2", "from its gimbal"],
        ),
        ("gimbal", "horizontal", 2.0, 6.0, ["tello1", "home_height_m"]),
        ("mocap", "vertical", 1.0, 8.0, ["home_height_m", "mocap's view"]),
        ("mocap", "vertical", 25.0, 2.0, ["configurations[0].baseline_m", "odometry alone"]),
    ],
)
def test_what_the_tracker_cannot_follow_is_refused(system, axis, baseline_m, height_m, words):
    with pytest.raises(MissionError) as error:
        SYSTEMS[system].require(mission(axis, baseline_m, height_m))
    assert all(w in str(error.value) for w in words) and "\n" not in str(error.value)


def test_a_mission_that_plans_with_other_speeds_than_the_simulated_autopilots_have_is_refused(root):
    """The flight check would keep its vehicles on the ground."""
    slow = replace(
        load_mission(root / "config/missions/short.yaml"), flight=FlightBounds(speed_mps=1.0)
    )
    with pytest.raises(
        MissionError, match="plans with WPNAV_SPEED 100, the simulated autopilots have 200"
    ):
        SYSTEMS["tags"].require(slow)
    for name in ("at_once", "five", "ten", "sweep", "outdoor", "simulated_400m"):
        SYSTEMS["tags"].require(load_mission(root / f"config/missions/{name}.yaml"))


def test_the_view_that_is_checked_is_that_of_the_simulated_mocap():
    p = MocapNodeParameters(["tello1"], "nowhere")
    assert tuple(T_WORLD_MOCAP[:3, 3]) == p.xyz_m and p.rpy_deg == (0.0, -45.0, 0.0)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--system", "stars"], ["no system 'stars'", "tags, gimbal, mocap, guidance, tello"]),
        (["--system", "gimbal", "--mission", "short"], ["reference 'uav1'", "tello1, tello2"]),
        (["--mission", "mocap"], ["reference 'tello1'", "uav1, uav2"]),
        (["--mission", "five"], ["configurations[2].vehicle is 'uav4'", "uav1, uav2, uav3"]),
        (["--system", "mocap", "--mission", "nowhere"], ["no mission 'nowhere'", "mocap"]),
        (["--system", "mocap", "--live", "monitor"], ["--live monitor", "system mocap"]),
        (["--system", "mocap", "--movers", "1"], ["--movers 1", "system mocap"]),
        (["--world", "field", "--movers", "1"], ["a street that crosses"]),
        (["--system", "mocap", "--mission", "mocap", "--world", "maze"], ["guides no robot"]),
        (["--world", "maze", "--live", "monitor"], ["is watched with --movers 1"]),
        (["--system", "mocap", "--operator", "you"], ["--operator you", "system mocap"]),
    ],
)
def test_a_wrong_choice_is_one_line_and_starts_nothing(arguments, words, tmp_path, capsys):
    assert demo.main([*arguments, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert (
        said.count("\n") == 1 and all(w in said for w in words) and not (tmp_path / "out").exists()
    )


def test_what_an_interrupted_start_left_is_no_flight(tmp_path, monkeypatch):
    (tmp_path / "session" / "truth").mkdir(parents=True)
    (tmp_path / "session" / "truth" / "scene.ply").write_text("built")
    monkeypatch.setattr(demo, "run", lambda *_, **__: 0)
    assert demo.main(["--out", str(tmp_path), "--speed", "1"]) == 0


def test_a_recorded_flight_is_not_removed_unasked(tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    (out / "session").mkdir(parents=True)
    (out / "session" / "uav1.bag").write_text("flown")
    assert demo.main(["--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "holds a recorded flight: OVERWRITE=1 replaces it" in said
    assert (out / "session" / "uav1.bag").read_text() == "flown"
    plans = []
    monkeypatch.setattr(demo, "run", lambda system, plan, say, **_: plans.append(plan) or 0)
    assert (
        demo.main(["--out", str(out), "--overwrite", "1", "--speed", "1"]) == 0
        and plans[0].folder == out
    )
    assert (
        demo.main(["--out", str(out), "--overwrite", "1", "--speed", "1", "--operator", "you"]) == 0
    )
    assert [plan.buttons for plan in plans] == [True, False]


@pytest.mark.parametrize("more, start", [((), (-10.4, 4.0)), (("--start=-12,1",), (-12.0, 1.0))])
def test_who_guides_a_robot_looks_from_where_its_way_is_seen(more, start, tmp_path):
    wanted = ["--world", "low_maze", "--seed", "29", "--out", str(tmp_path / "out"), *more]
    plan = demo._plan(SYSTEMS["tags"], demo._parse(wanted))
    assert plan.mission_file.stem == "guide" and np.allclose(plan.start_xy_m, start, atol=0.1)
    assert bool(plan.looks) == (not more)
    (map_run,) = demo._maps(SYSTEMS["tags"], plan, None)
    assert map_run.arguments[:2] == ("--products", "ground")


def test_where_something_moves_the_robot_is_watched_in_flight(tmp_path):
    wanted = ["--world", "low_maze", "--seed", "29", "--movers", "1", "--mission", "guide"]
    plan = demo._plan(SYSTEMS["tags"], demo._parse([*wanted, "--out", str(tmp_path / "out")]))
    assert plan.mission_file.stem == "guide_watched" and plan.watch and plan.live
    assert not plan.movers and plan.captures_hz > 2.5
    assert plan.vehicles == ("uav1", "uav2", "uav3") and plan.follower == "uav3"
    text = mission_file("guide_watched").read_text()
    (tmp_path / "two.yaml").write_text(
        text.replace("vehicle: uav3, at_once: true", "vehicle: uav2")
    )
    wanted[-1] = str(tmp_path / "two.yaml")
    with pytest.raises(MachineError, match="two vehicles watch while a third follows"):
        demo._plan(SYSTEMS["tags"], demo._parse([*wanted, "--out", str(tmp_path / "out")]))


@pytest.mark.parametrize(
    "arguments, monitor, moving",
    [
        (["--mission", "at_once"], False, True),
        (["--mission", "at_once", "--movers", "0"], False, False),
        (["--mission", "at_once", "--world", "village", "--live", "monitor"], True, False),
        ([], False, False),
    ],
)
def test_what_moves_and_who_monitors(arguments, monitor, moving, tmp_path, monkeypatch):
    plans = []
    monkeypatch.setattr(demo, "run", lambda system, plan, say, **_: plans.append(plan) or 0)
    assert demo.main([*arguments, "--out", str(tmp_path / "out"), "--speed", "1"]) == 0
    (plan,) = plans
    assert (plan.monitor, bool(plan.movers)) == (monitor, moving) and not (
        plan.monitor and plan.live
    )


@pytest.mark.parametrize("below", ["", "deeper/still"])
def test_a_file_where_the_folder_should_be_is_named(below, tmp_path, capsys):
    (tmp_path / "out").write_text("a file")
    assert demo.main(["--out", str(tmp_path / "out" / below)]) == 2
    assert "a file stands there, not a folder" in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "a file"


@pytest.mark.parametrize(
    "text, words",
    [
        ("name: x\nconfigurations: []", ["configurations", "empty"]),
        (
            "name: x\nconfigurations: [{axis: horizontal, baseline_m: -2}]",
            ["configurations[0]", "baseline_m"],
        ),
        (
            "name: x\nconfigurations: [{axis: horizontal, baseline_m: 0.5}]",
            ["baseline_m", "separation"],
        ),
        (
            "name: x\nconfigurations: [{axis: horizontal, baselin_m: 2}]",
            ["unknown key", "baselin_m"],
        ),
    ],
)
def test_a_mission_that_cannot_be_flown_is_one_line_and_starts_nothing(
    text, words, tmp_path, capsys
):
    (tmp_path / "bad.yaml").write_text(text)
    assert demo.main(["--mission", str(tmp_path / "bad.yaml"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert (
        said.count("\n") == 1
        and all(w in said for w in ["bad.yaml", *words])
        and not (tmp_path / "out").exists()
    )


def test_a_mission_that_the_mission_node_would_refuse_is_refused_before_anything_starts(
    tmp_path, capsys
):
    """With the radius of the vehicles that fly it."""
    text = "name: x\nmin_separation_m: 0.3\nconfigurations: [{axis: horizontal, baseline_m: 2}]"
    (tmp_path / "close.yaml").write_text(text)
    assert (
        demo.main(["--mission", str(tmp_path / "close.yaml"), "--out", str(tmp_path / "out")]) == 2
    )
    said = capsys.readouterr().err
    assert (
        said.count("\n") == 1
        and "min_separation_m: 0.3 m is under" in said
        and not (tmp_path / "out").exists()
    )


@pytest.mark.parametrize(
    "more, words",
    [
        (["--start", "14"], "--start 14: give X,Y in m"),
        (["--start", "here,there"], "--start here,there: give X,Y in m"),
        (["--start", "nan,0"], "--start nan,0: the worlds end within 500 m"),
        (
            ["--start", "14,-10", "--system", "mocap"],
            "--start: system mocap flies before its tracker",
        ),
    ],
)
def test_a_start_that_is_nowhere_is_one_line_and_starts_nothing(more, words, tmp_path, capsys):
    assert demo.main([*more, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and words in said and not (tmp_path / "out").exists()


def test_the_column_stands_behind_the_start(tmp_path):
    plan = FleetPlan(tmp_path, tmp_path / "m.yaml", start_xy_m=(14.0, -10.0))
    assert [plan.start_xyz_yaw(k) for k in (0, 1)] == [
        [14.0, -10.0, 0.0, 0.0],
        [10.5, -10.0, 0.0, 0.0],
    ]


def test_the_map_of_the_thesis_is_made_where_its_baselines_were_flown(root):
    own = load_mission(root / "config" / "missions" / "mocap.yaml")
    assert [m.folder for m in SYSTEMS["mocap"].maps(own)] == ["map", "map_thesis"]
    assert [m.folder for m in SYSTEMS["mocap"].maps(mission("vertical", 1.0))] == ["map"]


def test_errors_of_poses_are_relative_to_the_reference_and_before_refinement(tmp_path):
    """Two pictures whose poses are told 3 cm and 0.5 degrees wrong in a home that the truth knows
    nothing of."""
    T_home_world = transforms.from_xyz_yaw([5.0, -2.0, 1.0], 0.7)
    true = {
        "tello1/10.000": np.eye(4),
        "tello2/11.000": transforms.from_xyz_yaw([0.0, -2.0, 0.0], 0.1),
    }
    wrong = transforms.from_xyz_yaw([0.0, 0.03, 0.0], np.radians(0.5))
    cameras = {("tello1", 10000): true["tello1/10.000"], ("tello2", 11000): true["tello2/11.000"]}
    told = {n: (T_home_world @ T).tolist() for n, T in true.items()}
    prior = (T_home_world @ true["tello2/11.000"] @ wrong).tolist()
    document = {
        "reference": {"image": "tello1/10.000", "T_home_cam": told["tello1/10.000"]},
        "images": [
            {"name": "tello1/10.000", "prior_T_home_cam": told["tello1/10.000"]},
            {
                "name": "tello2/11.000",
                "prior_T_home_cam": prior,
                "T_home_cam": told["tello2/11.000"],
            },
        ],
    }
    ((away_m, angle_deg),) = tracked_errors(document, Truth(tmp_path, cameras))
    assert away_m == pytest.approx(0.03) and angle_deg == pytest.approx(0.5)


def test_a_command_on_a_simulated_machine_has_its_master_and_clock(tmp_path, monkeypatch):
    monkeypatch.setenv("LD_PRELOAD", "")
    monkeypatch.setenv("FCSV_SLOW_MOTION", "/tmp/a page")
    fleet = SimulatedFleet(FleetPlan(tmp_path, tmp_path / "m.yaml"))
    fleet._write_description()
    on = tmp_path / "run" / "on_uav2"
    shown = subprocess.run(
        [on, "sh", "-c", "echo $ROS_MASTER_URI $FCSV_SLOW_MOTION"], capture_output=True, text=True
    )
    described = json.loads((tmp_path / "run" / "fleet.json").read_text())["uav2"]
    assert shown.stdout.split(" ", 1) == [described["ROS_MASTER_URI"], "/tmp/a page\n"]
    assert "not for a shell" in described["note"]
    assert subprocess.run([on], capture_output=True).returncode == 2


def test_what_the_disk_refuses_is_one_line(tmp_path, monkeypatch, capsys):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(tmp_path / "out" / "session"))

    monkeypatch.setattr(demo, "run", full)
    assert demo.main(["--out", str(tmp_path / "out"), "--speed", "1"]) == 2
    assert (
        capsys.readouterr().err
        == f"demo: {tmp_path}/out/session: {in_words(OSError(errno.ENOSPC, ''))}\n"
    )
