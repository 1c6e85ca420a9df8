# SPDX-License-Identifier: Apache-2.0
"""Candidates for a finer map, and the choice among them: planes that go on, edges that move back,
hidden places."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import scenes

from fcsv_stereo.joint.checks.reliability import relied_on
from fcsv_stereo.joint.refine.residuals import residuals
from fcsv_stereo.joint.surfaces.candidates import MOST, candidates
from fcsv_stereo.joint.surfaces.colour import settled
from fcsv_stereo.joint.surfaces.data_cost import fronts
from fcsv_stereo.joint.surfaces.select import Map, choose_surfaces, stretched
from fcsv_stereo.joint.tuning import COLOUR
from fcsv_stereo.joint.views import grey, views

PX_PER_W = 1000.0


def of(given, y, x):
    first = given.start[y, x]
    return given.w[first : first + given.count[y, x]], given.source[
        first : first + given.count[y, x]
    ]


def test_a_slanted_plane_is_one_candidate_and_goes_on(pool):
    v, u = np.mgrid[0:40, 0:60]
    w = (0.05 + 0.0002 * u + 0.0004 * v).astype(np.float32)
    known = np.ones(w.shape, bool)
    known[10:30, 20:40] = False
    true = cv2.resize(w, (120, 80), interpolation=cv2.INTER_LINEAR)
    w[~known] = 0.11
    given = candidates(w, known, true.shape, PX_PER_W, pool)
    assert given.count[5, 5] == 1 and of(given, 5, 5)[0][0] == pytest.approx(true[5, 5], rel=0.01)
    values, sources = of(given, 40, 60)  # its own place, which is not known, and what surrounds it
    assert values[0] == pytest.approx(0.11) and sources[0] == -1
    assert np.abs(values[1:] / true[40, 60] - 1.0).min() < 0.01 and (sources[1:] >= 0).all()
    assert known.ravel()[sources[1:]].all()
    assert given.count.max() <= MOST and given.count.sum() == len(given.w)


def test_only_near_a_step_of_depth_there_is_a_choice(pool):
    w = np.full((40, 60), 0.02, np.float32)
    w[:, 30:] = 0.05
    given = candidates(w, np.ones(w.shape, bool), (80, 120), PX_PER_W, pool)
    assert (given.count[:, 50:70] == 2).any(axis=1).all() and (given.count[:, :50] == 1).all()
    assert (given.count[:, 70:] == 1).all()


def test_nothing_known_leaves_each_pixel_its_own(pool):
    w = np.random.default_rng(1).uniform(0.01, 0.1, (20, 30)).astype(np.float32)
    given = candidates(w, np.zeros(w.shape, bool), (40, 60), PX_PER_W, pool)
    assert (given.count == 1).all() and (given.source == -1).all()


def walls():
    """Reference and another 1 m beside it, as sharp as lenses are, and the true inverse depth at
    full and half size."""
    reference = scenes.picture(
        "reference", "uav1", 0.0, scenes.camera_pose([0, 0, 0], (0.3, -0.2, 0.4))
    )
    other = scenes.picture(
        "other", "uav2", 0.0, scenes.camera_pose((0, -1.0, 0), (-0.4, 0.3, -0.3))
    )
    reference, other = (
        replace(p, image=cv2.GaussianBlur(p.image, (0, 0), 0.8)) for p in (reference, other)
    )
    true = (1.0 / scenes.true_depth(reference.T_home_cam)).astype(np.float32)
    half = true[::2, ::2].copy()
    greys = [grey(reference), grey(other)]
    return (
        reference,
        true,
        half,
        views(reference, [other], 1.0, greys),
        views(reference, [other], 0.5, greys),
    )


def choose(found, coarser, w, known, reference, pool):
    return choose_surfaces(
        found, Map(coarser, w, known, known, known[None]), colour(reference), pool
    )


def colour(reference):
    return (
        np.repeat(reference.image[..., None], 3, 2)
        if reference.image.ndim == 2
        else reference.image
    )


def test_a_near_surface_that_was_carried_over_its_edge_moves_back(pool):
    """The coarse map's windows carry it by some pixels; at full size the pictures tell where it
    ends."""
    reference, true, half, found, coarser = walls()
    fat = cv2.dilate(half, np.ones((7, 7), np.uint8))
    known = np.ones(fat.shape, bool)
    chosen = choose(found, coarser, fat, known, reference, pool)
    before = (
        np.abs(cv2.resize(fat, true.shape[::-1], interpolation=cv2.INTER_NEAREST) / true - 1.0)
        > 0.1
    )
    after = np.abs(chosen / true - 1.0) > 0.1
    assert before.mean() > 0.01 and after.mean() < 0.25 * before.mean()  # measured 2026-11-24: 0.17


def test_a_map_that_is_only_stretched_may_settle_where_the_colours_change(pool):
    """Two colours meet; the coarse map's near surface reaches over the line by a pixel of its
    own."""
    near, far = np.float32(0.1), np.float32(0.02)
    image = np.full((60, 80, 3), 40.0, np.float32)
    image[:, 41:] = 200.0
    coarse = np.full((30, 40), near, np.float32)
    coarse[:, 22:] = far
    true = np.where(image[..., 0] < 100.0, near, far)
    larger = stretched(coarse, true.shape)
    assert (larger != true).mean() > 0.02
    assert np.allclose(settled(image, larger, pool), true, rtol=0.03)


def test_settling_takes_the_weighted_median_of_the_surroundings(pool):
    """Against the definition, where surfaces are mixed; what has one surface about it stays as it
    is, bit by bit."""
    rng = np.random.default_rng(3)
    image = rng.uniform(0, 80, (40, 50, 3)).astype(np.float32)
    w = np.where(rng.random((40, 50)) < 0.5, 0.1, 0.02).astype(np.float32)
    w[:20] = 0.05
    found = settled(image, w, pool)
    assert np.array_equal(found[:14], w[:14])
    colours, wrong = image.astype(np.int32), 0
    for y, x in [(y, x) for y in range(26, 40) for x in range(50)]:
        here = slice(max(y - 5, 0), y + 6), slice(max(x - 5, 0), x + 6)
        likeness = np.exp(
            -np.square(colours[here] - colours[y, x]).sum(axis=-1) / (2 * COLOUR.settle_grey**2)
        )
        near = likeness[w[here] == np.float32(0.1)].sum() / likeness.sum()
        wrong += abs(near - 0.5) > 0.01 and (found[y, x] > 0.04) != (near > 0.5)
    assert wrong == 0


def test_several_maps_may_settle_at_once_and_are_the_same_every_time(pool):
    rng = np.random.default_rng(3)
    image = rng.uniform(0, 255, (120, 160, 3)).astype(np.float32)
    maps = [rng.uniform(0.01, 0.1, (120, 160)).astype(np.float32) for _ in range(6)]
    one_by_one = [settled(image, w, pool) for w in maps]
    with ThreadPoolExecutor(2) as nodes:
        assert np.array_equal(list(nodes.map(lambda w: settled(image, w, pool), maps)), one_by_one)


def test_what_is_not_known_follows_its_surroundings(pool):
    reference, true, half, found, coarser = walls()
    known = np.ones(half.shape, bool)
    rows, columns = slice(half.shape[0] // 2 - 8, half.shape[0] // 2 + 8), slice(70, 102)
    known[rows, columns] = False
    broken = half.copy()
    broken[rows, columns] = 2.0 * half.max()
    chosen = choose(found, coarser, broken, known, reference, pool)
    here = (slice(2 * rows.start, 2 * rows.stop), slice(2 * columns.start, 2 * columns.stop))
    # measured 2026-11-24: 1.000
    assert (np.abs(chosen[here] / true[here] - 1.0) < 0.1).mean() > 0.98


def test_where_the_pictures_agree_a_map_is_relied_on(pool):
    _, true, _, found, _ = walls()
    for w, least, most in ((true, 0.7, 1.0), (1.3 * true, 0.0, 0.2)):
        known, certain, _ = relied_on(found, w, residuals(found, w, pool))
        assert least <= certain.mean() <= known.mean() <= most and not (certain & ~known).any()


def test_fronts_show_the_nearest_known(pool):
    _, _, half, _, coarser = walls()
    known = np.ones(half.shape, bool)
    shown = fronts(coarser, half, known[None])[0]
    assert shown.max() <= half.max() and (shown > 0).mean() > 0.88  # measured 2026-11-24: 0.921
    assert not fronts(coarser, half, ~known[None]).any()
