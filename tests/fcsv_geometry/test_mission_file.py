# SPDX-License-Identifier: Apache-2.0
"""The mission file: what is read, and one line for everything that cannot be flown."""

import dataclasses
import doctest

import pytest
import yaml

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError, MissionError
from fcsv_geometry.missions import mission as schema
from fcsv_geometry.missions import sweep
from fcsv_geometry.missions.mission import Mission, load_mission, spaced

GOOD = {
    "name": "test",
    "configurations": [{"axis": "horizontal", "baseline_m": 4.0, "record_s": 3.0}],
}


SWEEP = {"axis": "horizontal", "from_m": 2.0, "to_m": 8.0, "speed_mps": 1.5}


STATION = {"place_m": [0, 0], "headings_deg": [0]}
FOLLOW = {"axis": "horizontal", "baseline_m": 2.0, "follow_s": 60.0}


def written(tmp_path, document):
    path = tmp_path / "mission.yaml"
    path.write_text(document if isinstance(document, str) else yaml.safe_dump(document))
    return path


def changed(**change):
    return {**GOOD, **change}


def configured(**change):
    return {
        **GOOD,
        "configurations": [
            GOOD["configurations"][0],
            {"axis": "vertical", "baseline_m": 5.0, **change},
        ],
    }


def swept(**change):
    """A file whose only configuration is a sweep."""
    return changed(configurations=[{"sweep": {**SWEEP, **change}}])


def baselines(mission, axis):
    return [c.baseline_m for c in mission.configurations if c.axis == axis]


@pytest.mark.parametrize(
    "name, horizontal, vertical",
    [
        ("outdoor", [2, 4, 6, 8, 10], [5, 7, 10]),  # thesis 6.7
        ("simulated_400m", [2, 4, 6, 8], []),  # thesis 3.2
        ("short", [2, 4, 8], [5]),
    ],
)
def test_the_missions_that_come_along(root, name, horizontal, vertical):
    mission = load_mission(root / "config" / "missions" / f"{name}.yaml")
    assert mission.name == name and mission.reference == "uav1"
    assert (
        baselines(mission, "horizontal") == horizontal
        and baselines(mission, "vertical") == vertical
    )


def test_what_a_file_says_is_what_is_flown(tmp_path):
    document = changed(reference="uav2", min_separation_m=1.2, settle={"position_m": 0.2})
    document["configurations"] = [
        {"axis": "horizontal", "baseline_m": 3, "tilt_deg": 5, "vehicle": "uav3"}
    ]
    mission = load_mission(written(tmp_path, document))
    assert (mission.reference, mission.min_separation_m, mission.settle.position_m) == (
        "uav2",
        1.2,
        0.2,
    )
    c = mission.configurations[0]
    assert (c.title, c.record_s, mission.mover(0, ["uav1", "uav2", "uav3"])) == (
        "horizontal 3 m tilt 5 deg",
        5.0,
        "uav3",
    )


