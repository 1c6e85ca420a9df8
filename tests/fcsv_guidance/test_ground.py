# SPDX-License-Identifier: Apache-2.0
"""The ground model on drawn scenes with known truth."""

import time
from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.fitting import require_one_frame
from fcsv_guidance.ground.model import cell_probability, ground_from, renewed, stand_probability
from fcsv_guidance.ground.tuning import FREE_P, OBSTACLE_P
from fcsv_guidance.robot import load_robot
from fcsv_stereo.model.kinds import DepthKind

GRID = Grid.around((5, -20), (45, 20), 0.1)
WALL = (20.0, 20.3, -4.0, 4.0, 0.0, 1.0)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def small(root):
    return load_robot(root / "config/robots/small.yaml")


def cells(x0, x1, y0, y1):
    (r0, c0), (r1, c1) = GRID.cell_of(x0 + 0.01, y0 + 0.01), GRID.cell_of(x1 - 0.01, y1 - 0.01)
    return slice(r0, r1 + 1), slice(c0, c1 + 1)


def test_level_ground_is_free_and_a_wall_is_an_obstacle(scene, rescue):
    ground = ground_from([scene([WALL]).view(noise=0.3)], grid=GRID)
    stands = stand_probability(ground, rescue)
    assert (stands[cells(10, 18, -3, 3)] >= FREE_P).mean() > 0.99
    assert (stands[cells(19.7, 20.3, -4, 4)] <= OBSTACLE_P).all()
    assert abs(ground.height_m[cells(10, 18, -3, 3)]).max() < 0.05  # sigma there is 0.02 m at most


def test_what_a_wall_hides_is_unknown(scene, rescue):
    """From 8 m above, a wall of 1 m whose far face is at 20.3 m hides the ground to 20.3 * 8 / 7 =
    23.2 m."""
    ground = ground_from([scene([WALL]).view()], grid=GRID)
    behind = cells(20.5, 22.6, -3, 3)
    assert not ground.known[behind].any() and ground.known[cells(23.8, 26, -3, 3)].all()
    assert not (stand_probability(ground, rescue)[behind] >= FREE_P).any()
    assert (ground.seen_by[behind] == -1).all() and np.isnan(ground.seen_s[behind]).all()


def test_a_blank_stays_unknown(scene):
    ground = ground_from([scene(blank=[(14, 17, -2, 2)]).view()], grid=GRID)
    assert not ground.known[cells(14.6, 16.4, -1.8, 1.8)].any()


def test_what_no_other_picture_saw_is_unknown_and_no_wall(scene, rescue):
    """At a map's lower edge the surface above it goes on; flown: 27.8 m in place of 26 m."""
    view = scene().view(noise=0.3)
    row = 5 * view.depth.shape[0] // 6
    depth, kind = view.depth.copy(), view.kind.copy()
    depth[row:], kind[row:] = depth[row], DepthKind.OUTSIDE
    whole = ground_from([view], grid=GRID)
    ground = ground_from([replace(view, depth=depth, kind=kind)], grid=GRID)
    assert (whole.known & ~ground.known).any() and np.nanmin(ground.height_m) > -0.1
    near = stand_probability(ground, rescue)[cells(5, 25, -10, 10)]
    assert (near >= FREE_P).any() and not (near <= OBSTACLE_P).any()


