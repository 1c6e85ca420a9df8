# SPDX-License-Identifier: Apache-2.0
"""Observations for the adjustment: corners of each anchoring view, tracked along its links."""

from concurrent.futures import Executor
from typing import List, Tuple

import numpy as np

from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.geometry import inverse_depth
from fcsv_stereo.refinement.links import PairLink
from fcsv_stereo.refinement.structure import Observations
from fcsv_stereo.refinement.tracking import seeded_points, track

# less in every picture is sky, or so far that it may as well be: clouds move
_LEAST_PARALLAX_PX = 1.5


def observe(
    views: List[FeatureView], links: List[PairLink], features: int, pool: Executor
) -> Tuple[Observations, np.ndarray]:
    """Observations of all links' points, and their inverse depths (N,) 1/m."""
    anchors = sorted({l.a for l in links})
    outcomes = [_anchored(views, [l for l in links if l.a == a], features, pool) for a in anchors]
    start, parts, rhos = 0, [], []
    for a, (points, tracks) in zip(anchors, outcomes):
        keep, rho = _depths(views, points, tracks)
        number = np.where(keep, start + np.cumsum(keep) - 1, -1)
        for link, t in tracks:
            used = keep[t.index]
            parts.append((number[t.index[used]], np.full(int(used.sum()), link.b), t.rays[used]))
        rhos.append((np.full(int(keep.sum()), a), points.rays[keep], rho[keep]))
        start += int(keep.sum())
    point, picture, rays = (np.concatenate(x) for x in zip(*parts))
    anchor, anchor_rays, rho = (np.concatenate(x) for x in zip(*rhos))
    return Observations(anchor, anchor_rays, point, picture, rays), rho


def _anchored(views: List[FeatureView], links: List[PairLink], features: int, pool: Executor):
    a = views[links[0].a]
    uv, rho = np.vstack([l.seed_uv for l in links]), np.concatenate([l.seed_rho for l in links])
    points = seeded_points(a, uv, rho, features)
    gate_px = {l.b: max(2.0, 3.0 * views[l.b].noise_px) for l in links}
    found = pool.map(lambda l: track(a, views[l.b], l.T_a_b, points, gate_px[l.b]), links)
    return points, list(zip(links, found))


def _depths(views: List[FeatureView], points, tracks):
    """Which points have parallax anywhere, and their inverse depths, weighted by parallax."""
    count = len(points.uv)
    total, weight, parallax_px = np.zeros(count), np.zeros(count), np.zeros(count)
    for link, t in tracks:
        rho, parallax = inverse_depth(link.T_a_b, points.rays[t.index], t.rays)
        total[t.index] += rho * parallax**2
        weight[t.index] += parallax**2
        per_rho = parallax * views[link.b].camera.fx
        parallax_px[t.index] = np.maximum(parallax_px[t.index], per_rho)
    rho = total / np.maximum(weight, 1e-12)
    return rho * parallax_px > _LEAST_PARALLAX_PX, rho
