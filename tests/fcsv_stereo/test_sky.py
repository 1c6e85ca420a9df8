# SPDX-License-Identifier: Apache-2.0
"""The sky: from the top down to the skyline, and where no other picture shows it."""

import numpy as np
import pytest

from bench.hard_cases import moving_clouds as with_moving_clouds
from bench.scenes import HORIZONTAL, NOISES, SceneName, shoot
from fcsv_stereo.joint import Joint
from fcsv_stereo.joint.checks.sky import in_the_skyline, moved_clouds, sky
from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.views import Views, seen_by_any
from fcsv_stereo.model.kinds import DepthKind, supported

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
    """Whatever depth the match took there, as none can be right: near clouds, and trees at
    infinity."""
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
    """Sky between treetops, which has their depth: by its colour, where nothing near could have
    it."""
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
    """One that shifts by 30 px to the left at infinity sees all but the first 30 columns; another
    the last 60."""
    A = np.float32(
        [[1, 0, -30, 0, 1, 0, 0, 0, 1, 600, 0, 0], [1, 0, -60, 0, 1, 0, 0, 0, 1, 600, 0, 0]]
    )
    picture = np.zeros(SHAPE, np.float32)

    def seen(rows, w):
        n = len(rows)
        return seen_by_any(
            Views(picture, np.stack([picture] * n), np.array([SHAPE] * n), A[rows], np.zeros(3)), w
        )

    columns = np.arange(SHAPE[1])
    for rows, w, first in (([0, 1], 0.0, 30), ([1], 0.0, 60), ([1], 0.05, 30)):
        assert (seen(rows, w) == (columns >= first)).all()


def test_a_strip_of_bright_ground_below_what_stands_is_no_sky():
    """Beside the sky a column shows no other picture at all; along the lower edge none shows what
    looks like sky."""
    w, colour = land(clouds=5.0)
    blind = np.zeros(SHAPE, bool)
    blind[:, -10:] = blind[-12:] = True
    colour[-12:] = colour[:12]
    sky_there = found(w, colour, blind)
    assert not sky_there[-12:, :-10].any() and sky_there[: SKYLINE - 2].all()


# ---- clouds that moved between the pictures ------------------------------------------------------


def kinds_of(clouds, wall):
    """Kinds at full size: sky with a patch of ``clouds``, a ``wall`` that reaches the top, land."""
    kind = np.full((180, 240), DepthKind.SKY, np.uint8)
    kind[80:] = 3
    kind[10:60, 40:120] = clouds
    kind[:80, 180:] = wall
    return kind


def clouds_in(kind, seeing=3, edge=0.0):
    _, colour = land(clouds=0.0)
    colour[:SKYLINE, 90:] = colour[:SKYLINE, 89:90] - edge
    return moved_clouds(kind, np.full(SHAPE, seeing), colour)


def test_clouds_that_each_pair_finds_elsewhere_are_sky():
    random = np.random.default_rng(4)
    kind = kinds_of(random.choice([1] * 8 + [2, DepthKind.HIDDEN], (50, 80)), 3)
    clouds = clouds_in(kind)
    told = supported(kind[10:60, 40:120])
    assert clouds[10:60, 40:120][told].mean() > 0.95
    assert not clouds[10:60, 40:120][~told].any() and not clouds[80:].any()


def test_what_pairs_agree_on_stands_even_where_it_fades_into_the_sky():
    assert not clouds_in(
        kinds_of(DepthKind.SKY, np.random.default_rng(5).choice([1, 2, 3], (80, 60)))
    )[:, 180:].any()


def test_behind_an_edge_nothing_is_a_cloud():
    """A tower from the top of the picture that one pair alone answers."""
    assert not clouds_in(kinds_of(DepthKind.SKY, 1), edge=40.0)[:76, 184:].any()


def test_one_pair_alone_tells_no_cloud_from_a_wall():
    assert not clouds_in(kinds_of(1, 1), seeing=1).any()


def test_a_sky_whose_clouds_moved_between_the_pictures_has_no_depth():
    """11 % (street 11) and 49 % (village 12) of it had one, at 640x480; here at a quarter of the
    pixels."""
    place = SceneName("village", 12)
    scene = shoot(place, HORIZONTAL, (320, 240))
    given = with_moving_clouds(scene.given(HORIZONTAL, NOISES[0]), place, scene.depths)
    kind, heaven = Joint().map(given).kind, ~np.isfinite(scene.true_depth)
    assert heaven.mean() > 0.15 and supported(kind)[heaven].mean() < 0.01
    assert (kind[heaven] == DepthKind.SKY).mean() > 0.9 and (
        kind[~heaven] == DepthKind.SKY
    ).mean() < 0.005
