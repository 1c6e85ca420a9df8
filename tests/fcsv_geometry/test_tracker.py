# SPDX-License-Identifier: Apache-2.0
"""The profile of a tracking camera: one file for what tracking assumes and what the simulated one does."""

import dataclasses
import doctest

import numpy as np
import pytest

from fcsv_geometry import tracker, transforms
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.tracker import TrackerProfile, load_profile


def test_identities_in_the_docstrings():
    result = doctest.testmod(tracker)
    assert result.attempted > 0 and result.failed == 0


def test_the_file_that_comes_along_is_the_t265_of_the_defaults(root):
    assert load_profile(str(root / "config" / "trackers" / "t265.yaml")) == load_profile() == TrackerProfile()


def test_what_the_file_says_counts_and_the_rest_stays(tmp_path):
    path = tmp_path / "worn.yaml"
    path.write_text("name: worn\nscale: 0.012\n")
    assert load_profile(str(path)) == dataclasses.replace(TrackerProfile(), name="worn", scale=0.012)


@pytest.mark.parametrize("text, field", [
    ("scale: -0.1", "scale"), ("rate_hz: 0", "rate_hz"), ("drift: 0.1", "drift"), ("name: a/b", "name"),
    ("noise_correlation_s: 0.0", "noise_correlation_s"), ("walk_m_per_sqrt_m: .nan", "walk_m_per_sqrt_m"),
])  # fmt: skip
def test_what_is_no_profile_names_file_and_field(tmp_path, text, field):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="bad.yaml") as error:
        load_profile(str(path))
    assert error.value.field == field


def test_the_simulated_tracker_does_what_its_own_profile_says():
    """Distances of 40 trackers over 100 m without other errors: scale 3 %, known to 11 % (1 sigma); three of them."""
    from fcsv_sim.sensors.t265 import T265

    exact = TrackerProfile(
        scale=0.03, walk_m_per_sqrt_m=0.0, heading_deg_per_sqrt_m=0.0, level_deg=0.0, position_noise_m=0.0,
        attitude_noise_deg=0.0,
    )  # fmt: skip
    lengths_m = []
    for seed in range(40):
        t265 = T265(exact, np.eye(4), seed)
        for x in (0.0, 100.0):
            T = t265.odometry(x, transforms.from_xyz_yaw([x, 0.0, 0.0], 0.0))[0]
        lengths_m.append(float(np.linalg.norm(T[:3, 3])))
    assert np.std(lengths_m) == pytest.approx(3.0, rel=0.34)
