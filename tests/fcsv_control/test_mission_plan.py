# SPDX-License-Identifier: Apache-2.0
"""Plans flown on paper: what cannot be flown is refused before take-off, with the leg's name and
the reason."""

import doctest

import numpy as np
import pytest
import yaml

from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.plans import plan_check
from fcsv_geometry.errors import ConfigError, MissionError
from fcsv_geometry.missions import flight_limits
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.missions.mission import Mission, StereoConfiguration, load_mission
from fcsv_geometry.missions.sweep import Sweep

PAIR = ("uav1", "uav2")
FULL = {"uav1": 1.0, "uav2": 1.0}


def mission(*listed, **more):
    configurations = [
        StereoConfiguration(axis, m)
        for axis, m in listed or (("horizontal", 4.0), ("vertical", 5.0))
    ]
    return Mission("test", configurations, **more)


def check(m, vehicles=PAIR, shares=FULL, **more):
    return plan_check.check_plan(m, plan_check.on_the_ground(m, vehicles, shares), **more)


@pytest.mark.parametrize("name", ["outdoor", "short", "simulated_400m", "sweep"])
def test_the_missions_that_come_along_can_be_flown(root, name):
    m = load_mission(root / "config" / "missions" / f"{name}.yaml")
    for vehicles in (PAIR, ("uav1", "uav2", "uav3", "uav4", "uav5")):
        assert check(m, vehicles, dict.fromkeys(vehicles, 0.9)) == []


def test_a_height_beyond_the_fence_names_leg_and_reason():
    m = mission(("horizontal", 2.0), ("horizontal", 4.0), ("horizontal", 8.0), ("vertical", 60.0))
    assert check(m) == [
        "configurations[3] (vertical 60 m): 68 m above take-off, the fence ends at 40 m"
    ]


@pytest.mark.parametrize(
    "listed, fence, words",
    [
        (
            ("horizontal", 70.0),
            Fence(),
            "configurations[0] (horizontal 70 m): 70 m from home, the fence ends at 60 m",
        ),
        (("vertical", 33.0), Fence(), "configurations[0] (vertical 33 m): 41 m above take-off"),
        (("horizontal", 4.0), Fence(floor_m=9.0), "8.0 m above take-off, the fence begins at 9 m"),
        (
            ("horizontal", 4.0),
            Fence(polygon=[(5.0, 3.0), (5.0, -3.0), (-8.0, -3.0), (-8.0, 3.0)]),
            "configurations[0] (horizontal 4 m): (0.0, -4.0) m in home is outside of the fence's polygon",
        ),
    ],
)
def test_what_is_outside_of_the_fence(listed, fence, words):
    found = check(mission(listed, fence=fence))
    assert found and words in found[0]


def test_a_way_that_leaves_the_fence_is_found_though_both_its_ends_are_within():
    """A notch between the column and the place: both stand inside of the polygon, the straight way
    does not."""
    polygon = [
        (2.0, 2.0),
        (2.0, -12.0),
        (-5.0, -12.0),
        (-5.0, -11.0),
        (0.0, -11.0),
        (0.0, -6.0),
        (-0.4, -6.0),
        (-0.4, -1.0),
        (-5.0, -1.0),
        (-5.0, 2.0),
    ]
    found = check(mission(("horizontal", 10.0), fence=Fence(polygon=polygon)))
    assert len(found) == 1 and "configurations[0] (horizontal 10 m): on the way there" in found[0]


def test_a_place_beside_another_vehicle_is_refused_with_its_leg():
    """The third vehicle stands in the column where the second one's place is."""
    m = Mission(
        "test",
        [
            StereoConfiguration("vertical", 5.0),
            StereoConfiguration("horizontal", 2.0, vehicle="uav3"),
        ],
    )
    places = {
        "uav1": np.zeros(3),
        "uav2": np.array([0.0, -2.5, 0.0]),
        "uav3": np.array([-7.0, 0.0, 0.0]),
    }
    found = plan_check.check_plan(m, plan_check.Situation(8.0, places, {}))
    assert len(found) == 1 and found[0].startswith("configurations[1] (horizontal 2 m): ")
    assert "0.5 m from another vehicle, at least 1.5 m are needed" in found[0]


