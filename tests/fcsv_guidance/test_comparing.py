# SPDX-License-Identifier: Apache-2.0
"""A watching view against the maps: what all its pixels have wrong hides nothing, and what closed
ground is opened by views that see it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.comparing import compared
from fcsv_guidance.ground.known import STILL_VIEWS, GroundSeen, KnownGround, watch_seen
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.ground.tuning import FREE_P
from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.robot import load_robot

GRID = Grid.around((16, -8), (40, 8), 0.1)
HIGH = {"eye": (0.0, 0.0, 10.0), "tilt_rad": np.radians(18.0)}
WALL = (20.0, 20.3, 3.0, 7.0, 0.0, 1.0)
CRATE = (29.7, 30.3, -1.0, 1.0, 0.0, 1.1)
ON_CRATE = GRID.cell_of(30.0, 0.0)
#: of inverse depth (1/m): what wrong poses of cameras with 6 m between them share, and matching's
#: noise of 0.4 px; 600 px of focal length
SHARED, NOISE = 3e-3, 1.1e-4


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def live(scene):
    """A view as live matching makes it: its sigma is mostly that of the poses."""

    def made(boxes, number, shared=SHARED, noise=NOISE):
        view = scene(boxes, **HIGH).view(stamp_s=float(number), name="watch")
        random = np.random.default_rng(number)
        u = np.linspace(-0.5, 0.5, view.depth.shape[1])
        a, b = shared * random.standard_normal(2)
        inverse = 1.0 / view.depth + a + b * u + noise * random.standard_normal(view.depth.shape)
        sigma = np.hypot(shared, noise) * view.depth**2
        return replace(view, depth=(1.0 / inverse).astype(np.float32), sigma=sigma)

    return made


@pytest.fixture
def mapped(scene):
    return scene([WALL], **HIGH).view(stamp_s=0.0)


@pytest.fixture
def known(rescue, mapped):
    made = KnownGround(rescue)
    made.receive(GroundSeen(0.0, "map", ground_from([mapped], grid=GRID)), None)
    return made


def free(known):
    return known.stands[ON_CRATE] >= FREE_P


def test_a_crate_within_one_sigma_of_the_ground_is_seen_in_one_view(known, mapped, live):
    view = live([WALL, CRATE], 1)
    crate = (np.abs(view.depth - 30.0) < 4.0) & np.isfinite(mapped.depth)
    assert np.median(view.sigma[crate]) > 2.5 and free(known)
    aligned, shows = compared(view, [mapped], GRID)
    assert shows.noise < 3 * NOISE and shows.came[ON_CRATE] == 1.0 and not shows.same[ON_CRATE]
    assert np.nanmedian(np.abs(aligned.depth - mapped.depth)) < 0.2
    known.receive(watch_seen(view, [mapped], GRID), None)
    assert not free(known) and known.closed[ON_CRATE]
    assert "moves" in known.moving(1.1, RobotPlace(1.0, 26.0, 0.0, 0.0, 0.1))


def test_walls_whose_edges_are_blurred_hide_nobody(scene, live):
    """Live matching blurs a wall's edge over some pixels: what it is worth there is no noise of the
    ground between the walls."""
    walls = [(x, x + 0.3, y, y + 4.0, 0.0, 1.0) for x in (20, 24, 32, 36) for y in (-7, -2, 3)]
    walker = (27.7, 28.3, -0.3, 0.3, 0.0, 1.7)
    mapped = scene(walls, **HIGH).view(stamp_s=0.0)

    def shown(boxes, number):
        view = live(boxes, number, shared=SHARED / 3)
        inverse = cv2.blur(np.nan_to_num(1.0 / view.depth, nan=1.0 / 60.0), (9, 9))
        return replace(view, depth=np.where(np.isfinite(view.depth), 1.0 / inverse, np.nan))

    for number in range(1, 5):
        _, bare = compared(shown(walls, number), [mapped], GRID)
        _, shows = compared(shown([*walls, walker], number), [mapped], GRID)
        assert bare.noise < 3 * NOISE and shows.noise < 3 * NOISE
        assert shows.came[GRID.cell_of(28.0, 0.0)] == 1.0
        assert not bare.came.any() and not bare.went.any()


def test_views_without_a_thing_close_nothing(known, mapped, live):
    before = known.stands >= FREE_P
    for number in range(1, 6):
        known.receive(watch_seen(live([WALL], number), [mapped], GRID), None)
        assert not known.closed.any()
        assert (before & ~(known.stands >= FREE_P)).sum() <= 0.001 * before.sum()


def test_ground_is_free_again_after_three_views_that_see_it(known, mapped, live):
    known.receive(watch_seen(live([WALL, CRATE], 1), [mapped], GRID), None)
    for number in (2, 3):
        known.receive(watch_seen(live([WALL], number), [mapped], GRID), None)
        assert not free(known)
    known.receive(watch_seen(live([WALL], 4), [mapped], GRID), None)
    assert free(known)


def test_what_one_view_half_shows_closes_its_ground_until_one_view_sees_that(known, mapped, live):
    seen = watch_seen(live([WALL, CRATE], 1), [mapped], GRID)
    half = replace(seen.compared, came=0.5 * seen.compared.came)
    before = known.version
    known.receive(replace(seen, compared=half), None)
    assert known.version > before and known.closed[ON_CRATE] and not free(known)
    known.receive(watch_seen(live([WALL], 2), [mapped], GRID), None)
    assert known.version > before + 1 and not known.closed.any() and free(known)


def test_a_view_that_does_not_see_it_or_is_not_sure_neither_frees_nor_closes(known, mapped, live):
    blind = live([WALL], 2)
    xy = np.indices(blind.depth.shape)
    blind = replace(blind, kind=np.where(np.abs(xy[1] - 320) < 80, 0, blind.kind).astype(np.uint8))
    known.receive(watch_seen(live([WALL, CRATE], 1), [mapped], GRID), None)
    for number in range(2, 12):
        poor = live([WALL], number, noise=20 * NOISE)
        for view in (replace(blind, stamp_s=number + 0.5), poor):
            known.receive(watch_seen(view, [mapped], GRID), None)
            assert not free(known)


def test_what_hides_of_a_thing_is_free_again_with_the_ground_beside_it(known, mapped, live):
    """A strip of 0.5 m that the watch does not see lies across where the crate stood."""

    def striped(boxes, number):
        view = live(boxes, number)
        column = np.indices(view.depth.shape)[1]
        return replace(view, kind=np.where(np.abs(column - 320) < 6, 0, view.kind).astype(np.uint8))

    known.receive(watch_seen(live([WALL, CRATE], 1), [mapped], GRID), None)
    for number in range(2, 6):
        known.receive(watch_seen(striped([WALL, CRATE], number), [mapped], GRID), None)
        assert known.closed[ON_CRATE] and not free(known)
    for number in range(6, 12):
        seen = watch_seen(striped([WALL], number), [mapped], GRID)
        assert not seen.ground.known[ON_CRATE]
        known.receive(seen, None)
    assert not known.closed.any() and not known.changed.any() and free(known)


def test_a_cell_or_two_that_no_view_frees_go_with_the_thing(known, mapped, live):
    """As behind the robot itself: two of them held it for good, long after who came was gone."""
    row, column = ON_CRATE

    def without_two(seen):
        same = seen.compared.same.copy()
        same[row, column - 1 : column + 1] = False
        past = np.full_like(seen.compared.past, np.nan)
        return replace(seen, compared=replace(seen.compared, same=same, past=past))

    known.receive(watch_seen(live([WALL, CRATE], 1), [mapped], GRID), None)
    for number in range(2, 5):
        assert known.closed[ON_CRATE]
        known.receive(without_two(watch_seen(live([WALL], number), [mapped], GRID)), None)
    assert not known.closed.any() and free(known)


def test_a_wrong_depth_over_ground_that_a_wall_hides_ends_when_views_look_past_it(
    known, mapped, live
):
    """It hangs in the air behind the wall, before what is seen over the wall."""

    def wrong(number, near_m):
        view = live([WALL], number, shared=0.0)
        depth, kind = view.depth.copy(), view.kind.copy()
        v, u = np.indices(depth.shape)
        ray = np.stack([(u - view.K[0, 2]) / view.K[0, 0], (v - view.K[1, 2]) / view.K[1, 1]], -1)
        ray = np.dstack([ray, np.ones(depth.shape)]) @ view.T_home_cam[:3, :3].T
        at = ray * mapped.depth[..., None] + view.T_home_cam[:3, 3]
        spot = np.hypot(at[..., 0] - 24.0, at[..., 1] - 5.0) < 0.8
        if near_m is None:
            kind[spot] = 0
        else:
            depth[spot] -= near_m
        return replace(view, depth=depth, kind=kind)

    known.receive(watch_seen(wrong(1, 2.5), [mapped], GRID), None)
    for number in (2, 3, 4):  # views that have no depth there free what lies beside seen ground
        known.receive(watch_seen(wrong(number, None), [mapped], GRID), None)
    hung = known.closed
    assert hung.sum() > 10
    for number in (5, 6, 7):
        known.receive(watch_seen(live([WALL], number, shared=0.0), [mapped], GRID), None)
    assert not known.closed[hung].any()


def test_a_mapped_thing_that_goes_counts_no_more_by_two_views(rescue, scene, live):
    """One view that shows what lies behind it may be wrong; what it shows there no view sees
    again."""
    mapped = scene([WALL, CRATE], **HIGH).view(stamp_s=0.0)
    known = KnownGround(rescue)
    known.receive(GroundSeen(0.0, "map", ground_from([mapped], grid=GRID)), None)
    known.receive(watch_seen(live([WALL], 1), [mapped], GRID), None)
    assert not free(known) and not known.changed.any()
    for number in range(2, 6):
        view = live([WALL], number, shared=SHARED / 10)
        known.receive(watch_seen(view, [mapped], GRID), None)
    assert known.changed[ON_CRATE] and known.stands[ON_CRATE] > 0.8, "as free as one view says"


def test_a_hold_ends_by_views_and_not_by_time_alone(known, mapped, live):
    at = RobotPlace(1.0, 26.0, 0.0, 0.0, 0.1)
    known.receive(watch_seen(live([WALL, CRATE], 1), [mapped], GRID), None)
    assert known.moving(100.0, at)
    for number in range(2, 2 + STILL_VIEWS):
        assert known.moving(100.0, at)
        known.receive(watch_seen(live([WALL, CRATE], number), [mapped], GRID), None)
    assert not known.moving(100.0, at) and not free(known)


def test_what_comes_far_away_ends_no_hold(known, mapped, live):
    """As noise does: a robot drove on towards a crate that had just come."""
    at, far = RobotPlace(1.0, 26.0, 0.0, 0.0, 0.1), (36.0, 36.6, 3.0, 5.0, 0.0, 1.5)
    known.receive(watch_seen(live([WALL, CRATE], 1), [mapped], GRID), None)
    alone = known.moving(1.5, at)
    known.receive(watch_seen(live([WALL, CRATE, far], 2), [mapped], GRID), None)
    assert known.closed[GRID.cell_of(36.3, 4.0)] and known.moving(2.1, at) == alone
    for number in range(3, 3 + STILL_VIEWS):
        known.receive(watch_seen(live([WALL, CRATE, far], number), [mapped], GRID), None)
    assert not known.moving(100.0, at)


def test_the_robot_itself_closes_nothing(known, mapped, live):
    itself = (27.8, 28.3, -0.25, 0.25, 0.0, 0.7)
    at = RobotPlace(1.0, 28.1, 0.1, 0.0, 0.1)
    known.receive(watch_seen(live([WALL, itself], 1), [mapped], GRID), at)
    assert not known.closed.any() and not known.moving(1.1, at)


def test_the_robot_itself_measured_too_near_closes_nothing(known, mapped, live):
    """Its pixels differ by what noise allows: far away that is a metre along the line of sight."""
    itself = (35.7, 36.3, -0.3, 0.3, 0.0, 0.7)
    view, noise = live([WALL, itself], 1, noise=2 * NOISE), 2 * NOISE
    own = np.isfinite(mapped.depth) & (mapped.depth - view.depth > 0.8) & (view.depth > 32.0)
    near = 1.0 / (1.0 / view.depth + 2.5 * noise)
    view = replace(view, depth=np.where(own, near, view.depth).astype(np.float32))
    seen = watch_seen(view, [mapped], GRID)
    assert (seen.compared.came[:, GRID.cell_of(34.8, 0.0)[1]] > 0).any(), "it is seen there"
    known.receive(seen, RobotPlace(1.0, 36.0, 0.0, 0.0, 0.1))
    assert not known.closed.any() and not known.moving(1.1, RobotPlace(1.0, 36.0, 0.0, 0.0, 0.1))


def test_maps_of_another_place_say_nothing(mapped, live):
    view = live([WALL, CRATE], 1)
    T = mapped.T_home_cam.copy()
    T[0, 3] -= 9.0
    assert compared(view, [replace(mapped, T_home_cam=T)], GRID) == (view, None)
    assert compared(view, [], GRID)[1] is None
