# SPDX-License-Identifier: Apache-2.0
"""A robot located by the gimbals on it, detector to filter in simulated time; more drives:
docs/lab/gimbal.md."""

import numpy as np
import pytest

from fcsv_guidance.robot import load_robot
from fcsv_sim.trials.robot_among_vehicles import Drive, Held, drive
from fcsv_tracking.gimbal.config import load_ground_robot


@pytest.mark.slow
def test_it_knows_its_place_past_vehicles_that_drift(root):
    gimbals = load_ground_robot(root / "config" / "gimbal" / "ground_robot.yaml").gimbals
    plan = Drive(points_m=((1.5, 0.3), (2.5, -0.3)), stands_s=4.0)
    held = [Held(1.0, 2.3, 1.8), Held(3.0, -2.3, 1.8)]
    robot = load_robot(root / "config" / "robots" / "small.yaml")
    outcome = drive(robot, gimbals, held, 1, plan)
    off_m, sigma_m, off_deg = np.array(
        [(j.error_m, j.sigma_m, j.error_deg) for j in outcome.judged]
    ).T
    assert outcome.unknown == 0 and outcome.way_m > 2.4
    assert np.sqrt(np.mean(off_m**2)) < 0.05 and np.sqrt(np.mean(off_deg**2)) < 1.5
    assert np.mean(off_m < 2 * sigma_m) >= 0.95