def sweep(*listed, **more):
    return StereoConfiguration(sweep=Sweep(*listed), **more)


def test_a_sweep_is_planned_as_a_way():
    """What it would come too near to, where it would leave the fence, and from where the next leg
    begins."""
    straight = Mission(
        "test", [sweep("horizontal", 2.0, 8.0, 1.5), sweep("vertical", 0.0, 7.0, 1.5, 8.0)]
    )
    places = {
        "uav1": np.zeros(3),
        "uav2": np.array([-3.5, 0.0, 0.0]),
        "uav3": np.array([0.3, -5.0, 1.0]),
    }
    assert (
        plan_check.check_plan(straight, plan_check.Situation(8.0, {n: places[n] for n in PAIR}, {}))
        == []
    )
    found = plan_check.check_plan(straight, plan_check.Situation(8.0, places, {}))
    assert len(found) == 1 and found[0].startswith(
        "configurations[0] (sweep horizontal 2 to 8 m): comes too near to uav3"
    )
    high = Mission("test", [sweep("vertical", 4.0, 34.0, 1.5)])
    assert check(high)[0].startswith("configurations[0] (sweep vertical 4 to 34 m): on its way 40.")
    assert check(Mission("test", [sweep("horizontal", 2.0, 50.0, 0.1)]))[0].startswith(
        "uav1 with 100% of its battery"
    )


def test_sweeps_at_once_keep_apart():
    trio = ("uav1", "uav2", "uav3")
    full = dict.fromkeys(trio, 1.0)
    side = sweep("horizontal", 2.0, 8.0, 1.0, vehicle="uav2")
    apart = Mission("test", [side, sweep("vertical", 4.0, 8.0, 1.0, vehicle="uav3", at_once=True)])
    assert check(apart, trio, full) == []
    same_end = Mission(
        "test", [side, sweep("vertical", 4.0, 0.0, 1.0, 8.0, vehicle="uav3", at_once=True)]
    )
    assert "uav2 and uav3 come too near to each other" in check(same_end, trio, full)[0]


def test_room_for_the_vehicles_outlines():
    m = mission(("horizontal", 4.0), min_separation_m=1.1)
    assert check(m) == []
    assert (
        "min_separation_m: 1.1 m is under 1.3 m"
        in check(m, radius_m={"uav1": 0.25, "uav2": 0.4})[0]
    )
    assert "is under 1 m" in check(mission(("horizontal", 4.0), min_separation_m=0.9))[0]


def test_a_battery_that_does_not_last_is_named():
    m = mission(*[("horizontal", 4.0)] * 10)
    assert check(m) == []
    found = check(m, shares={"uav1": 0.9, "uav2": 0.4})
    assert len(found) == 1 and found[0].startswith(
        "uav2 with 40% of its battery flies 180 s until 20% are left"
    )
    found = check(mission(*[("horizontal", 4.0)] * 60), shares={})
    assert "uav1 with a full battery" in found[0] and "1.3 times its time" in found[0]


def test_the_time_of_a_flight_is_near_that_of_the_state_machine(flight):
    """The reserve is 1.3: the plan's time must not be short by more, nor so long that good plans
    are refused."""
    m = mission(("horizontal", 4.0), ("horizontal", 8.0), ("vertical", 5.0), ("horizontal", 2.0))
    f = flight(m)
    f.up_to_configurations()
    begun_s = f.now_s
    f.phase("LAND")
    flown_s = f.now_s - begun_s
    situation = plan_check.on_the_ground(m, PAIR, {"uav1": 0.2 + 1e-9, "uav2": 1.0})
    needs = plan_check.check_plan(
        m, plan_check.Situation(8.0, situation.places, situation.battery_share, 0.0)
    )[0]
    planned_s = float(needs.split("needs ")[1].split(" s")[0]) / 1.3 - 30.0
    assert flown_s < 1.3 * planned_s and planned_s < 1.5 * flown_s


