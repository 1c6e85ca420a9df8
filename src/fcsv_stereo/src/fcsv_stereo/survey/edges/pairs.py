# SPDX-License-Identifier: Apache-2.0
"""Which pairs of views are compared: by the priors, those that see most of each other's surfaces."""

import itertools
from dataclasses import dataclass
from typing import Dict, Generic, List, Optional, Sequence, Set, TypeVar

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import minimum_spanning_tree

from fcsv_geometry import transforms
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.edges.matching import inside, predicted
from fcsv_stereo.survey.views.view import View

V = TypeVar("V", bound=View)


@dataclass(frozen=True)
class ViewPair(Generic[V]):
    """Two views. By the priors one of them may see ``overlap``, a share, of what the other has depths
    of; ``alike``: from a direction and a distance not too different. None: a prior is unknown."""

    a: V
    b: V
    overlap: Optional[float] = None
    alike: float = 0.0

    @property
    def look_alike(self) -> bool:
        """Whether places are to be tracked from one picture to the other."""
        return self.alike >= tuning.LEAST_ALIKE

    @property
    def likely(self) -> float:
        """Tells, of two pairs, the one that features rather join."""
        return self.alike + 0.01 * (self.overlap or 0.0)


def pair_of(a: V, b: V) -> Optional[ViewPair[V]]:
    """The pair of two views; None where, as far as their priors tell, neither sees enough of what the
    other has depths of."""
    if not (a.prior.placed and b.prior.placed):
        return ViewPair(a, b)
    overlap, alike = np.max([_shares_seen(a, b), _shares_seen(b, a)], axis=0)
    return ViewPair(a, b, overlap, alike) if overlap >= tuning.LEAST_OVERLAP else None


def _shares_seen(a: View, b: View) -> List[float]:
    """Shares of some of a's points that may lie in b's picture: all; those seen alike."""
    if not len(a.sampled):
        return [0.0, 0.0]
    seen = inside(*predicted(a.sampled.astype(float), a.prior, b.prior, b), b)
    points = transforms.apply(a.prior.T_site_cam, a.sampled.astype(float))
    rays = [points - v.prior.T_site_cam[:3, 3] for v in (a, b)]
    far_a, far_b = (np.linalg.norm(r, axis=1) for r in rays)
    cosine = np.einsum("ni,ni->n", *rays) / (far_a * far_b)
    ratio = np.maximum(far_a / far_b, far_b / far_a)
    alike = (cosine > tuning.LEAST_ALIKE_COSINE) & (ratio < tuning.MOST_ALIKE_RATIO)
    return [float(seen.mean()), float((seen & alike).mean())]


def compared_pairs(views: Sequence[V], neighbours: int) -> List[ViewPair[V]]:
    """The pairs that are compared, in the order of the views: of each view those with the
    ``neighbours`` (0: all) that it looks most alike, those that hold all views together (the spanning
    forest that is likeliest), and all of a view whose prior is unknown."""
    pairs = [p for p in (pair_of(a, b) for a, b in itertools.combinations(views, 2)) if p]
    ranked = sorted((p for p in pairs if p.overlap is not None), key=lambda p: -p.likely)
    if not neighbours or not ranked:
        return pairs
    number = {v.name: i for i, v in enumerate(views)}
    count = dict.fromkeys(number, 0)
    chosen = _spanning(ranked, number)
    for p in ranked:
        if min(count[p.a.name], count[p.b.name]) < neighbours:
            chosen.add((p.a.name, p.b.name))
        for v in (p.a, p.b):
            count[v.name] += 1
    return [p for p in pairs if p.overlap is None or (p.a.name, p.b.name) in chosen]


def _spanning(ranked: List[ViewPair], number: Dict[str, int]) -> Set[tuple]:
    """Names of the pairs of the likeliest spanning forest."""
    rows, columns = ([number[v.name] for v in of] for of in zip(*((p.a, p.b) for p in ranked)))
    weights = np.arange(1.0, len(ranked) + 1.0)  # ranks: no two alike
    graph = coo_matrix((weights, (rows, columns)), (len(number), len(number)))
    return {
        (ranked[int(w) - 1].a.name, ranked[int(w) - 1].b.name)
        for w in minimum_spanning_tree(graph.tocsr()).data
    }
