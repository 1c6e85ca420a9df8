# SPDX-License-Identifier: Apache-2.0
"""Survey: the similarity between two views, on matches with known truth."""

import cv2
import gtsam
import numpy as np
import pytest
from support.survey_views import UNKNOWN, camera_at, places, prior, seen, unplaced, view

from fcsv_geometry import transforms
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.edges.edge import edge_of, find_edge
from fcsv_stereo.survey.edges.features import features_of
from fcsv_stereo.survey.edges.matching import match, predicted
from fcsv_stereo.survey.edges.pairs import compared_pairs, pair_of
from fcsv_stereo.survey.edges.warping import tracked

A, B = camera_at(0, 0), camera_at(5, 20, 2, heading_deg=-12)


def off(edge, scale, B=B):
    """(7,) in its sigmas, and its scale's error."""
    true = similarity.of_pose(transforms.invert(A) @ B, scale)
    error = gtsam.Similarity3.Logmap(true.inverse().compose(edge.S_a_b))
    return error / np.sqrt(np.diag(edge.covariance)), error[6]


@pytest.mark.parametrize("wrong", [0.0, 0.5])
@pytest.mark.parametrize("scale", [1.0, 1.05])
def test_the_similarity_of_two_views_is_found_among_wrong_matches(wrong, scale):
    points = places()
    a, b = seen(points, A), seen(points, B, scale, seed=1)
    mixed = np.arange(len(points))
    n = int(wrong * len(points))
    mixed[:n] = np.random.default_rng(2).permutation(n)
    edge = edge_of("a", "b", a, b[mixed])
    times, scale_error = off(edge, scale)
    assert edge.kept and edge.matches >= 0.9 * (len(points) - n)
    # 0.6 % of depth at 25 m median, 100 to 200 matches: 0.06 %, five times that
    assert abs(scale_error) < 0.003
    assert np.abs(times).max() < 4.0


def test_an_edges_covariance_is_honest():
    """Mean squared error over covariance; matches have independent errors here, so that it is on
    the safe side."""
    ratios = []
    for seed in range(6):
        points = places(80, seed)
        edge = edge_of("a", "b", seen(points, A, seed=seed), seen(points, B, seed=100 + seed))
        ratios.append(np.mean(off(edge, 1.0)[0] ** 2))
    assert 0.05 < np.mean(ratios) < 1.5


def test_too_few_matches_are_no_edge():
    points = places(tuning.LEAST_MATCHES - 1)
    edge = edge_of("a", "b", seen(points, A), seen(points, B))
    assert (
        not edge.kept
        and edge.reason == "11 features are alike; 12 are needed"
        and edge.S_a_b is None
    )


def test_matches_that_agree_on_nothing_are_no_edge():
    edge = edge_of("a", "b", seen(places(60, 1), A), seen(places(60, 2), B))
    assert not edge.kept and "of 60 matches agree on one similarity" in edge.reason


def test_matches_in_one_corner_tell_no_similarity():
    """What is 1 m wide at 100 m turns and scales freely within its sigma."""
    points = np.array([100.0, 10.0, 5.0]) + np.random.default_rng(0).normal(0.0, 0.3, (60, 3))
    edge = edge_of("a", "b", seen(points, A), seen(points, B, seed=1))
    assert not edge.kept and (
        "too little overlap" in edge.reason or "agree on one similarity" in edge.reason
    )


def test_wrong_matches_in_a_line_are_no_edge_and_no_error():
    """The fit of this seed shrank to a point, and ended with an error of linear algebra."""
    random = np.random.default_rng(280)
    line = [80.0, -10.0, 3.0] + np.linspace(0, 1, 13)[:, None] * [2.0, 20.0, 1.0]
    line = line + random.normal(0, 0.3, (13, 3))
    a, b = seen(line, A, seed=280), seen(line[random.permutation(13)], B, seed=281)
    assert not edge_of("a", "b", a, b).kept


def test_two_units_of_length_are_no_edge():
    points = places()
    edge = edge_of("a", "b", seen(points, A), seen(points, B, scale=3.28, seed=1))
    assert not edge.kept


def test_views_back_to_back_do_not_overlap_and_neighbours_do():
    here, beside, behind = (
        view("a", A),
        view("b", camera_at(0, 8)),
        view("c", camera_at(-5, 0, heading_deg=180)),
    )
    assert pair_of(here, beside).look_alike and pair_of(here, behind) is None


def test_a_view_without_a_place_may_overlap_any():
    behind = camera_at(-5, 0, heading_deg=180)
    pair = pair_of(view("a", A), view("c", behind, known_as=unplaced(behind)))
    assert pair is not None and not pair.look_alike


def compared(views, neighbours):
    return [p.a.name + p.b.name for p in compared_pairs(views, neighbours)]


