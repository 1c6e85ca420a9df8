# SPDX-License-Identifier: Apache-2.0
"""The profile of a tracking camera: one file for what tracking assumes and what the simulated one
does."""

import dataclasses
import doctest

import numpy as np
import pytest

from fcsv_geometry import rotations, transforms
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.vehicles import tracker
from fcsv_geometry.vehicles.tracker import TrackerProfile, load_profile


def test_identities_in_the_docstrings():
    result = doctest.testmod(tracker)
    assert result.attempted > 0 and result.failed == 0


def test_the_file_that_comes_along_is_the_t265_of_the_defaults(root):
    assert (
        load_profile(str(root / "config" / "trackers" / "t265.yaml"))
        == load_profile()
        == TrackerProfile()
    )


def test_what_the_file_says_counts_and_the_rest_stays(tmp_path):
    path = tmp_path / "worn.yaml"
    path.write_text("name: worn\nscale: 0.012\n")
    assert load_profile(str(path)) == dataclasses.replace(
        TrackerProfile(), name="worn", scale=0.012
    )


@pytest.mark.parametrize(
    "text, field",
    [
        ("scale: -0.1", "scale"),
        ("rate_hz: 0", "rate_hz"),
        ("drift: 0.1", "drift"),
        ("name: a/b", "name"),
        ("noise_correlation_s: 0.0", "noise_correlation_s"),
        ("walk_m_per_sqrt_m: .nan", "walk_m_per_sqrt_m"),
    ],
)
def test_what_is_no_profile_names_file_and_field(tmp_path, text, field):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="bad.yaml") as error:
        load_profile(str(path))
    assert error.value.field == field


def test_the_simulated_tracker_does_what_its_own_profile_says():
    """Distances of 40 trackers over 100 m without other errors: scale 3 %, known to 11 % (1 sigma);
    three of them."""
    from fcsv_sim.sensors.t265 import T265

    exact = TrackerProfile(
        scale=0.03,
        walk_m_per_sqrt_m=0.0,
        heading_deg_per_sqrt_m=0.0,
        level_deg=0.0,
        position_noise_m=0.0,
        attitude_noise_deg=0.0,
    )
    lengths_m = []
    for seed in range(40):
        t265 = T265(exact, np.eye(4), seed)
        for x in (0.0, 100.0):
            T = t265.odometry(x, transforms.from_xyz_yaw([x, 0.0, 0.0], 0.0))[0]
        lengths_m.append(float(np.linalg.norm(T[:3, 3])))
    assert np.std(lengths_m) == pytest.approx(3.0, rel=0.34)


def test_a_simulated_tracker_without_errors_tells_the_truth():
    """Pose and velocities of a turning, climbing flight, to rounding: chord and angle of one step
    over its time."""
    from fcsv_sim.sensors.t265 import T265

    errors = ("scale", "walk_m_per_sqrt_m", "heading_deg_per_sqrt_m", "level_deg")
    noises = ("position_noise_m", "attitude_noise_deg")
    T_body_t265 = transforms.from_xyz_rpy([0.1, 0.02, -0.05], [0.1, 0.4, -0.3])
    t265 = T265(TrackerProfile(**dict.fromkeys(errors + noises, 0.0)), T_body_t265, 3)
    dt_s, told, true = 0.005, [], []
    for k in range(200):
        t_s = k * dt_s
        p_m, rpy_rad = (
            [2.0 * t_s, np.sin(t_s), 0.5 * t_s],
            [0.1 * t_s, 0.2 * np.sin(3.0 * t_s), 0.5 * t_s],
        )
        T = transforms.from_xyz_rpy(p_m, rpy_rad)
        true.append(T @ T_body_t265)
        told.append(t265.odometry(t_s, T))
    T_odom_world = told[0][0] @ transforms.invert(true[0])
    for (T_odom, linear, angular), T_before, T in zip(told[1:], true, true[1:]):
        assert np.allclose(T_odom_world @ T, T_odom, atol=1e-9)
        assert np.allclose(T[:3, :3] @ linear * dt_s, T[:3, 3] - T_before[:3, 3], atol=1e-9)
        turn = rotations.log(T_before[:3, :3].T @ T[:3, :3])
        # a step turns by 4e-3 rad; its cube over 6 is left out
        assert np.allclose(angular * dt_s, turn, atol=1e-6)
