# SPDX-License-Identifier: Apache-2.0
"""Robots' files: read, and refused with file and field."""

import pytest

from fcsv_geometry.errors import ConfigError
from fcsv_guidance.robot import load_robot


def test_the_robots_of_the_repository_are_read(root):
    robots = {path.stem: load_robot(path) for path in (root / "config/robots").glob("*.yaml")}
    assert {name: robot.radius_m for name, robot in robots.items()} == {
        "small": 0.15,
        "rescue": 0.4,
    }
    assert all(name == robot.name for name, robot in robots.items())


@pytest.mark.parametrize(
    "line, words",
    [
        ("radius_m: -0.4", "radius_m: must be positive"),
        ("radius_m: .nan", "'radius_m' must be finite"),
        ("height_m: 0.1", "clearance_m: must be below height_m"),
        ("largest_slope_deg: 80", "largest_slope_deg: at most 60"),
        ("largest_slope_deg: 0.43", "is it in radians?"),
        ("radius_m: 400", "radius_m: at most 10 m, got 400.0; is it in cm or mm?"),
        ("height_m: 70", "height_m: at most 10 m"),
        ("radius_m: 1.0e-300", "radius_m: at least 0.01 m"),
        ("speed_mps: 3000", "speed_mps: at most 20 m/s, got 3000.0; is it in cm/s or mm/s?"),
        ("acceleration_mps2: 60", "acceleration_mps2: at most 20 m/s^2"),
        ("braking_mps2: 150", "braking_mps2: at most 20 m/s^2"),
        ("turning_rate_radps: 45", "at most 10 rad/s, got 45.0; is it in degrees a second?"),
        ("turning_radius_m: 1.0e+9", "turning_radius_m: at most 100 m"),
        ("radius_m: " + "9" * 400, "'radius_m' is too large"),
        ('name: "a\\nb"', "name: must be a word or more, on one line"),
        ("turning_radius_m: -1", "turning_radius_m: must not be negative"),
        ("wheels: 4", "unknown key 'wheels'"),
    ],
)
def test_a_wrong_field_is_named_with_its_file(root, tmp_path, line, words):
    text = (root / "config/robots/rescue.yaml").read_text().splitlines()
    key = line.split(":")[0] + ":"
    path = tmp_path / "mine.yaml"
    path.write_text("\n".join([t for t in text if not t.startswith(key)] + [line]))
    with pytest.raises(ConfigError, match="mine.yaml") as caught:
        load_robot(path)
    assert words in str(caught.value)
