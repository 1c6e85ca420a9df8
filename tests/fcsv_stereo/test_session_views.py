# SPDX-License-Identifier: Apache-2.0
"""Sessions that were recorded from several stations and headings: each is a view of its own."""

import doctest
import math

import numpy as np
import pytest
from support.sessions import T0, write_session

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError
from fcsv_stereo.pipeline import load
from fcsv_stereo.sessions import read_session, session_views
from fcsv_stereo.survey.views import inputs
from fcsv_stereo.survey.views.station import Station, flown_prior

WINDOWS = [(T0, T0 + 0.5), (T0 + 0.6, T0 + 1.0), (T0 + 1.1, T0 + 1.6)]
STATIONS = [("south", 0.0), ("south", math.radians(30.0)), ("north gate", math.radians(-30.0))]
VIEWS = ["south at 0 deg", "south at 30 deg", "north gate at -30 deg"]
LOOKING = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    windows = [(*w, *s) for w, s in zip(WINDOWS, STATIONS)]
    return write_session(tmp_path_factory.mktemp("flight") / "session", windows=windows)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return write_session(tmp_path_factory.mktemp("flight") / "plain")


def test_views_come_in_the_order_of_their_recordings(session, plain):
    assert session_views(session) == VIEWS and session_views(plain) == []


def test_one_view_is_read_at_a_time(session):
    given = read_session(session, VIEWS[1])
    stamps_s = [p.stamp_s for c in given.configurations for p in (*c.references, *c.others)]
    assert len(given.configurations) == 1
    assert T0 + 0.6 <= min(stamps_s) and max(stamps_s) <= T0 + 1.0


@pytest.mark.parametrize(
    "view, words",
    [
        ("", "was recorded from 3 views, 'south at 0 deg', "),
        ("", "choose one with --view, or join all with 'survey'"),
        ("south at 1 deg", "--view: "),
        ("south at 1 deg", "has no view 'south at 1 deg'; it has 'south at 0 deg', "),
    ],
)
def test_what_is_said_where_no_view_is_chosen(session, view, words):
    with pytest.raises(InputError) as error:
        read_session(session, view)
    assert words in str(error.value)


def test_a_session_without_stations_has_no_view_to_choose(plain, tmp_path):
    with pytest.raises(InputError, match="its mission had no stations"):
        load(plain, view="south at 0 deg")
    assert load(plain).configurations


def test_a_survey_takes_each_view_by_itself(session, plain):
    sources = inputs.sources_of([session, plain])
    assert [s.name for s in sources] == [
        "session-south_at_0_deg",
        "session-south_at_30_deg",
        "session-north_gate_at_-30_deg",
        "plain",
    ]
    assert [s.view for s in sources] == [*VIEWS, ""]
    assert inputs.sources_of([session])[0].name == "south_at_0_deg"  # one session names nobody
    assert [s.leads for s in sources] == [True, False, False, True]
    assert [s.in_site for s in sources] == [True, True, True, False]
    keys = list(inputs.source_keys(sources).values())
    assert len(set(keys)) == 4 and inputs.copies(dict(zip("abcd", keys))) == {}


def test_a_station_of_another_input_keeps_homes_apart(session, plain):
    file = plain / "station.yaml"
    file.write_text("{place_m: [0, 0, 0], heading_deg: 0, place_sigma_m: 1, heading_sigma_deg: 1}")
    try:
        assert not any(s.in_site for s in inputs.sources_of([session, plain]))
    finally:
        file.unlink()


# ---- what is known of a view's place -------------------------------------------------------------


def reference_at(x, y, heading_deg):
    return transforms.from_xyz_yaw([x, y, 0.0], math.radians(heading_deg)) @ LOOKING


def test_a_view_lies_where_its_trackers_say_and_errs_with_the_distance():
    near, far = (flown_prior(None, True, reference_at(x, 0.0, 30.0), "view") for x in (0.0, 100.0))
    assert np.allclose(far.T_site_cam, reference_at(100.0, 0.0, 30.0)) and far.placed
    assert near.place_m == 0.05 and math.isclose(far.place_m, math.hypot(1.0, 0.05))


def test_home_is_where_the_station_says():
    """A flight whose home looks to the left: its y is the site's -x."""
    station = Station((10.0, 20.0, 3.0), 90.0, 0.5, 1.0)
    prior = flown_prior(station, False, reference_at(0.0, 30.0, -90.0), "view")
    assert np.allclose(prior.T_site_cam[:3, 3], [-20.0, 20.0, 3.0])
    assert np.allclose(prior.T_site_cam[:3, 2], [1.0, 0.0, 0.0], atol=1e-9)
    turned_m = math.radians(1.0) * 30.0
    assert math.isclose(prior.place_m, math.sqrt(0.05**2 + 0.3**2 + 0.5**2 + turned_m**2))


def test_a_flight_that_nothing_ties_to_the_site_keeps_its_gravity_alone():
    prior = flown_prior(None, False, reference_at(5.0, 0.0, 0.0), "view")
    assert not prior.placed and math.isfinite(prior.tilt_rad)


def test_examples():
    assert doctest.testmod(inputs).failed == 0
