# SPDX-License-Identifier: Apache-2.0
"""Trajectories: TUM files, ATE, RPE and drift against closed forms, and against evo where it is
installed."""

import json

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_tracking.commands.evaluate import main as evaluate_main
from fcsv_tracking.errors import EvaluationError
from fcsv_tracking.evaluation import metrics
from fcsv_tracking.evaluation.tracks import Track, read_truth, read_tum, write_tum


def flight(seed=0, count=400, rate_hz=20.0):
    """A smooth way of some 40 m."""
    random = np.random.default_rng(seed)
    stamps_s = 1_700_000_000.0 + np.arange(count) / rate_hz
    phase = random.uniform(0, 6, 6)
    t = np.arange(count) / rate_hz
    p = np.stack(
        [
            8 * np.sin(0.2 * t + phase[0]),
            6 * np.cos(0.3 * t + phase[1]),
            2 * np.sin(0.15 * t + phase[2]),
        ],
        -1,
    )
    rpy = np.stack([0.1 * np.sin(t + phase[3]), 0.1 * np.cos(0.8 * t + phase[4]), 0.3 * t], -1)
    return Track(stamps_s, np.stack([transforms.from_xyz_rpy(a, b) for a, b in zip(p, rpy)]))


def disturbed(track, seed=1):
    random = np.random.default_rng(seed)
    walk = np.cumsum(random.normal(0, 0.005, (len(track), 3)), axis=0)
    T = [
        transforms.transform(np.eye(3), w)
        @ A
        @ transforms.from_xyz_rpy(np.zeros(3), random.normal(0, 0.01, 3))
        for w, A in zip(walk, track.T_a_b)
    ]
    return Track(
        track.stamps_s, transforms.from_xyz_rpy([3.0, -2.0, 1.0], [0.0, 0.0, 0.8]) @ np.stack(T)
    )


def test_equal_trajectories_have_no_error_in_any_frame():
    track = flight()
    moved = Track(track.stamps_s, transforms.from_xyz_yaw([5.0, 3.0, -1.0], 2.0) @ track.T_a_b)
    for alignment in ("first", "yaw", "se3"):
        found = metrics.evaluate(moved, track, alignment)
        assert max(found.ate_m.max, found.rpe_m.max, found.ate_deg.max, found.rpe_deg.max) < 1e-5, (
            alignment
        )
    assert metrics.evaluate(moved, track, "none").ate_m.rmse > 1.0


def test_a_scale_error_is_its_share_per_metre():
    """2 % of scale on a straight line is 0.02 m/m, exactly; ATE after alignment is that of a line
    of 2 % more."""
    stamps_s = np.arange(201) / 10.0
    line = np.stack([transforms.from_xyz_yaw([0.1 * i, 0, 0], 0.0) for i in range(201)])
    longer = line.copy()
    longer[:, 0, 3] *= 1.02
    found = metrics.evaluate(Track(stamps_s, longer), Track(stamps_s, line), "first", delta_m=2.0)
    assert found.drift_m_per_m == pytest.approx(0.02, rel=1e-6) and found.drift_deg_per_m < 1e-6
    assert found.ate_m.max == pytest.approx(0.4) and found.path_m == pytest.approx(20.0)


def test_a_heading_drift_is_its_rate_per_metre():
    stamps_s = np.arange(201) / 10.0
    true = np.stack([transforms.from_xyz_yaw([0.1 * i, 0, 0], 0.0) for i in range(201)])
    bent = np.stack(
        [transforms.from_xyz_yaw([0.1 * i, 0, 0], np.radians(0.05 * i)) for i in range(201)]
    )
    found = metrics.evaluate(Track(stamps_s, bent), Track(stamps_s, true), "none")
    assert found.drift_deg_per_m == pytest.approx(0.5, rel=1e-6)


def test_the_reference_is_interpolated_not_snapped():
    track = flight()
    sparse = Track(track.stamps_s[::5], track.T_a_b[::5])
    found = metrics.evaluate(
        Track(track.stamps_s[:390], track.T_a_b[:390]), sparse, "none", gap_s=0.3
    )
    assert found.ate_m.max < 0.02  # the bend of the way between two poses 0.25 s apart: a t^2 / 8


def test_against_evo(tmp_path):
    """The same figures as the field's own tool, from files that it reads."""
    pytest.importorskip("evo")
    from evo.core import metrics as evo_metrics
    from evo.core.units import Unit
    from evo.tools import file_interface

    reference, estimate = flight(3), disturbed(flight(3))
    write_tum(tmp_path / "reference.tum", reference)
    write_tum(tmp_path / "estimate.tum", estimate)
    evo_reference = file_interface.read_tum_trajectory_file(str(tmp_path / "reference.tum"))
    evo_estimate = file_interface.read_tum_trajectory_file(str(tmp_path / "estimate.tum"))
    assert np.allclose(np.stack(evo_reference.poses_se3), reference.T_a_b, atol=1e-8)
    for relation, ours in (("translation_part", "rpe_m"), ("rotation_angle_deg", "rpe_deg")):
        rpe = evo_metrics.RPE(evo_metrics.PoseRelation[relation], 7, Unit.frames, all_pairs=True)
        rpe.process_data((evo_reference, evo_estimate))
        pairs = np.stack([np.arange(len(reference) - 7), np.arange(7, len(reference))], -1)
        errors = metrics.relative_errors(estimate.T_a_b, reference.T_a_b, pairs)[ours == "rpe_deg"]
        assert np.allclose(rpe.error, errors, atol=1e-6)
    evo_estimate.align(evo_reference)
    found = metrics.evaluate(estimate, reference, "se3")
    for relation, ours in (
        ("translation_part", found.ate_m),
        ("rotation_angle_deg", found.ate_deg),
    ):
        ape = evo_metrics.APE(evo_metrics.PoseRelation[relation])
        ape.process_data((evo_reference, evo_estimate))
        theirs = ape.get_all_statistics()
        for key in ("rmse", "mean", "median", "max"):
            assert getattr(ours, key) == pytest.approx(theirs[key], abs=1e-6), (relation, key)


