# SPDX-License-Identifier: Apache-2.0
"""Which views are linked: every one with the reference, and those that it does not see with their
neighbours."""

from concurrent.futures import Executor
from typing import Dict, List, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.model import PosePrior
from fcsv_stereo.pose_covariance import relative, to_camera
from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.geometry import PairPrior
from fcsv_stereo.refinement.links import PairLink, link
from fcsv_stereo.refinement.types import RefineOptions

_NEIGHBOURS = 3
# features shared with the reference; pictures with fewer are linked with their neighbours too
_WELL_SEEN = 200
_WIDEST_RAD = float(np.radians(60.0))  # views turned further against each other are not tried


def prior_of(
    a: FeatureView, b: FeatureView, distances_m: Tuple[float, float], prior: PosePrior
) -> PairPrior:
    """Gives the prior of b relative to a, both with errors of their own; ``distances_m`` from the
    reference, 0 for itself.

    From the pictures' covariances; ``prior`` serves where they have none.
    """
    T_a_b = transforms.invert(a.picture.T_home_cam) @ b.picture.T_home_cam
    known = relative(a.picture, b.picture)
    if known is not None:
        turn = to_camera(b.picture, position_too=True)
        covariance = turn @ known @ turn.T
        sigmas = [
            float(np.sqrt(np.linalg.eigvalsh(covariance[i, i])[-1]))
            for i in (slice(3), slice(3, 6))
        ]
        return PairPrior(T_a_b, *sigmas, covariance)
    sides = [d for d in distances_m if d > 0.0]
    position_m = float(
        np.hypot.reduce([prior.position_sigma_m(d) for d in sides] or [prior.position_sigma_m(0.0)])
    )
    return PairPrior(T_a_b, prior.rotation_rad * float(np.sqrt(max(len(sides), 1))), position_m)


def prior_to_reference(views: List[FeatureView], k: int, prior: PosePrior) -> PairPrior:
    """Gives the prior of picture k relative to the reference."""
    return prior_of(views[0], views[k], (0.0, distance_m(views, k)), prior)


def link_all(
    views: List[FeatureView], options: RefineOptions, pool: Executor
) -> Tuple[Dict[int, PairLink], List[PairLink]]:
    """Links of each picture with the reference (number 0), trusted or not; and trusted ones between
    others."""
    numbers = range(1, len(views))
    direct = dict(zip(numbers, _links(views, [(0, k) for k in numbers], options, pool)))
    here = [k for k in numbers if direct[k].same_place or _at_reference(views, k, options.prior)]
    lonely = [k for k in numbers if len(direct[k].seed_rho) < _WELL_SEEN and k not in here]
    if not lonely or not options.pair_others:
        return direct, []
    pairs = sorted({tuple(sorted((k, j))) for k in lonely for j in _neighbours(views, k)})
    return direct, [l for l in _links(views, pairs, options, pool) if not l.reason]


def start_poses(count: int, links: List[PairLink]) -> Dict[int, np.ndarray]:
    """T_ref_cam of every view that a chain of links reaches from the reference."""
    poses = {0: np.eye(4)}
    for _ in range(count):
        for l in links:
            if l.a in poses and l.b not in poses:
                poses[l.b] = poses[l.a] @ l.T_a_b
            elif l.b in poses and l.a not in poses:
                poses[l.a] = poses[l.b] @ transforms.invert(l.T_a_b)
    return poses


def distance_m(views: List[FeatureView], k: int) -> float:
    """Measures the distance from the reference, by the priors."""
    return float(
        np.linalg.norm(views[k].picture.T_home_cam[:3, 3] - views[0].picture.T_home_cam[:3, 3])
    )


def _links(views, pairs, options: RefineOptions, pool: Executor) -> List[PairLink]:
    def one(pair):
        a, b = pair
        distances = (distance_m(views, a) if a else 0.0, max(distance_m(views, b), 1e-9))
        prior = prior_of(views[a], views[b], distances, options.prior)
        return link(pair, views[a], views[b], prior, options.least_inliers, options.unit_m)

    return list(pool.map(one, pairs))


def _at_reference(views: List[FeatureView], k: int, prior: PosePrior) -> bool:
    """Taken from the reference's own place: no baseline, whoever else sees it."""
    return distance_m(views, k) < 3.0 * prior_to_reference(views, k, prior).position_m


def _neighbours(views: List[FeatureView], k: int) -> List[int]:
    """The nearest other views that look the same way."""
    T_k = views[k].picture.T_home_cam
    others = []
    for j in range(1, len(views)):
        T_j = views[j].picture.T_home_cam
        away_rad = np.arccos(np.clip(T_k[:3, 2] @ T_j[:3, 2], -1.0, 1.0))
        if j != k and away_rad < _WIDEST_RAD:
            others.append((float(np.linalg.norm(T_k[:3, 3] - T_j[:3, 3])), j))
    return [j for _, j in sorted(others)[:_NEIGHBOURS]]