@pytest.mark.parametrize("noise, seed", [(0.5, 1), (1.0, 2), (1.0, 3)])
def test_free_is_calibrated(scene, rescue, noise, seed):
    """Of the cells called free at most 5 % are not: blocks of 0.3 m, steps of 0.2 m, noise of up to
    one sigma."""
    random = np.random.default_rng(seed)
    boxes = []
    for _ in range(25):
        x, y, side = random.uniform(10, 32), random.uniform(-8, 8), random.uniform(0.3, 1.0)
        boxes.append((x, x + side, y, y + side, 0.0, random.choice([0.2, 0.3, 0.6])))
    free = (
        stand_probability(ground_from([scene(boxes).view(noise, seed)], grid=GRID), rescue)
        >= FREE_P
    )
    middles = GRID.middle_of(*np.indices(GRID.shape))
    touched = np.zeros(GRID.shape, bool)
    for x0, x1, y0, y1, *_ in boxes:
        apart = np.maximum(np.maximum([x0, y0] - middles, middles - [x1, y1]), 0)
        touched |= np.hypot(*np.moveaxis(apart, -1, 0)) < rescue.radius_m
    # of 6,000 to 12,000: real maps have less noise between neighbours than one sigma, which alone
    # makes steps of 0.8 of what the robot climbs
    assert free.sum() > 500
    assert (free & touched).sum() <= 0.005 * free.sum()


def test_the_small_robot_does_not_climb_what_the_large_one_does(scene, rescue, small):
    ground = ground_from(
        [scene([(14.0, 18.0, -3, 3, 0.0, 0.08)]).view(sigma_share=0.0005)], grid=GRID
    )
    edge = cells(13.9, 14.1, -2, 2)
    assert (cell_probability(ground, rescue)[edge] > FREE_P).all()
    assert (np.nanmin(cell_probability(ground, small)[edge], axis=1) < OBSTACLE_P).all()


def test_a_beam_is_an_obstacle_only_to_the_high_robot(scene, rescue, small):
    """One view sees the beam, another from the side the ground below: the free height is 0.5 m."""
    beam = [(15.0, 15.3, -6, 6, 0.5, 0.7)]
    views = [scene(beam, eye=eye).view(sigma_share=0.0005) for eye in ((0, 0, 8), (6.0, 0, 3))]
    ground = ground_from(views, grid=GRID)
    below = cells(15.0, 15.3, -1, 1)
    free_height = ground.free_height_m[below]
    seen = np.isfinite(free_height) & (ground.height_m[below] < 0.1)
    assert seen.sum() > 20 and abs(np.median(free_height[seen]) - 0.5) < 0.1
    assert (cell_probability(ground, rescue)[below][seen] < OBSTACLE_P).all()
    assert np.median(cell_probability(ground, small)[below][seen]) > OBSTACLE_P
    assert not (stand_probability(ground, rescue)[below][seen] > OBSTACLE_P).any()
    assert np.median(stand_probability(ground, small)[below][seen]) > OBSTACLE_P


def test_an_instant_renews_what_it_sees_and_leaves_the_rest(scene, rescue):
    before = ground_from([scene([WALL]).view(name="map", stamp_s=5.0)], grid=GRID)
    moved = [WALL, (14.0, 15.0, -1.0, 1.0, 0.0, 1.2)]
    after = renewed(before, scene(moved).view(name="instant", stamp_s=9.0))
    box = cells(14.1, 14.9, -0.9, 0.9)
    assert (stand_probability(before, rescue)[box] >= FREE_P).all()
    assert not (stand_probability(after, rescue)[box] >= FREE_P).any()
    assert after.views == ("map", "instant")
    assert (after.seen_s[cells(10, 12, -1, 1)] == 9.0).all()
    hidden = cells(15.3, 16.2, -0.5, 0.5)  # behind the new box: as the map saw it
    assert (after.seen_s[hidden] == 5.0).all() and (
        after.height_m[hidden] == before.height_m[hidden]
    ).all()


def test_a_renewal_costs_less_than_half_of_a_whole_map(scene, rescue):
    """In seconds: tools/bench_ground.py."""
    view = scene([WALL]).view(noise=0.3)
    ground = ground_from([view], grid=GRID)  # compiles
    spent = {"map": [], "renewal": []}
    for _ in range(3):  # the least of three: caches of another process must not count
        for name, call in (
            ("map", lambda: ground_from([view], grid=GRID)),
            ("renewal", lambda: renewed(ground, view)),
        ):
            began = time.process_time()
            made = call()
            if name == "map":
                stand_probability(made, rescue)
            spent[name].append(time.process_time() - began)
    assert min(spent["renewal"]) < 0.5 * min(spent["map"]), spent