def test_files_come_back(tmp_path):
    track = flight(4, 20)
    write_tum(tmp_path / "a.tum", track)
    again = read_tum(tmp_path / "a.tum")
    assert np.allclose(again.T_a_b, track.T_a_b, atol=1e-8) and np.allclose(
        again.stamps_s, track.stamps_s, atol=1e-6
    )


@pytest.mark.parametrize(
    "text, word",
    [
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0\n", "line 2"),
        ("1 0 0 0 0 0 0 1\n", "two or more"),
        ("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "pose 2 does not come after"),
        ("1 0 0 0 0 0 0 0\n2 0 0 0 0 0 0 1\n", "quaternion of pose 1"),
        ("1 0 0 nan 0 0 0 1\n2 0 0 0 0 0 0 1\n", "pose 1 is not finite"),
        ("", "0 poses"),
    ],
)
def test_what_is_no_trajectory_is_refused(tmp_path, text, word):
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(EvaluationError, match=word):
        read_tum(tmp_path / "a.tum")


def test_what_cannot_be_compared_is_refused():
    track = flight()
    later = Track(track.stamps_s + 1000.0, track.T_a_b)
    with pytest.raises(EvaluationError, match="by one clock"):
        metrics.evaluate(track, later)
    with pytest.raises(EvaluationError, match="--delta-m"):
        metrics.evaluate(track, track, delta_m=1e4)


def test_the_command(tmp_path, capsys):
    track = flight(5)
    estimate = disturbed(track)
    write_tum(tmp_path / "estimate.tum", estimate)
    rows = ["stamp_s,vehicle,x,y,z,qx,qy,qz,qw"]
    for stamp_s, T in zip(track.stamps_s, track.T_a_b):
        values = ",".join(f"{v:.9f}" for v in (*T[:3, 3], *transforms.quaternion_xyzw(T)))
        rows += [f"{stamp_s:.9f},uav1,{values}", f"{stamp_s:.9f},uav2,0,0,0,0,0,0,1"]
    (tmp_path / "cameras.csv").write_text("\n".join(rows) + "\n")
    files = [str(tmp_path / "estimate.tum"), str(tmp_path / "cameras.csv")]
    assert evaluate_main([*files, "--vehicle", "uav1", "-o", str(tmp_path / "found.json")]) == 0
    assert "drift" in capsys.readouterr().out
    found = json.loads((tmp_path / "found.json").read_text())
    expected = metrics.evaluate(estimate, read_truth(tmp_path / "cameras.csv", "uav1"))
    assert (
        found["ate_m"]["rmse"] == pytest.approx(expected.ate_m.rmse)
        and 0.001 < found["drift_m_per_m"] < 0.1
    )
    assert evaluate_main(files) == 2 and "uav1, uav2" in capsys.readouterr().err
    assert (
        evaluate_main([str(tmp_path / "none.tum"), files[1]]) == 2
        and "none.tum" in capsys.readouterr().err
    )


def test_export_of_a_session(tmp_path, capsys):
    rosbag = pytest.importorskip("rosbag")
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry

    from fcsv_geometry.ros import conversions
    from fcsv_tracking.commands.export_trajectories import main

    track = flight(6, 50)
    with rosbag.Bag(str(tmp_path / "uav1.bag"), "w") as bag:
        for stamp_s, T in zip(track.stamps_s, track.T_a_b):
            for topic, message in (
                ("odometry/body", Odometry()),
                ("camera_pose", PoseWithCovarianceStamped()),
            ):
                message.header = conversions.header(stamp_s, "uav1/odom")
                message.pose.pose = conversions.transform_to_pose(T)
                bag.write(f"/uav1/{topic}", message, message.header.stamp)
    assert main([str(tmp_path), "-o", str(tmp_path / "tum")]) == 0
    assert "uav1_odometry.tum: 50 poses" in capsys.readouterr().out
    for name in ("uav1_odometry", "uav1_camera"):
        assert np.allclose(read_tum(tmp_path / "tum" / f"{name}.tum").T_a_b, track.T_a_b, atol=1e-8)
    assert main([str(tmp_path / "tum"), "-o", str(tmp_path / "none")]) == 2
    assert "no trajectory" in capsys.readouterr().err
