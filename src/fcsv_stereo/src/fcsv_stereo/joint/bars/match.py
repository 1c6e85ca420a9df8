# SPDX-License-Identifier: Apache-2.0
"""Edges of the reference picture found again in another one: each once, and as much of them as can
be."""

from dataclasses import dataclass
from typing import Tuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from fcsv_stereo.joint.bars.edges import Edges
from fcsv_stereo.joint.tuning import Bars


@dataclass(frozen=True)
class MatchedEdges:
    """All ``edges`` (N) of the reference; ``inverse`` (N,2) depths at both ends (1/m), NaN where
    the other picture does not show it; ``shared`` (N,2): from which to which share of its length
    that shows it; ``speed`` (N,) px by which a match moves per 1/m."""

    edges: Edges
    inverse: np.ndarray
    shared: np.ndarray
    speed: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """(N,) bool."""
        return np.isfinite(self.inverse[:, 0])


def match_edges(
    one: Edges, other: Edges, projection: np.ndarray, size: Tuple[int, int], rules: Bars
) -> MatchedEdges:
    """Chooses, of all ways to say which edge is which, the one that explains most of their length.

    ``projection`` (12,) is ``Views.projections``'s: a pixel p at inverse depth w is at A p + w b in
    the other picture, of ``size`` (height, width). Things as far apart as the cameras fit each
    other at infinity, too; but then one of each picture stays alone. Where it may stay alone
    because the other picture ends there, nothing is told of both.
    """
    found = MatchedEdges(
        one, np.full((len(one), 2), np.nan), np.zeros((len(one), 2)), np.ones(len(one))
    )
    if not len(one) or not len(other):
        return found
    A, b = np.asarray(projection, float)[:9].reshape(3, 3), np.asarray(projection, float)[9:]
    inverse, speed = _inverse_depths(one, other, A, b)
    shared, shared_px = _shared(one, other, A, b, inverse)
    value = _value(one, other, inverse, speed, shared_px, rules)
    value = _with_company(one, inverse, speed, value, rules)
    i, j = linear_sum_assignment(-value)
    kept = value[i, j] > 0.0
    i, j = i[kept], j[kept]
    told = inverse[i, j].min(axis=1) * speed[i, j] > rules.behind_px
    told &= _alone(one, inverse, value, (i, j), _outside(one, A, b, inverse, size), rules)
    i, j = i[told], j[told]
    found.inverse[i], found.shared[i], found.speed[i] = inverse[i, j], shared[i, j], speed[i, j]
    return found