@pytest.mark.parametrize(
    "document, words",
    [
        (changed(speed=3), ["unknown key 'speed'", "known here"]),
        (configured(baseline=3.0), ["unknown key 'configurations[1].baseline'", "baseline_m"]),
        (configured(baseline_m=-4.0), ["configurations[1].baseline_m", "-4.0", "must be positive"]),
        (configured(baseline_m=3000), ["configurations[1].baseline_m", "3000", "over 100 m"]),
        (configured(baseline_m=0), ["configurations[1].baseline_m", "must be positive"]),
        (
            configured(baseline_m=1.0),
            ["configurations[1].baseline_m", "separation of 1.5 m", "longer baseline"],
        ),
        (configured(baseline_m=float("nan")), ["configurations[1].baseline_m", "must be finite"]),
        (configured(baseline_m="four"), ["configurations[1].baseline_m", "must be float"]),
        (
            configured(axis="diagonal"),
            ["configurations[1].axis", "'diagonal'", "horizontal, vertical"],
        ),
        (configured(record_s=0), ["configurations[1].record_s", "0.5..600"]),
        (configured(least_pictures=0), ["configurations[1].least_pictures", "1..1000"]),
        (configured(record_s=-1.0), ["configurations[1].record_s"]),
        (configured(tilt_deg=5.0), ["configurations[1].tilt_deg", "fixed camera", "set it to 0"]),
        (configured(vehicle="uav1"), ["configurations[1].vehicle", "is the reference"]),
        (
            {**GOOD, "configurations": [{"axis": "horizontal"}]},
            ["configurations[0].baseline_m", "is missing"],
        ),
        (
            {**GOOD, "configurations": [{"baseline_m": 4.0}]},
            ["configurations[0].axis", "is missing"],
        ),
        (swept(speed=1.0), ["unknown key 'configurations[0].sweep.speed'", "speed_mps"]),
        (swept(axis="up"), ["configurations[0].sweep.axis", "'up'", "horizontal, vertical"]),
        (
            swept(from_m=8.0),
            ["configurations[0].sweep.to_m", "less than 0.5 m from from_m", "{axis, baseline_m}"],
        ),
        (swept(from_m=-2.0), ["configurations[0].sweep.from_m", "-2.0", "0..100 m"]),
        (swept(to_m=300), ["configurations[0].sweep.to_m", "300", "0..100 m"]),
        (swept(speed_mps=0.0), ["configurations[0].sweep.speed_mps", "under 0.1 m/s"]),
        (swept(speed_mps=-1.0), ["configurations[0].sweep.speed_mps", "under 0.1 m/s"]),
        (swept(speed_mps=float("nan")), ["configurations[0].sweep.speed_mps", "must be finite"]),
        (
            swept(speed_mps=2.5),
            ["configurations[0].sweep.speed_mps", "2.5", "2 m/s that 'flight' allows"],
        ),
        (swept(axis="vertical", speed_mps=1.8), ["configurations[0].sweep.speed_mps", "1.5 m/s"]),
        (swept(from_m=1.0), ["configurations[0].sweep.from_m", "separation of 1.5 m"]),
        (
            swept(axis="vertical", from_m=0.0),
            ["configurations[0].sweep.from_m", "separation of 1.5 m"],
        ),
        (
            changed(configurations=[{"sweep": SWEEP, "axis": "vertical"}]),
            ["configurations[0].axis", "leave it out"],
        ),
        (
            changed(configurations=[{"sweep": SWEEP, "baseline_m": 3}]),
            ["configurations[0].baseline_m", "leave it out"],
        ),
        (
            changed(configurations=[{"sweep": SWEEP, "record_s": 3}]),
            ["configurations[0].record_s", "leave it out"],
        ),
        (
            changed(
                configurations=[
                    {"axis": "horizontal", "baseline_m": 4.0, "vehicle": "uav2"},
                    {"sweep": SWEEP, "vehicle": "uav3", "at_once": True},
                ]
            ),
            ["configurations[1].at_once", "all sweep or all stand"],
        ),
        (configured(follow_s=0.0), ["configurations[1].follow_s", "must be positive"]),
        (configured(follow_s=9e9), ["configurations[1].follow_s", "at most 3600 s"]),
        (configured(follow_s=9, record_s=3.0), ["configurations[1].record_s", "leave it out"]),
        (configured(follow_s=9, least_pictures=3), ["configurations[1].least_pictures", "leave"]),
        (configured(returns=True), ["configurations[1].returns", "give follow_s"]),
        (configured(follow_s=9, at_once=True), ["configurations[1].at_once", "leave it out"]),
        (
            changed(configurations=[{"sweep": SWEEP, "follow_s": 9.0}]),
            ["configurations[0].sweep", "leave it out"],
        ),
        (
            changed(configurations=[FOLLOW, GOOD["configurations"][0]]),
            ["configurations[0].follow_s", "only the last"],
        ),
        (
            changed(stations=[{**STATION, "configurations": [FOLLOW]}, STATION]),
            ["configurations[0].follow_s", "only the last"],
        ),
        (changed(configurations=[]), ["configurations", "empty", "at least one"]),
        (changed(configurations=None), ["configurations", "must be a list"]),
        ({"name": "test"}, ["'configurations' is missing"]),
        (changed(min_separation_m=-1.0), ["min_separation_m"]),
        (changed(column_spacing_m=1.2), ["column_spacing_m", "further apart"]),
        (changed(home_height_m=1.0), ["home_height_m", "at least 2.5"]),
        (changed(settle={"hold_m": 0.0}), ["settle.hold_m", "must be positive"]),
        (changed(low_battery_share=0.05), ["low_battery_share"]),
        ("name: [", ["not valid YAML", "line"]),
        ("- just\n- a list", ["must be a mapping"]),
        ("", ["must be a mapping", "nothing"]),
    ],
)
def test_what_cannot_be_flown_is_one_line(tmp_path, document, words):
    path = written(tmp_path, document)
    with pytest.raises(ConfigError) as error:
        load_mission(path)
    text = str(error.value)
    assert text.startswith(str(path)) and "\n" not in text
    for word in words:
        assert word in text


