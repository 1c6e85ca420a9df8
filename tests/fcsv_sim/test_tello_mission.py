# SPDX-License-Identifier: Apache-2.0
"""A whole mission of two simulated Tellos before a mocap by the cores that fly it, faster than real time."""

import numpy as np
import pytest
from support.tello_mission import TelloMission

from fcsv_geometry.mission import load_mission
from fcsv_geometry.vehicle import load_vehicles

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", [1, 2])
def test_mission_agents_and_guardians_fly_tellos_as_they_fly_an_ardupilot(seed, tmp_path, root):
    """Bounds of a set-point: 0.15 m and 5 degrees, by the truth (docs/tello.md)."""
    mission = load_mission(root / "config" / "missions" / "tello.yaml")
    air = TelloMission(tmp_path, mission, load_vehicles(root / "config" / "vehicles", ["tello1", "tello2"]), seed)
    assert air.fly() == "DONE", air.phases[-10:]
    assert len(air.machine.captures) == len(mission.configurations)
    worst = {name: np.max(held, axis=0).round(3).tolist() for name, held in air.held.items()}
    print(f"held within {worst} (m, deg), nearest {air.nearest_m:.2f} m")
    assert all(off_m < 0.15 and off_deg < 5.0 for off_m, off_deg in worst.values())
    assert air.nearest_m > 0.4  # what a guardian keeps
    assert all(one.p_m[2] < 0.1 for one in air.tellos.values())
