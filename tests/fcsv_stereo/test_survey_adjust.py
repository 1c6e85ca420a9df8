# SPDX-License-Identifier: Apache-2.0
"""Survey: one frame for all views, on edges with known truth."""

import numpy as np
import pytest
from support.survey_views import camera_at, prior, true_edge, unplaced, view

from fcsv_geometry import transforms
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.edges.edge import Edge
from fcsv_stereo.survey.placing.adjust import adjust, closing, components

NAMES = [f"v{i}" for i in range(8)]
POSES = {
    n: camera_at(60 * np.cos(a), 60 * np.sin(a), 10, np.degrees(a) + 180)
    for n, a in zip(NAMES, np.linspace(0, 2 * np.pi, 8, endpoint=False))
}


def scales(seed=0, sigma=0.01):
    return dict(zip(NAMES, np.exp(sigma * np.random.default_rng(seed).normal(size=len(NAMES)))))


def ring_edges(true, count=8, seed=0):
    pairs = [(i, (i + k) % count) for k in (1, 2) for i in range(count)]
    return [true_edge(NAMES[i], NAMES[j], POSES, true, seed=seed + 10 * i + j) for i, j in pairs]


def noisy_views(true, place_m=2.0, yaw_deg=0.1, seed=5, names=NAMES):
    random, out = np.random.default_rng(seed), []
    for n in names:
        T = transforms.from_xyz_yaw(random.normal(0, place_m, 3), 0) @ POSES[n]
        T[:3, :3] = (
            transforms.from_xyz_yaw([0, 0, 0], np.radians(yaw_deg) * random.normal())[:3, :3]
            @ POSES[n][:3, :3]
        )
        out.append(view(n, POSES[n], known_as=prior(T, place_m, yaw_deg), scale=true[n]))
    return out


def relative_scales(found, true):
    off = np.array([np.log(found.placed[n].scale / true[n]) for n in found.placed])
    return off - off.mean()


def test_a_ring_with_errors_of_trackers_closes():
    """Edges know scales to 0.1 %, places to 5 cm; sixteen edges for eight views, so that either is
    better here."""
    true = scales()
    found = adjust(noisy_views(true), ring_edges(true))
    assert list(found.placed) == NAMES and all(e.kept for e in found.edges) and not found.remarks
    assert np.std(relative_scales(found, true)) < 0.001 < 0.5 * np.std(list(true.values()))
    at = np.array([similarity.place(p.S_site_cam) for p in found.placed.values()])
    truth = np.array([POSES[n][:3, 3] for n in NAMES])
    fitted = similarity.apply(similarity.of_matrix(similarity.fit(truth[None], at[None])[0]), at)
    assert np.sqrt(np.mean((fitted - truth) ** 2)) < 0.1
    assert len(found.loops) == 16 - 7 and max(loop.closing_m for loop in found.loops) < 1.0


def test_covariances_hold_the_errors():
    chi2 = []
    for seed in range(5):
        true = scales(seed)
        found = adjust(noisy_views(true, seed=seed), ring_edges(true, seed=100 * seed))
        for n, p in found.placed.items():
            chi2.append(
                np.sum((similarity.place(p.S_site_cam) - POSES[n][:3, 3]) ** 2) / p.sigma_m**2 / 3
            )
            assert 0.0 < p.sigma_scale < 0.01 and 0.0 < p.sigma_yaw_rad < 0.01 and not p.alone
    assert 0.3 < np.mean(chi2) < 2.5  # 5 sites, whose views share their error


@pytest.mark.parametrize("wrong", [1, 3])
def test_wrong_edges_are_thrown_out_with_reasons(wrong):
    true = scales()
    edges = ring_edges(true)
    for k in range(wrong):
        e = edges[5 * k]
        S = e.S_a_b.compose(similarity.of_pose(transforms.from_xyz_yaw([4.0, 2.0, 0.0], 0.1), 1.1))
        # with more matches than any right one
        edges[5 * k] = Edge(e.a, e.b, S, e.covariance, 0.1, 400)
    found = adjust(noisy_views(true), edges)
    out = [e for e in found.edges if not e.kept]
    assert {(e.a, e.b) for e in out} == {(edges[5 * k].a, edges[5 * k].b) for k in range(wrong)}
    assert all("contradicts the other edges and places by" in e.reason for e in out)
    assert np.std(relative_scales(found, true)) < 0.002


def test_a_view_without_edges_stays_at_its_prior_and_is_marked():
    true = scales()
    edges = [e for e in ring_edges(true) if "v3" not in (e.a, e.b)]
    views = noisy_views(true)
    found = adjust(views, edges)
    alone = [n for n, p in found.placed.items() if p.alone]
    assert alone == ["v3"]
    assert np.allclose(
        similarity.matrix(found.placed["v3"].S_site_cam), views[3].prior.T_site_cam, atol=1e-6
    )
    assert found.placed["v3"].sigma_m == pytest.approx(2.0, rel=1e-3)
    assert found.placed["v3"].sigma_scale == pytest.approx(0.01, rel=1e-3)


