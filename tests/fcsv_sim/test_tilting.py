# SPDX-License-Identifier: Apache-2.0
"""The simulated tilting rig: its servos, its pictures, and the demo before thin things."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from fcsv_geometry import transforms
from fcsv_sim.demo import demo, tilting
from fcsv_sim.errors import SimulationError
from fcsv_sim.tilting.calibrated import calibrate_simulated
from fcsv_sim.tilting.rig import SimulatedRig, as_made
from fcsv_sim.tilting.things import THINGS
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_tracking.tilting.rig import TiltAngles, load_rig


@pytest.fixture(scope="module")
def rig(root):
    return load_rig(root / "config/tilting/rig.yaml")


class TestRig:
    def test_it_stops_near_what_it_was_told_and_reads_ticks(self, rig):
        simulated, goal = SimulatedRig(rig, seed=3), TiltAngles(0.4, 0.2)
        took_s = simulated.turn(goal)
        assert 0.38 < took_s < 1.0  # 23 degrees at 60 deg/s, and two ramps of 0.12 s
        tick = 2.0 * np.pi / 4096.0
        stops = np.radians(simulated.errors.stop_deg) + tick / 2.0
        assert np.abs(np.subtract(simulated.angles, goal)).max() <= stops
        assert (
            np.abs(np.subtract(simulated.read(), simulated.angles)).max()
            <= tick / 2 + np.radians(0.02) + 1e-9
        )
        assert np.allclose(np.remainder(np.add(simulated.read(), tick / 4) / tick, 1.0), 0.25)

    def test_rigs_differ_from_their_file_as_it_says(self, rig):
        """Forty rigs: the spread of the right camera's place is ``known`` to 25 % (two sigma of its
        estimate)."""
        told = rig.T_left_right(TiltAngles(0.0, 0.0))
        off = [
            SimulatedRig(rig, seed).true.T_left_right(TiltAngles(0.0, 0.0)) for seed in range(40)
        ]
        turn_deg = [np.degrees(transforms.rotation_angle(told, T)) for T in off]
        assert np.sqrt(np.mean(np.square(turn_deg)) / 3.0) == pytest.approx(
            rig.known.rotation_deg, rel=0.25
        )
        away_m = [T[:3, 3] - told[:3, 3] for T in off]
        assert np.std(away_m) == pytest.approx(rig.known.position_m, rel=0.25)

    def test_one_servo_turns_both(self, rig):
        simulated = SimulatedRig(replace(rig, right=replace(rig.right, servo=None)))
        simulated.turn(TiltAngles(0.3, 0.0))
        assert (
            simulated.angles.left_rad == simulated.angles.right_rad == pytest.approx(0.3, abs=2e-3)
        )

    def test_a_rig_as_made_is_known_after_calibration(self, rig):
        """A degree and millimetres off its drawing; what is left is what it says, four sigma of
        nine places."""
        simulated = SimulatedRig(rig, built=as_made)
        found = calibrate_simulated(simulated).rig
        assert max(away(rig, simulated.true)) > 0.5 and simulated.told is rig
        turn_deg, away_m = away(found, simulated.true)
        assert (
            turn_deg < 4.0 * found.known.rotation_deg < 0.2
            and away_m < 4.0 * found.known.position_m < 0.004
        )


def away(found, true):
    """Of the right camera against the left one: degrees and m, worst of three angles."""
    T = [[r.T_left_right(TiltAngles(a, a)) for a in (0.0, 0.25, 0.5)] for r in (found, true)]
    turns = [np.degrees(transforms.rotation_angle(a, b)) for a, b in zip(*T)]
    return max(turns), max(float(np.linalg.norm(a[:3, 3] - b[:3, 3])) for a, b in zip(*T))


@pytest.mark.parametrize("name", THINGS)
def test_things_are_about_their_place_and_thin(name):
    mesh = MeshBuilder()
    THINGS[name](mesh, np.array([5.0, 1.0, 2.0]))
    vertices, triangles, *_ = mesh.build()
    assert np.isfinite(vertices).all() and triangles.max() < len(vertices)
    near = vertices[np.linalg.norm(vertices - [5.0, 1.0, 2.0], axis=1) < 0.4]
    assert len(near) > 30 and np.ptp(near[:, 0]) < 0.5


class TestDemo:
    def test_it_refuses_missions_and_leaves_what_is_there(self, tmp_path, capsys):
        assert (
            demo.main(["--system", "tilting", "--mission", "short", "--out", str(tmp_path / "o")])
            == 2
        )
        assert (
            "system tilting flies none" in capsys.readouterr().err and not (tmp_path / "o").exists()
        )
        elsewhere = ["--autopilot", "tcp:127.0.0.1:5760", "--out", str(tmp_path / "o")]
        assert demo.main(["--system", "tilting", *elsewhere]) == 2
        assert "in system tilting no autopilot flies" in capsys.readouterr().err
        for there, words in (("pairs", "OVERWRITE=1"), ("session", "recorded flight")):
            out = tmp_path / there
            (out / there).mkdir(parents=True)
            with pytest.raises(SimulationError, match=words):
                tilting.run(out, print)
            assert (out / there).is_dir()

    @pytest.mark.slow
    def test_a_valve_near_by_is_whole_where_cameras_are_tilted(self, root, tmp_path):
        """At half the size: parallel cameras 0.3 m apart lose part of what is 0.4 m away, tilted
        ones none of it."""
        document = yaml.safe_load((root / "config/tilting/rig.yaml").read_text())
        for side in ("left", "right"):
            document[side]["camera"] = {
                "width": 320,
                "height": 240,
                "fx": 300.9,
                "fy": 300.9,
                "cx": 159.5,
                "cy": 119.5,
            }
        (tmp_path / "rig.yaml").write_text(yaml.safe_dump(document))
        said = []
        rig_file, out = str(tmp_path / "rig.yaml"), tmp_path / "out"
        assert (
            tilting.run(out, said.append, things=["valve"], distances_m=[0.4], rig_file=rig_file)
            == 0
        )
        assert any("live depth of valve at 0.4 m" in line for line in said)
        for name in ("curves.png", "pictures.png", "live.png"):
            assert (tmp_path / "out" / name).stat().st_size > 5000
        rows = [
            r.split(" | ")
            for r in (tmp_path / "out/table.md").read_text().splitlines()
            if r.startswith("| valve")
        ]
        assert [(r[1], r[2] == "parallel") for r in rows] == [("0.4 m", True), ("0.4 m", False)]
        shown, right = ([float(r[k].rstrip("%")) for r in rows] for k in (3, 5))
        assert shown[0] < 75.0 and shown[1] > 85.0  # its pipe is cut above and below in both
        assert right[1] > right[0] + 10.0
