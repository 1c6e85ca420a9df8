# SPDX-License-Identifier: Apache-2.0
"""The ground of a site by tiles is that of the whole."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.errors import GroundError
from fcsv_guidance.files import tiles
from fcsv_guidance.files.tiles import judged, judged_by_tiles
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.robot import load_robot

BOX = (12.0, 14.0, -2.0, 1.0, 0.0, 1.0)
BEAM = (16.0, 16.4, -6.0, 6.0, 0.6, 0.8)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def views(scene):
    """Two views, of which the second stands 3 m beside the first."""
    first = scene([BOX, BEAM]).view(noise=0.3, size=(320, 240), name="a")
    second = scene([BOX, BEAM], eye=(0.0, 3.0, 8.0)).view(
        noise=0.3, seed=1, size=(320, 240), name="b"
    )
    return [first, second]


def whole_of(views, robot, grid):
    return judged(ground_from(views, grid=grid), robot)


def test_tiles_are_the_whole(views, rescue):
    """Heights are sorted in steps of 5 mm from a height of the tile's own; p follows."""
    by_tiles = judged_by_tiles(views, rescue, 0.2, 30.0, tile_cells=40)
    whole = whole_of(views, rescue, by_tiles.ground.grid)
    assert by_tiles.ground.grid.rows > 2 * 40 and by_tiles.ground.views == ("a", "b")
    assert np.array_equal(by_tiles.ground.known, whole.ground.known)
    for name, values in whole.layers.items():
        found = by_tiles.layers[name]
        assert np.array_equal(np.isnan(found), np.isnan(values)), name
        both = np.isfinite(found) & np.isfinite(values)
        assert (np.abs(found[both] - values[both]) <= 0.01).mean() > 0.999, name
    assert (np.abs(by_tiles.occupied - whole.occupied) <= 1).mean() > 0.999  # of 100: p's 0.01
    assert np.array_equal(by_tiles.ground.seen_by, whole.ground.seen_by)


def test_a_tile_of_too_many_points_is_cut(views, rescue, monkeypatch):
    whole = judged_by_tiles(views, rescue, 0.2, 30.0, tile_cells=160)
    monkeypatch.setattr(tiles, "MOST_POINTS", 200_000)
    cut = judged_by_tiles(views, rescue, 0.2, 30.0, tile_cells=160)
    assert np.array_equal(whole.ground.known, cut.ground.known)
    monkeypatch.setattr(tiles, "MOST_POINTS", 10)
    with pytest.raises(GroundError, match="too many points show one place"):
        judged_by_tiles(views, rescue, 0.2, 30.0)


def test_a_view_that_shows_nothing_takes_no_other_with_it(views, rescue):
    blind = replace(views[1], sigma=np.full_like(views[1].sigma, np.nan))
    found = judged_by_tiles([views[0], blind], rescue, 0.2, 30.0)
    assert set(np.unique(found.ground.seen_by)) == {-1, 0}
    with pytest.raises(GroundError, match="no map was given"):
        judged_by_tiles([], rescue, 0.2, 30.0)
    with pytest.raises(GroundError, match="within 1 m of its camera"):
        judged_by_tiles(views, rescue, 0.2, 1.0)
