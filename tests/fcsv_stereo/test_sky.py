# SPDX-License-Identifier: Apache-2.0
"""The sky: from the top down to the skyline, and where no other picture shows it."""

import numpy as np
import pytest

from fcsv_stereo.joint.checks.sky import in_the_skyline, sky
from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.views import Views, seen_by_any

SHAPE = (90, 120)
SKYLINE = 40
NEAR = np.float32(0.1)
SPEED = np.float32(600.0)  # px times metres: 1 m of baseline


def land(clouds=30.0):
    """Inverse depth and colour: sky with clouds (grey levels) over fields at 20 m."""
    random = np.random.default_rng(2)
    w = np.full(SHAPE, 0.05, np.float32)
    w[:SKYLINE] = 0.0
    colour = np.empty((*SHAPE, 3), np.float32)
    colour[:] = 90.0, 110.0, 60.0
    colour[:SKYLINE] = 170.0, 190.0, 220.0
    colour[:SKYLINE] += clouds * (np.indices(SHAPE)[1] // 17 % 2)[:SKYLINE, :, None]
    return w, colour + random.normal(0.0, 1.5, colour.shape).astype(np.float32)


def found(w, colour, blind=None):
    speed = np.full((1, *SHAPE), SPEED)
    nothing = np.zeros_like(speed)
    blind = np.zeros(SHAPE, bool) if blind is None else blind
    return sky(w, Residuals(nothing, nothing, speed, nothing, nothing), colour, blind)


def above():
    return np.arange(SHAPE[0])[:, None] * np.ones(SHAPE[1]) < SKYLINE


def test_sky_is_what_is_at_infinity_from_the_top_down():
    w, colour = land()
    w[60:70, 50:60] = 0.0  # a hole in the ground is none
    assert (found(w, colour) == above()).mean() > 0.99


def test_it_grows_back_to_the_skyline():
    w, colour = land(clouds=5.0)
    w[SKYLINE - 8 : SKYLINE] = 0.05  # windows carried the ground up
    right = found(w, colour) == above()
    right[SKYLINE - 1] = True  # the edge itself belongs to either
    assert right.all()


@pytest.mark.parametrize("width", [10, 40])
def test_where_no_other_picture_would_show_it_colour_decides(width):
    """Whatever depth the match took there, as none can be right: near clouds, and trees at infinity."""
    w, colour = land()
    blind = np.zeros(SHAPE, bool)
    blind[:, -width:] = True
    w[:, -width:] = np.random.default_rng(3).choice([0.0, NEAR], (SHAPE[0], width))
    assert (found(w, colour, blind) == above()).mean() > 0.99


def test_a_blind_border_at_the_top_does_not_hide_the_sky_below_it():
    w, colour = land()
    blind = np.zeros(SHAPE, bool)
    blind[:12] = True
    w[:12] = NEAR
    assert (found(w, colour, blind) == above()).mean() > 0.99


def test_without_any_sky_there_is_none():
    w, colour = land()
    blind = np.zeros(SHAPE, bool)
    blind[:, -30:] = True
    assert not found(np.full(SHAPE, NEAR), colour, blind).any()
    assert not found(w, colour, np.ones(SHAPE, bool)).any()


@pytest.mark.parametrize("channels", [1, 3])
def test_gaps_of_a_far_skyline_are_sky(channels):
    """Sky between treetops, which has their depth: by its colour, where nothing near could have it."""
    _, colour = land(clouds=5.0)
    told, gaps = ~above(), np.zeros(SHAPE, bool)
    gaps[SKYLINE : SKYLINE + 4, 20:100:7] = True
    colour[gaps] = colour[:SKYLINE].mean(axis=(0, 1))
    colour[80, 60] = colour[0, 0]  # far from the sky: something bright
    image = np.uint8(colour) if channels == 3 else np.uint8(colour.mean(axis=2))
    for moves_px, expected in ((8.0, gaps), (30.0, np.zeros_like(gaps))):
        moves = np.full(SHAPE, moves_px, np.float32)
        assert (in_the_skyline(above(), told, moves, image) == expected).all()
        assert not in_the_skyline(np.zeros(SHAPE, bool), told, moves, image).any()


def test_seen_by_any_pair():
    """One that shifts by 30 px to the left at infinity sees all but the first 30 columns; another the last 60."""
    A = np.float32([[1, 0, -30, 0, 1, 0, 0, 0, 1, 600, 0, 0], [1, 0, -60, 0, 1, 0, 0, 0, 1, 600, 0, 0]])
    picture = np.zeros(SHAPE, np.float32)

    def seen(rows, w):
        n = len(rows)
        return seen_by_any(Views(picture, np.stack([picture] * n), np.array([SHAPE] * n), A[rows], np.zeros(3)), w)

    columns = np.arange(SHAPE[1])
    for rows, w, first in (([0, 1], 0.0, 30), ([1], 0.0, 60), ([1], 0.05, 30)):
        assert (seen(rows, w) == (columns >= first)).all()
