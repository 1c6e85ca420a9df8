# SPDX-License-Identifier: Apache-2.0
"""Stations of a mission file: the list that they make, and one line for each that cannot be
flown."""

import dataclasses
import doctest
import json
import math

import numpy as np
import pytest

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions import stations
from fcsv_geometry.missions.camera_places import in_home, mover_place, reference_place
from fcsv_geometry.missions.mission import Mission, load_mission

LIST = [{"axis": "horizontal", "baseline_m": 4.0}, {"axis": "vertical", "baseline_m": 5.0}]
NORTH = {"name": "north", "place_m": [20.0, 10.0], "headings_deg": [90.0, 0.0]}
FIX = {"latitude_deg": 48.0, "longitude_deg": 11.0, "course_deg": 90.0}


def read(stations_, **more):
    document = {"name": "site", "configurations": LIST, "stations": stations_, **more}
    return config.from_mapping(document, Mission, "site.yaml")


def test_the_list_is_flown_at_every_heading_of_every_station():
    own = {"place_m": [0.0, -5.0], "headings_deg": [10], "configurations": LIST[:1]}
    mission = read([NORTH, own])
    assert [(c.axis, c.view) for c in mission.configurations] == [
        ("horizontal", 1),
        ("vertical", 1),
        ("horizontal", 2),
        ("vertical", 2),
        ("horizontal", 3),
    ]
    titles = [v.title for v in mission.viewpoints]
    assert titles == ["home", "north at 90 deg", "north at 0 deg", "station 2 at 10 deg"]
    assert mission.title(4) == "horizontal 4 m, station 2 at 10 deg"
    assert mission.moments() == [[0], [1], [2], [3], [4]]


def test_a_mission_without_stations_is_flown_from_home():
    mission = config.from_mapping({"name": "a", "configurations": LIST}, Mission, "a.yaml")
    assert [c.view for c in mission.configurations] == [0, 0] and len(mission.viewpoints) == 1
    assert mission.title(0) == "horizontal 4 m"
    T = reference_place(mission, 0)
    assert in_home(mission, 0, T) is T


def test_places_are_those_of_the_list_seen_from_the_station():
    """Right of a reference that looks to the left (home's y) is home's x."""
    mission = read([{**NORTH, "height_m": 11.0}])
    assert np.allclose(reference_place(mission, 1)[:3, 3], [20.0, 10.0, 3.0])
    assert np.allclose(mover_place(mission, 0)[:3, 3], [24.0, 10.0, 3.0])
    assert np.allclose(mover_place(mission, 0)[:3, 2], [0.0, 1.0, 0.0]), "it looks along home's y"
    assert np.allclose(mover_place(mission, 3)[:3, 3], [20.0, 10.0, 8.0])


def test_a_mission_that_is_changed_or_written_again_keeps_its_list():
    mission = read([NORTH])
    again = dataclasses.replace(mission, name="other")
    assert again.configurations == mission.configurations
    document = json.loads(json.dumps(dataclasses.asdict(mission)))
    assert config.from_mapping(document, Mission, "again").configurations == mission.configurations


def test_latitude_and_longitude_by_the_fix_of_home():
    """A degree of latitude is 111.2 km there, one of longitude 74.6 km; home looks east."""
    at = {"latitude_deg": 48.0002, "longitude_deg": 11.0003, "headings_deg": [0.0]}
    mission = read([at], home_fix=FIX)
    x, y, _ = mission.viewpoints[1].place_m
    assert (round(x, 1), round(y, 1)) == (22.4, 22.2)
    assert math.isclose(x, 0.0003 * 74625.0, rel_tol=2e-3)


@pytest.mark.parametrize(
    "listed, words",
    [
        ([{**NORTH, "headings_deg": []}], "stations[0].headings_deg: the list is empty"),
        ([{**NORTH, "headings_deg": [0, 400]}], "stations[0].headings_deg[1]: 400.0 is not in"),
        (
            [{**NORTH, "headings_deg": [0, 360]}],
            "stations[0].headings_deg[1]: 360.0 is the heading",
        ),
        ([{"headings_deg": [0]}], "stations[0].place_m: give either place_m, or latitude_deg"),
        ([{**NORTH, "latitude_deg": 3.0}], "stations[0].longitude_deg: is missing"),
        ([NORTH, NORTH], "stations[1].name: 'north' is another's"),
        ([{**NORTH, "name": "home"}], "stations[0].name: 'home' is another's"),
        ([{**NORTH, "place": [0, 0]}], "unknown key 'stations[0].place'"),
        ([{**NORTH, "place_m": [1.0]}], "'stations[0].place_m' must have 2 values"),
        (
            [{"latitude_deg": 48.0, "longitude_deg": 11.0, "headings_deg": [0]}],
            "stations[0].latitude_deg: needs the mission's home_fix",
        ),
        (
            [{**NORTH, "configurations": [{"axis": "vertical", "baseline_m": 1.0}]}],
            "stations[0].configurations[0].baseline_m: 1.0 is under the vehicles' minimum",
        ),
        (
            [{**NORTH, "configurations": [{**LIST[0], "at_once": True}]}],
            "stations[0].configurations[0].at_once: there is none before it",
        ),
    ],
)
def test_one_line_for_a_station_that_cannot_be_flown(listed, words):
    with pytest.raises(ConfigError) as error:
        read(listed)
    assert words in str(error.value)


@pytest.mark.parametrize("view, stations_", [(1, []), (7, [NORTH]), (-1, [NORTH])])
def test_viewpoints_that_are_not_there(view, stations_):
    with pytest.raises(ConfigError, match=r"configurations\[0\].view"):
        read(stations_, configurations=[{**LIST[0], "view": view}])


def test_lists_of_their_own_need_none_that_is_shared():
    own = {**NORTH, "configurations": LIST}
    assert len(read([own], configurations=[]).configurations) == 4
    with pytest.raises(ConfigError, match="the list is empty"):
        read([own, {"place_m": [0, 0], "headings_deg": [0]}], configurations=[])


def test_the_site_that_comes_along(root):
    mission = load_mission(root / "config" / "missions" / "site.yaml")
    assert len({v.station for v in mission.viewpoints[1:]}) == 3
    assert all(len(s.headings_deg) == 2 for s in mission.stations)


def test_examples():
    assert doctest.testmod(stations).failed == 0
