# SPDX-License-Identifier: Apache-2.0
"""Maps of a flight's stations, joined as they come."""

import numpy as np
import pytest
from support.survey_views import camera_at, places, view

from fcsv_geometry import transforms
from fcsv_stereo.in_flight import live_site
from fcsv_stereo.in_flight.live_site import LiveSite
from fcsv_stereo.model import MapResult, Reference
from fcsv_stereo.survey.edges.features import located

POSES = {f"station {i} at 0 deg": camera_at(0.0, 6.0 * i) for i in range(3)}
#: Metres of the truth per metre of each map.
SCALES = dict(zip(POSES, (1.0, 1.015, 0.99)))


def result_of(name):
    v = view(name, POSES[name], scale=SCALES[name], sigma_share=0.012)
    reference = Reference("10", 10.0, "uav1", v.image, v.camera, POSES[name])
    return MapResult("joint", reference, [], [], v.depth, v.sigma, None, kind=v.kind)


@pytest.fixture
def site(monkeypatch):
    """Its views have features of one set of places, alike where they are the same place's."""
    points = places(300)
    matches = []

    def features_of(v):
        random = np.random.default_rng(list(POSES).index(v.name))
        in_cam = transforms.apply(transforms.invert(POSES[v.name]), points)
        z, c = in_cam[:, 2], v.camera
        uv = in_cam[:, :2] / z[:, None] * [c.fx, c.fy] + [c.cx, c.cy]
        uv += random.normal(0.0, 0.1, uv.shape)
        sigma = 1e-3 * z
        depth = (z + sigma * random.normal(size=len(z))) / SCALES[v.name]
        drawn = np.random.default_rng(1).normal(size=(len(z), 128))
        unit = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
        return located(c, uv, depth, sigma, unit.astype(np.float32))

    monkeypatch.setattr(live_site, "features_of", features_of)
    find = live_site.find_edge
    monkeypatch.setattr(
        live_site, "find_edge", lambda a, b, *f: matches.append((a.name, b.name)) or find(a, b, *f)
    )
    made = LiveSite()
    made.compared = matches
    return made


def test_stations_are_joined_as_they_come_and_each_pair_is_compared_once(site):
    first, second, third = POSES
    site.learn(first, result_of(first))
    assert not site.due  # one is no site
    site.learn(second, result_of(second))
    assert site.due
    joined = site.join()
    assert not site.due and (joined.views, joined.joined) == (2, 1)
    assert joined.words == "2 views, 1 of 1 pairs joined"
    site.learn(third, result_of(third))
    joined = site.join()
    assert joined.views == 3 and joined.joined == 3
    assert site.compared == [(first, second), (first, third), (second, third)]
    # a wall 40 m ahead; as flown the three maps have it 1.0 to 1.5 % apart
    wall_m = joined.cloud.points_home_m[:, 0]
    assert np.std(wall_m) < 0.15 and abs(np.median(wall_m) - 40.0) < 0.4
    assert (joined.cloud.baseline_index > 1).mean() > 0.5


def test_a_station_that_is_flown_again_takes_its_maps_place(site):
    first, second, _ = POSES
    for name in (first, second, second):
        site.learn(name, result_of(name))
    assert site.join().views == 2
    site.learn(first, result_of(first))
    assert site.join().views == 2 and len(site.compared) == 2


def test_a_map_without_any_sure_depth_is_left_out(site):
    first, second, _ = POSES
    site.learn(first, result_of(first))
    empty = result_of(second)
    empty.depth[:] = np.nan
    site.learn(second, empty)
    assert not site.due