def test_a_sweep_is_read_and_survives_a_session_file(tmp_path):
    mission = load_mission(
        written(tmp_path, swept(axis="vertical", from_m=0.0, to_m=6.0, across_m=8.0))
    )
    c = mission.configurations[0]
    assert (c.axis, c.baseline_m, c.title) == ("vertical", 10.0, "sweep vertical 0 to 6 m at 8 m")
    assert [c.sweep.place_m(s).tolist() for s in (0.0, 1.0)] == [[0.0, -8.0, 0.0], [0.0, -8.0, 6.0]]
    assert c.sweep.takes_s(mission.flight) == pytest.approx(6.0 / 1.5 + 1.5 / 1.0), (
        "at its speed, with two ramps"
    )
    assert config.from_mapping(dataclasses.asdict(mission), Mission, "session") == mission


def test_one_that_follows_comes_last_and_is_not_recorded(tmp_path):
    document = changed(configurations=[*GOOD["configurations"] * 2, FOLLOW])
    mission = load_mission(written(tmp_path, document))
    assert [c.stands_s for c in mission.configurations] == [3.0, 3.0, 60.0]
    assert [mission.follows(i) for i in range(3)] == [False, False, True]
    assert mission.moments([2, 1, 0]) == [[1], [0], [2]]


def test_a_missing_file_is_one_line(tmp_path):
    with pytest.raises(ConfigError, match="nowhere.yaml: cannot be read"):
        load_mission(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    "change, vehicles, words",
    [
        ({}, ["uav1"], "two or more"),
        ({"reference": "uav9"}, ["uav1", "uav2"], "reference 'uav9'"),
        (
            {"configurations": [{"axis": "vertical", "baseline_m": 5, "vehicle": "uav7"}]},
            ["uav1", "uav2"],
            "'uav7'",
        ),
    ],
)
def test_a_fleet_that_does_not_fit(tmp_path, change, vehicles, words):
    mission = load_mission(written(tmp_path, changed(**change)))
    with pytest.raises(MissionError, match=words):
        mission.check_vehicles(vehicles)


@pytest.mark.parametrize(
    "document, field, problem",
    [
        (
            configured(baseline_m=1.0),
            "configurations[1].baseline_m",
            "is under the vehicles' minimum separation",
        ),
        (configured(record_s=0), "configurations[1].record_s", "is not in 0.5..600 s"),
        (configured(baseline_m="four"), "configurations[1].baseline_m", "must be float"),
        (configured(speed=3), "configurations[1].speed", "is not known"),
        (changed(settle={"hold_m": 0.0}), "settle.hold_m", "must be positive"),
        ({"name": "test"}, "configurations", "is missing"),
    ],
)
def test_the_error_carries_field_and_problem(tmp_path, document, field, problem):
    """For who gives advice of its own (the planner): nobody has to search the text."""
    with pytest.raises(ConfigError) as error:
        load_mission(written(tmp_path, document))
    assert (
        error.value.field == field
        and problem in error.value.problem
        and field not in error.value.problem
    )


@pytest.mark.parametrize("separation_m", [0.5, 1.5, 3.0, 5.0, 8.0])
def test_a_separation_with_the_hints_that_it_needs_is_a_mission(tmp_path, separation_m):
    document = changed(
        **spaced(separation_m), configurations=[{"axis": "horizontal", "baseline_m": 9.0}]
    )
    assert load_mission(written(tmp_path, document)).min_separation_m == separation_m
    if separation_m <= Mission.min_separation_m:
        assert (document["column_spacing_m"], document["home_height_m"]) == (3.5, 8.0)


def test_identities_in_the_docstrings():
    for module in (schema, sweep):
        result = doctest.testmod(module)
        assert result.attempted > 0 and result.failed == 0