def test_a_map_of_another_home_is_refused(scene):
    """Walls of one would lie in free ground of the other."""
    walls = [WALL, (27.0, 27.3, -9.0, 2.0, 0.0, 1.0), (15.0, 16.0, 6.0, 9.0, 0.0, 1.2)]
    first = scene(walls).view(noise=0.3, name="first")
    second = scene(walls, eye=(2.0, 2.0, 9.0)).view(noise=0.3, name="second")
    require_one_frame(ground_from([first, second], grid=GRID))
    T_home_cam = second.T_home_cam.copy()
    T_home_cam[:2, 3] += [4.0, -3.0]
    moved = replace(second, T_home_cam=T_home_cam)
    with pytest.raises(GroundError, match="second: its walls .* elsewhere than in first"):
        require_one_frame(ground_from([first, moved], grid=GRID))
    flat = scene().view(noise=0.3, name="flat")
    require_one_frame(ground_from([first, flat], grid=GRID))  # says nothing of it


def test_wrong_views_are_refused_by_name(scene):
    view = scene().view(name="out/map")
    with pytest.raises(GroundError, match="out/map: the pose of its camera cannot be used"):
        replace(view, T_home_cam=np.full((4, 4), np.nan))
    with pytest.raises(GroundError, match=r"out/map: sigma has shape \(2, 2\)"):
        replace(view, sigma=np.ones((2, 2)))
    with pytest.raises(GroundError, match="out/map: no pixel has a depth with sigma"):
        ground_from([replace(view, sigma=np.full_like(view.sigma, np.nan))])
    with pytest.raises(GroundError, match="no map was given"):
        ground_from([])


WORTHLESS = [
    ("sigma", 0.0),
    ("sigma", -1.0),
    ("sigma", 1e-60),  # 0 as float32
    ("depth", np.inf),
    ("depth", 1e30),
    ("depth", -5.0),
    ("depth", 0.0),
]


@pytest.mark.parametrize("what, value", WORTHLESS)
def test_a_view_without_depth_is_refused_by_name_beside_others_too(scene, what, value):
    view = scene().view(name="out/map", size=(160, 120))
    blind = replace(view, name="out/blind", **{what: np.full(view.depth.shape, value)})
    for views in ([blind], [view, blind]):
        with pytest.raises(GroundError, match="out/blind: no pixel has a depth with sigma"):
            ground_from(views, 0.2)
    with pytest.raises(GroundError, match="out/blind"):
        renewed(ground_from([view], 0.2), blind)


def test_a_pixel_of_a_negative_depth_or_without_sigma_is_unknown(scene):
    """They change nothing of what the others show."""
    view = scene().view(size=(320, 240))
    depth, sigma = view.depth.copy(), view.sigma.copy()
    depth[::7], sigma[3::7] = -depth[::7], 0.0
    whole = ground_from([view], grid=GRID)
    ground = ground_from([replace(view, depth=depth, sigma=sigma)], grid=GRID)
    assert ground.known.any() and not (ground.known & ~whole.known).any()
    assert np.nanmax(np.abs(ground.height_m)) < 0.1


def test_a_view_that_shows_nothing_of_a_grid_knows_nothing_of_it(scene, rescue):
    view = scene([WALL]).view(name="map", size=(320, 240))
    T_home_cam = view.T_home_cam.copy()
    T_home_cam[1, 3] += 500.0
    beside = replace(view, name="beside", T_home_cam=T_home_cam)
    alone = ground_from([beside], grid=GRID)
    assert not alone.known.any() and not np.isfinite(stand_probability(alone, rescue)).any()
    whole = ground_from([view], grid=GRID)
    both, after = ground_from([view, beside], grid=GRID), renewed(whole, beside)
    assert np.array_equal(both.known, whole.known) and np.array_equal(after.known, whole.known)