def test_a_view_whose_place_nobody_says_is_found_by_its_edges():
    true = scales()
    views = noisy_views(true, place_m=0.1)
    views[2] = view("v2", POSES["v2"], known_as=unplaced(POSES["v2"]))
    found = adjust(views, ring_edges(true))
    assert (
        np.linalg.norm(similarity.place(found.placed["v2"].S_site_cam) - POSES["v2"][:3, 3]) < 0.4
    )
    assert found.placed["v2"].sigma_m < 0.3 and not found.lost


def test_without_any_place_the_first_views_home_is_the_frame():
    true = scales()
    views = [view(n, POSES[n], known_as=unplaced(POSES[n])) for n in NAMES]
    found = adjust(views, ring_edges(true))
    assert len(found.placed) == 8 and "the home of v0 is the site's frame" in found.remarks[0]
    first = found.placed["v0"]
    assert np.allclose(similarity.place(first.S_site_cam), 0.0, atol=0.01)
    step = (
        np.linalg.norm(similarity.place(found.placed["v4"].S_site_cam)) / first.scale * true["v0"]
    )
    assert step == pytest.approx(120.0, abs=0.5)


def test_a_view_without_place_and_edges_is_lost_and_the_best_refusal_is_told():
    true = scales()
    edges = [e for e in ring_edges(true) if "v7" not in (e.a, e.b)]
    edges.append(Edge("v0", "v7", matches=9, reason="9 features are alike; 12 are needed"))
    views = noisy_views(true)
    views[7] = view("v7", POSES["v7"], known_as=unplaced(POSES["v7"]))
    found = adjust(views, edges)
    assert list(found.lost) == ["v7"] and "no station.yaml" in found.lost["v7"]
    assert "v0: 9 features are alike" in found.lost["v7"] and len(found.placed) == 7


def test_no_overlap_at_all_leaves_every_view_at_its_station():
    views = noisy_views(scales())
    found = adjust(views, [])
    assert (
        len(found.placed) == 8 and all(p.alone for p in found.placed.values()) and not found.loops
    )


@pytest.mark.parametrize("count", [2, 8])
def test_a_scale_wrong_by_five_per_cent_is_said_and_corrected(count):
    true = {**scales(sigma=0.004), "v1": 1.05}
    names = NAMES[:count]
    edges = [e for e in ring_edges(true) if e.a in names and e.b in names]
    found = adjust(noisy_views(true, names=names), edges)
    said = [r for r in found.remarks if r.startswith("v1: its map is")]
    assert said and "too small" in said[0] and "Look at the calibration" in said[0]
    assert np.std(relative_scales(found, true)) < 0.002
    if count == 8:
        assert len(found.remarks) == 1
        assert abs(np.mean([np.log(p.scale / true[n]) for n, p in found.placed.items()])) < 0.006


def test_no_views_are_no_site():
    found = adjust([], [])
    assert not found.placed and not found.lost


def test_groups_and_loops():
    true = dict.fromkeys(NAMES, 1.0)
    pairs = [("v0", "v1"), ("v2", "v3"), ("v1", "v4")]
    edges = [true_edge(*pair, POSES, true, seed=i) for i, pair in enumerate(pairs)]
    assert sorted(map(len, components(edges, NAMES))) == [1, 1, 1, 2, 3]
    assert closing(edges, NAMES) == []
    loops = closing([*edges, true_edge("v0", "v4", POSES, true, seed=9, matches=5)], NAMES)
    assert len(loops) == 1 and loops[0].views == ["v0", "v1", "v4"]
    assert loops[0].closing_m < 0.5 and loops[0].closing_scale < 0.01


def test_groups_that_no_edge_joins_refer_to_datums_of_their_own():
    """Else their points would count as unsure as the two groups' places are, and agree with
    anything."""
    true = scales()
    near, far = {"v0", "v1", "v2"}, {"v4", "v5", "v6"}
    edges = [e for e in ring_edges(true) if {e.a, e.b} <= near or {e.a, e.b} <= far]
    found = adjust(noisy_views(true), edges).placed
    assert {found[n].datum for n in near} <= near and {found[n].datum for n in far} <= far
    assert found["v3"].datum == "v3" and found["v3"].alone
    for n in near | far:
        assert np.sqrt(np.trace(found[n].relative[3:6, 3:6])) < 0.3 < found[n].sigma_m


def test_sigmas_against_the_whole_site_are_even_and_other_groups_change_no_bit():
    """Of a ring no view is surer than another. With one view as datum it had none, and the view
    across the most."""
    true = scales()
    ring = adjust(noisy_views(true), ring_edges(true)).placed
    sigmas = [np.sqrt(np.trace(p.relative[3:6, 3:6])) for p in ring.values()]
    assert max(sigmas) < 1.3 * min(sigmas) and max(sigmas) < 0.1
    some = [e for e in ring_edges(true) if {e.a, e.b} <= set(NAMES[:4])]
    four = adjust(noisy_views(true)[:4], some).placed
    five = adjust(noisy_views(true)[:5], some).placed
    assert all((four[n].relative == five[n].relative).all() for n in four)
