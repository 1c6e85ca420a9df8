# SPDX-License-Identifier: Apache-2.0
"""A whole mission of two simulated Tellos before a mocap by the cores that fly it, faster than real
time."""

import numpy as np
import pytest
from support.tello_mission import TelloMission

from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.vehicles.vehicle import load_vehicles

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", [1, 2])
def test_mission_agents_and_guardians_fly_tellos_as_they_fly_an_ardupilot(seed, tmp_path, root):
    """Bounds of a set-point: 0.15 m and 5 degrees, by the truth (docs/lab/autopilot.md)."""
    mission = load_mission(root / "config" / "missions" / "tello.yaml")
    air = TelloMission(
        tmp_path, mission, load_vehicles(root / "config" / "vehicles", ["tello1", "tello2"]), seed
    )
    assert air.fly() == "DONE", air.phases[-10:]
    assert len(air.machine.captures) == len(mission.configurations)
    worst = {name: np.max(held, axis=0).round(3).tolist() for name, held in air.held.items()}
    print(f"held within {worst} (m, deg), nearest {air.nearest_m:.2f} m")
    assert all(off_m < 0.15 and off_deg < 5.0 for off_m, off_deg in worst.values())
    assert air.nearest_m > 0.4  # what a guardian keeps
    assert all(one.p_m[2] < 0.1 for one in air.tellos.values())


def lost_wifi(air, name, since_s):
    (air.deaf.add if since_s < 10.0 else air.deaf.discard)(name)


def lost_tracking(air, name, since_s):
    (air.unseen.add if since_s < 3.0 else air.unseen.discard)(name)


def low_battery(air, name, since_s):
    air.battery[name] = max(0.9 - 0.3 * since_s, 0.08)


@pytest.mark.parametrize("fault", [lost_wifi, lost_tracking, low_battery])
def test_a_fault_while_one_is_above_the_other_is_held_or_landed_and_nobody_is_hit(
    fault, tmp_path, root
):
    """Of tello2, from the moment at which pictures of the vertical pair are recorded: it is 1 m
    above tello1."""
    mission = load_mission(root / "config" / "missions" / "tello.yaml")
    air = TelloMission(
        tmp_path, mission, load_vehicles(root / "config" / "vehicles", ["tello1", "tello2"])
    )
    began_s = []

    def meanwhile(air):
        if not began_s and len(air.machine.captures) == 1 and air.boards["tello2"].recording:
            began_s.append(air.now_s)
        if began_s:
            fault(air, "tello2", air.now_s - began_s[0])

    end = air.fly(meanwhile=meanwhile)
    print(f"{end}, {air.now_s - began_s[0]:.0f} s after it began, nearest {air.nearest_m:.2f} m")
    assert began_s and end in ("DONE", "ABORTED"), air.phases[-10:]
    assert air.nearest_m > 0.4  # what a guardian keeps; bodies touch at 0.24 m
    assert all(one.p_m[2] < 0.1 and not one.core.flying for one in air.tellos.values())