def _homogeneous(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def _inverse_depths(
    one: Edges, other: Edges, A: np.ndarray, b: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Gives inverse depths at both ends (N,M,2; 1/m; -1 where the edge lies along the match's way),
    and the speed (N,M)."""
    moved = _homogeneous(one.ends) @ A.T
    off, rate = np.einsum("mh,nth->nmt", other.lines, moved), (other.lines @ b)[None, :, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = -off / rate
    speed = np.abs(rate[..., 0]) / np.abs(moved[..., 2]).mean(axis=1)[:, None]
    return np.where(np.isfinite(inverse), inverse, -1.0), np.maximum(speed, 1e-9)


def _shared(
    one: Edges, other: Edges, A: np.ndarray, b: np.ndarray, inverse: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Which share of the reference's edge the other picture shows (N,M,2), and of the other's
    length in px (N,M)."""
    seen = (_homogeneous(one.ends) @ A.T)[:, None] + inverse[..., None] * b
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = seen[..., :2] / np.where(seen[..., 2:] > 1e-6, seen[..., 2:], np.nan)
        run = np.einsum("nmti,mi->nmt", seen - other.ends[None, :, :1], other.ways)
        size = run[..., 1] - run[..., 0]
        shared = np.stack(
            [-run[..., 0] / size, (other.lengths[None] - run[..., 0]) / size], axis=-1
        )
    shared = np.where((size > 1.0)[..., None] & np.isfinite(shared), np.clip(shared, 0.0, 1.0), 0.0)
    return shared, (shared[..., 1] - shared[..., 0]) * np.where(np.isfinite(size), size, 0.0)


def _value(
    one: Edges,
    other: Edges,
    inverse: np.ndarray,
    speed: np.ndarray,
    shared_px: np.ndarray,
    rules: Bars,
) -> np.ndarray:
    """(N,M) px of length that a match explains, less where both are unlike on the side that is more
    alike (the thing's own; the other side shows what is behind it); 0 where they cannot be the
    same."""
    unlike = np.abs(one.colours[:, None] - other.colours[None]).mean(axis=3).min(axis=2)
    fits = (unlike < rules.colours_differ) & (inverse.max(axis=2) < 1.0 / rules.nearest_m)
    fits &= inverse.min(axis=2) * speed > -rules.behind_px
    fits &= shared_px > 0.5 * np.minimum(one.lengths[:, None], other.lengths)
    fits &= shared_px > 0.5 * rules.least_length_px
    return np.where(fits, shared_px * np.exp(-unlike / rules.colours_differ), 0.0)


def _with_company(
    one: Edges, inverse: np.ndarray, speed: np.ndarray, value: np.ndarray, rules: Bars
) -> np.ndarray:
    """(N,M) with what edges beside it, which may be of the same thing, explain best at the same
    depth."""
    found, middle, way = value.copy(), one.ends.mean(axis=1), one.ends[:, 1] - one.ends[:, 0]
    run = (
        np.einsum("nki,ni->nk", middle[None] - one.ends[:, None, 0], way)
        / np.square(one.lengths)[:, None]
    )
    # of the middle of each (column) to each line (row)
    beside = np.abs(one.lines[:, :2] @ middle.T + one.lines[:, 2:])
    company = (
        one.parallel(rules.turned_deg) & (beside < rules.most_width_px) & (run > -0.1) & (run < 1.1)
    )
    np.fill_diagonal(company, False)
    for k, i in zip(*np.nonzero(company)):  # k beside the middle of i
        w = inverse[k, :, 0] + (inverse[k, :, 1] - inverse[k, :, 0]) * run[k, i]
        apart_px = np.abs(inverse[i].mean(axis=1)[:, None] - w[None]) * speed[i][:, None]
        found[i] += np.where(apart_px < rules.edges_differ_px, value[k][None], 0.0).max(axis=1) * (
            value[i] > 0.0
        )
    return found


def _outside(
    one: Edges, A: np.ndarray, b: np.ndarray, inverse: np.ndarray, size: Tuple[int, int]
) -> np.ndarray:
    """(N,N,M) bool: edge p (first) would not be in the other picture if it were where i (second) is
    by its match."""
    w = inverse.mean(axis=2)
    at = (_homogeneous(one.ends.mean(axis=1)) @ A.T)[:, None, None] + w[None, ..., None] * b
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = np.moveaxis(at[..., :2] / at[..., 2:], -1, 0)
    return ~((x >= 0.0) & (x < size[1]) & (y >= 0.0) & (y < size[0]))


def _alone(one: Edges, inverse, value, chosen, outside: np.ndarray, rules: Bars) -> np.ndarray:
    """(K,) bool: no other depth explains the edges parallel to each as well, by matches or by the
    picture's end."""
    log_w, best = np.log(np.maximum(inverse.mean(axis=2), 1e-6)), value.max(axis=1)
    parallel = one.parallel(rules.turned_deg)
    explained = np.zeros(value.shape)
    for p, m in zip(*np.nonzero(value > rules.worth * best[:, None])):
        each = np.where(np.abs(log_w - log_w[p, m]) < rules.same_depth, value, 0.0).max(axis=1)
        explained[p, m] = np.where(outside[:, p, m], best, each)[parallel[p]].sum()
    told = []
    for i, j in zip(*chosen):
        elsewhere = parallel[i][:, None] & (np.abs(log_w - log_w[i, j]) > 2.0 * rules.same_depth)
        told.append(np.where(elsewhere, explained, 0.0).max() < rules.as_well * explained[i, j])
    return np.array(told, bool)