def test_pairs_per_view_do_not_grow_with_the_site_and_hold_it_together():
    """Two groups of views along a wall; of all, only the first and the last see nothing in common."""
    row = [view(c, camera_at(0, y)) for c, y in zip("abcdef", (0, 8, 16, 40, 48, 56))]
    assert len(compared(row, 0)) == 14
    assert compared(row, 1) == ["ab", "bc", "cd", "de", "ef"]
    assert compared(row, 2) == ["ab", "ac", "bc", "cd", "de", "df", "ef"]
    assert compared(row, 8) == compared(row, 0) and compared(row[:1], 2) == []
    lost = view("x", camera_at(0, 3), known_as=unplaced(camera_at(0, 3)))
    assert compared([*row, lost], 1)[:3] == ["ab", "ax", "bc"]
    assert len(compared([*row, lost], 1)) == 5 + 6


def test_matches_are_looked_for_where_priors_allow():
    points = places(40)
    a, b = seen(points, A, noise_px=0.0), seen(points, B, noise_px=0.0)
    uv, radius = predicted(a.points, prior(A, place_m=0.2), prior(B, place_m=0.2), view("b", B))
    assert np.isfinite(uv).all() and (radius > tuning.GATE_PX).all() and (radius < 200).all()
    alike = np.eye(40, 128, dtype=np.float32)
    a, b = (type(f)(f.camera, f.uv, f.points, f.covariances, alike) for f in (a, b))
    assert len(match(a, b)) == 40
    assert len(match(a, b, (b.uv, np.full(40, 1.0)))) == 40
    assert len(match(a, b, (b.uv + 50.0, np.full(40, 1.0)))) < 5


def test_features_stand_on_surfaces_that_are_known():
    """A checked wall whose left half has no depth."""
    v = view("a", A)
    board = (np.indices(v.depth.shape) // 6).sum(0) % 2 * 200
    v.image[:] = board[..., None]
    v.depth[:, :48] = np.nan
    found = features_of(v)
    assert len(found) > 10 and found.uv[:, 0].min() > 48 and np.isfinite(found.covariances).all()
    assert np.allclose(found.points[:, 2], 40.0, atol=0.1)


def test_a_picture_without_texture_has_no_features():
    blank = view("a", A)
    assert len(features_of(blank)) == 0 and tracked(blank, blank) is None


def of_noise(name, T, known_as):
    """A view of a wall with smooth noise on it, 0.5 m from one grey to the next."""
    v = view(name, T, known_as=known_as)
    p = v.camera.rays() * v.depth[..., None] @ T[:3, :3].T + T[:3, 3]
    noise = np.random.default_rng(5).normal(size=(300, 300)).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), 3.0)
    at = (p[..., 1:] / 0.5 + 150.0).astype(np.float32)
    v.image[:] = 128 + 250 * cv2.remap(noise, at[..., 0], at[..., 1], cv2.INTER_LINEAR)[..., None]
    return v


def test_what_is_seen_40_degrees_apart_is_tracked_to_where_it_is_not_to_where_priors_say():
    """The prior is 1 m off, 2 px; a corner's place in a picture is good to half a pixel, 0.2 m on
    the wall, which one of the two sees 40 degrees askew."""
    B = camera_at(10, 25, heading_deg=-40)
    a = of_noise("a", A, prior(A))
    b = of_noise("b", B, prior(camera_at(10, 26, heading_deg=-40)))
    b.image[:] = b.image * 0.6 + 20  # another exposure
    across = pair_of(a, view("c", camera_at(80, 0, heading_deg=180)))
    assert pair_of(a, b).look_alike and not (across and across.look_alike)
    in_a, in_b = tracked(a, b)
    apart = transforms.apply(A, in_a.points) - transforms.apply(B, in_b.points)
    assert len(in_a) > 30 and np.abs(np.median(apart, axis=0)).max() < 0.2
    edge = find_edge(a, b, features_of(a), features_of(b), True)
    assert edge.kept and np.abs(off(edge, 1.0, B)[0]).max() < 4.0


def test_no_corner_beside_a_hole_is_held_where_priors_say():
    """What is not known is filled with the other picture: 1 of 6 was up to 1 m off, as the prior."""
    B = camera_at(10, 25, heading_deg=-40)
    b = of_noise("b", B, prior(camera_at(10, 26, heading_deg=-40)))
    b.depth[:, 44:48] = np.nan
    in_a, in_b = tracked(of_noise("a", A, prior(A)), b)
    apart = transforms.apply(A, in_a.points) - transforms.apply(B, in_b.points)
    assert len(in_a) > 20 and np.linalg.norm(apart, axis=1).max() < 0.3


def test_an_unknown_place_is_infinite():
    assert not unplaced(A).placed and unplaced(A).place_m == UNKNOWN and prior(A).placed