# ---- where it is used ----------------------------------------------------------------------------


def test_a_machine_with_a_plan_that_cannot_be_flown_is_not_made():
    with pytest.raises(
        MissionError, match=r"cannot be flown: configurations\[0\] \(vertical 60 m\): 68 m above"
    ):
        MissionMachine(mission(("vertical", 60.0)), PAIR)
    with pytest.raises(MissionError, match="radius"):
        MissionMachine(mission(), PAIR, {"uav1": 0.6, "uav2": 0.25})


def test_nobody_takes_off_with_batteries_that_do_not_last(flight):
    f = flight(mission(*[("horizontal", 4.0)] * 10))
    f.fleet["uav1"].battery_share = 0.4
    f.wait(3.0)
    assert (
        f.machine.phase == "WAIT_VEHICLES"
        and "uav1 with 40% of its battery" in f.machine.problems[0]
    )
    f.fleet["uav1"].battery_share = 0.95
    f.phase("TAKE_OFF", 5.0)


def test_execute_is_refused_from_a_home_that_is_too_high_and_home_is_set_again(flight):
    f = flight(mission(("vertical", 30.0)))
    f.up_to_home()
    for v in f.fleet.values():
        v.height_m = 15.0
    f.wait(1.2)
    refusal = f.operator.proceed("execute")
    assert (
        "configurations[0] (vertical 30 m): 45 m above take-off, the fence ends at 40 m" in refusal
    )
    assert f.machine.phase == "MOVE_HOME" and f.machine.detail == refusal
    for v in f.fleet.values():
        v.height_m = 8.0
    f.press("set_home")
    f.machine.answer("set_home", True, "set")
    f.press("execute")
    f.phase("CONFIGURATIONS")


@pytest.mark.parametrize(
    "document, words",
    [
        ({"fence": {"ceiling_m": 0.2}}, "fence.ceiling_m"),
        ({"fence": {"floor_m": -1.0}}, "fence.ceiling_m"),
        ({"fence": {"radius_m": 0.0}}, "fence.radius_m"),
        ({"fence": {"polygon": [[0, 0], [1, 1]]}}, "fence.polygon: 2 corners are no area"),
        ({"fence": {"height_m": 3.0}}, "unknown key 'fence.height_m'"),
        ({"flight": {"speed_mps": 0.0}}, "flight.speed_mps"),
        ({"flight": {"endurance_s": -5.0}}, "flight.endurance_s"),
        ({"limits": {"pause_s": 0.0}}, "limits.pause_s"),
        ({"limits": {"pilot": 3.0}}, "unknown key 'limits.pilot'"),
    ],
)
def test_bounds_that_are_none_are_one_line(tmp_path, document, words):
    path = tmp_path / "m.yaml"
    configurations = [{"axis": "vertical", "baseline_m": 5}]
    path.write_text(yaml.safe_dump({"name": "t", "configurations": configurations, **document}))
    with pytest.raises(ConfigError) as error:
        load_mission(path)
    assert words in str(error.value)


def test_a_file_may_state_all_of_them(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(
        "name: t\nconfigurations: [{axis: vertical, baseline_m: 5}]\nlimits: {pause_s: 30}\n"
        "fence: {ceiling_m: 20, polygon: [[9, 9], [9, -9], [-9, 0]]}\nflight: {speed_mps: 1.5}\n"
    )
    m = load_mission(path)
    assert (m.limits.pause_s, m.fence.ceiling_m, m.flight.speed_mps) == (30.0, 20.0, 1.5)
    assert m.fence.polygon == [(9.0, 9.0), (9.0, -9.0), (-9.0, 0.0)] and m.flight == FlightBounds(
        speed_mps=1.5
    )


def test_identities_in_the_docstrings():
    result = doctest.testmod(flight_limits)
    assert result.attempted > 0 and result.failed == 0
