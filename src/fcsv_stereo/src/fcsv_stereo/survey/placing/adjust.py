# SPDX-License-Identifier: Apache-2.0
"""One frame for all views: similarities adjusted to edges and priors (GTSAM); wrong edges are
thrown out by graduated non-convexity (Yang, Antonante, Tzoumas, Carlone 2020).
"""

from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Sequence, Set, Tuple

import gtsam
import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from fcsv_geometry import transforms
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.edges.edge import Edge, with_reasons
from fcsv_stereo.survey.views.station import Prior
from fcsv_stereo.survey.views.view import View

_LEAST_WEIGHT = 0.5  # graduated non-convexity ends with weights of 0 or 1


@dataclass(frozen=True)
class Placed:
    """A view in the site. ``S_site_cam`` of its reference camera; ``covariance`` (7,7) of its
    tangent in the site, ``relative`` (7,7) against all views of its group as a whole: of those that
    edges join with it. ``datum`` names the group by the view with most edges. ``alone``: no edge
    holds it, its priors do."""

    name: str
    S_site_cam: gtsam.Similarity3
    covariance: np.ndarray
    relative: np.ndarray
    alone: bool
    datum: str

    def __reduce__(self):
        """GTSAM's similarity does not go to another process; its numbers do."""
        numbers = similarity.numbers(self.S_site_cam)
        rest = self.covariance, self.relative, self.alone, self.datum
        return _placed, (self.name, numbers, *rest)

    @property
    def scale(self) -> float:
        """Metres of the site per metre of the view's map."""
        return float(self.S_site_cam.scale())

    @property
    def sigma_scale(self) -> float:
        """Gives sigma as a share."""
        return float(np.sqrt(self.covariance[6, 6]))

    @property
    def sigma_m(self) -> float:
        """Gives sigma of the camera's place, per axis."""
        return self.scale * float(np.sqrt(np.trace(self.covariance[3:6, 3:6]) / 3.0))

    @property
    def sigma_yaw_rad(self) -> float:
        """About the site's z."""
        up = similarity.rotation(self.S_site_cam)[2]
        return float(np.sqrt(up @ self.covariance[:3, :3] @ up))


def _placed(name: str, numbers: tuple, *rest) -> Placed:
    return Placed(name, similarity.of_numbers(*numbers), *rest)


@dataclass(frozen=True)
class Loop:
    """Views in a circle of edges, and what is left after going round: m, degrees, share of the
    scale."""

    views: List[str]
    closing_m: float
    closing_deg: float
    closing_scale: float


@dataclass(frozen=True)
class Adjusted:
    """Views that have a place, by name; all edges, with reasons; ``lost``: why a view has no place;
    loops; ``remarks``, each a sentence with its remedy; ``priors`` as they counted, by name."""

    placed: Dict[str, Placed]
    edges: List[Edge]
    lost: Dict[str, str]
    loops: List[Loop]
    remarks: List[str]
    priors: Dict[str, Prior] = field(default_factory=dict)


def adjust(views: Sequence[View], edges: Sequence[Edge]) -> Adjusted:
    """All views' similarities. Where no view's place is known the first view's home is the site's
    frame."""
    priors, remarks = _anchored(views)
    order = [v.name for v in views]
    edges, lost = list(edges), {}
    found = _solved(order, priors, edges)
    if found is not None:
        off = _off_scale(found, edges)
        remarks += [_scale_words(name, share, alone) for name, share, alone in off]
        if off:  # its own prior pulls all others
            free = {name for name, _, _ in off}
            priors = {n: replace(p, scale=1.0) if n in free else p for n, p in priors.items()}
            found = _solved(order, priors, edges) or found
        edges = found.edges
    placed = found.placed if found is not None else {}
    for name in (n for n in order if n not in placed):
        lost[name] = (
            f"has no place: no station.yaml, and no edge to a view that has one{_why(name, edges)}"
        )
    return Adjusted(placed, edges, lost, closing(edges, order), remarks, priors)


def _why(name: str, edges: Sequence[Edge]) -> str:
    """The best of the reasons why no edge holds a view, in brackets."""
    refused = [e for e in edges if name in (e.a, e.b) and not e.kept]
    if not refused:
        return ""
    best = max(refused, key=lambda e: e.matches)
    return f" ({best.a if best.b == name else best.b}: {best.reason})"


def _anchored(views: Sequence[View]) -> Tuple[Dict[str, Prior], List[str]]:
    priors = {v.name: v.prior for v in views}
    if any(p.placed for p in priors.values()) or not views:
        return priors, []
    first = views[0]
    prior = Prior(
        first.T_home_cam, tuning.ANCHOR_RAD, tuning.ANCHOR_RAD, tuning.ANCHOR_M, first.prior.scale
    )
    said = f"no station.yaml says where a view is: the home of {first.name} is the site's frame"
    return {**priors, first.name: prior}, [said]


@dataclass(frozen=True)
class _Solution:
    placed: Dict[str, Placed]
    edges: List[Edge]


def _solved(
    order: Sequence[str], priors: Dict[str, Prior], edges: List[Edge]
) -> Optional[_Solution]:
    """Starts along the surest edges, wrong edges out, the last fit of those that are left."""
    starts = _starts(order, priors, [e for e in edges if e.kept])
    if not starts:
        return None
    inside = [e for e in edges if e.kept and e.a in starts and e.b in starts]
    wrong = _wrong_edges(starts, priors, inside)
    edges = with_reasons(edges, wrong)
    kept = [e for e in inside if (e.a, e.b) not in wrong]
    starts = _starts(order, priors, kept)
    graph, initial = _graph(starts, priors, kept)
    values = optimised(graph, initial)
    return _Solution(placed_in(graph, values, list(starts), kept), edges)


def placed_in(graph, values, names: Sequence[str], kept: Sequence[Edge]) -> Dict[str, Placed]:
    """Views, whose keys are their numbers in ``names``, with their covariances in a solved
    graph."""
    marginals = gtsam.Marginals(graph, values)
    keys, degree = {n: i for i, n in enumerate(names)}, dict.fromkeys(names, 0)
    for e in kept:
        degree[e.a] += 1
        degree[e.b] += 1
    own = {key: marginals.marginalCovariance(key) for key in keys.values()}
    information, placed = _information(graph, values), {}
    for group in components(kept, list(names)):
        datum = max(sorted(group), key=lambda m: degree[m])
        of = sorted(keys[n] for n in group)
        for key, relative in zip(of, _against_group(information, values, own, of)):
            name, S = names[key], values.atSimilarity3(key)
            placed[name] = Placed(name, S, own[key], relative, degree[name] == 0, datum)
    return {n: placed[n] for n in names}


def _starts(
    order: Sequence[str], priors: Dict[str, Prior], edges: Sequence[Edge]
) -> Dict[str, gtsam.Similarity3]:
    """Where views begin: at their priors, or along the edges with most matches from views that have
    a place."""
    found = {n: similarity.of_pose(priors[n].T_site_cam) for n in order if priors[n].placed}
    while True:
        ways = [e for e in edges if (e.a in found) != (e.b in found)]
        if not ways:
            return {n: found[n] for n in order if n in found}
        e = max(ways, key=lambda e: e.matches)
        if e.a in found:
            found[e.b] = found[e.a].compose(e.S_a_b)
        else:
            found[e.a] = found[e.b].compose(e.S_a_b.inverse())


def _graph(starts: Dict[str, gtsam.Similarity3], priors: Dict[str, Prior], edges: Sequence[Edge]):
    """Priors first, in the order of ``starts``, then the edges."""
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    keys = {n: i for i, n in enumerate(starts)}
    for name, S in starts.items():
        mean, covariance = prior_at(priors[name], S)
        graph.add(
            gtsam.PriorFactorSimilarity3(
                keys[name], mean, gtsam.noiseModel.Gaussian.Covariance(covariance)
            )
        )
        initial.insert(keys[name], S)
    for e in edges:
        noise = gtsam.noiseModel.Gaussian.Covariance(e.covariance)
        graph.add(gtsam.BetweenFactorSimilarity3(keys[e.a], keys[e.b], e.S_a_b, noise))
    return graph, initial


def prior_at(prior: Prior, start: gtsam.Similarity3) -> Tuple[gtsam.Similarity3, np.ndarray]:
    """Mean and covariance (7,7) of a prior; what it does not know is loose about ``start``."""
    T = np.array(prior.T_site_cam, float)
    R_start = similarity.rotation(start)
    if not np.isfinite(prior.tilt_rad):
        T[:3, :3] = R_start
    elif not np.isfinite(prior.yaw_rad):  # the prior's tilt with the start's yaw
        turn = R_start @ T[:3, :3].T
        T[:3, :3] = (
            transforms.from_xyz_yaw(np.zeros(3), np.arctan2(turn[1, 0], turn[0, 0]))[:3, :3]
            @ T[:3, :3]
        )
    if not np.isfinite(prior.place_m):
        T[:3, 3] = similarity.place(start)
    tilt, yaw = (min(rad, tuning.FREE_RAD) for rad in (prior.tilt_rad, prior.yaw_rad))
    covariance = np.zeros((7, 7))
    covariance[:3, :3] = T[:3, :3].T @ np.diag([tilt**2, tilt**2, yaw**2]) @ T[:3, :3]
    covariance[3:6, 3:6] = min(prior.place_m, tuning.FREE_M) ** 2 * np.eye(3)
    covariance[6, 6] = prior.scale**2
    return similarity.of_pose(T), covariance


def _wrong_edges(
    starts, priors: Dict[str, Prior], edges: Sequence[Edge]
) -> Dict[Tuple[str, str], str]:
    """Says, by (a, b): why graduated non-convexity throws an edge out."""
    if not edges:
        return {}
    graph, initial = _graph(starts, priors, edges)
    params = gtsam.GncLMParams()
    params.setKnownInliers(list(range(len(starts))))
    optimizer = gtsam.GncLMOptimizer(graph, initial, params)
    optimizer.setInlierCostThresholdsAtProbability(tuning.KEPT_P)
    values = optimizer.optimize()
    weights = np.asarray(optimizer.getWeights())[len(starts) :]
    keys = {n: i for i, n in enumerate(starts)}
    reasons = {}
    for e, weight in zip(edges, weights):
        if weight >= _LEAST_WEIGHT:
            continue
        S = similarity.between(values.atSimilarity3(keys[e.a]), values.atSimilarity3(keys[e.b]))
        off = gtsam.Similarity3.Logmap(e.S_a_b.inverse().compose(S))
        times = float(np.sqrt(off @ np.linalg.solve(e.covariance, off)))
        reasons[e.a, e.b] = (
            f"contradicts the other edges and places by {times:.0f} times its sigma ({np.linalg.norm(off[3:6]):.2f} m, "
            f"{np.degrees(np.linalg.norm(off[:3])):.2f} degrees, {abs(off[6]):.1%} of scale)"
        )
    return reasons


def optimised(graph, initial):
    """The values at the least error (Levenberg-Marquardt)."""
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(100)
    params.setRelativeErrorTol(1e-9)
    return gtsam.LevenbergMarquardtOptimizer(graph, initial, params).optimize()


def _information(graph, values) -> csc_matrix:
    """(7N,7N) of all views' tangents in a solved graph."""
    rows, columns, entries = graph.linearize(values).sparseJacobian_()
    at = rows.astype(int) - 1, columns.astype(int) - 1
    # the last column is of what is left over, and has no entries where that is nothing
    J = coo_matrix((entries, at), (at[0].max() + 1, 7 * values.size() + 1)).tocsc()[:, :-1]
    return (J.T @ J).tocsc()


def _against_group(
    information: csc_matrix, values, own: Dict[int, np.ndarray], keys: Sequence[int]
) -> List[np.ndarray]:
    """(7,7) of the tangent of each view of a group less that of the similarity that fits the errors
    of all best (an S-transformation, Baarda 1981): one view as datum would count as known, and those
    far from it as unsure."""
    if len(keys) == 1:
        return [np.zeros((7, 7))]
    moves = {k: values.atSimilarity3(k).inverse().AdjointMap() for k in keys}
    weights = np.ones(7)
    weights[similarity.ROTATION] = weights[similarity.LOG_SCALE] = tuning.DATUM_M**2
    normal = sum(A.T @ (weights[:, None] * A) for A in moves.values())
    # transposed: of the fitted similarity by all views' errors
    fit = np.zeros((information.shape[1], 7))
    for k, A in moves.items():
        fit[7 * k : 7 * k + 7] = np.linalg.solve(normal, A.T * weights).T
    parts = connected_components(information, directed=False)[1]
    part = np.flatnonzero(parts == parts[7 * keys[0]])
    own_part = information[part][:, part]
    own_part.sort_indices()  # so that what else there is changes no bit
    with_fit = np.zeros(fit.shape)  # its covariance with each view
    with_fit[part] = splu(own_part).solve(fit[part])
    of_fit = fit[part].T @ with_fit[part]
    found = []
    for k, A in moves.items():
        shared = with_fit[7 * k : 7 * k + 7] @ A.T
        found.append(own[k] - shared - shared.T + A @ of_fit @ A.T)
    return found


def _off_scale(found: _Solution, edges: Sequence[Edge]) -> List[Tuple[str, float, bool]]:
    """Views whose scale is off the others' (median of those that edges join with it), by how much;
    and whether there is but one other."""
    out = []
    groups = components([e for e in found.edges if e.kept], list(found.placed))
    for group in groups:
        logs = {n: np.log(found.placed[n].scale) for n in group}
        for name in group:
            others = [s for n, s in logs.items() if n != name]
            if not others:
                continue
            off = float(np.expm1(logs[name] - np.median(others)))
            if abs(off) > tuning.MOST_SCALE_OFF:
                out.append((name, off, len(others) == 1))
    return out


def _scale_words(name: str, share: float, two: bool) -> str:
    """A view's metre is (1 + share) metres of the site: what it calls a metre is too long, its map
    too small."""
    way = "small" if share > 0 else "large"
    which = "this or the other view" if two else "this view"
    return (
        f"{name}: its map is {abs(share):.1%} too {way} against the others'; it is corrected. Look at the calibration, "
        f"the tracker or the baselines of {which}"
    )


def components(edges: Sequence[Edge], names: Sequence[str]) -> List[Set[str]]:
    """Groups of views that edges join."""
    of = {n: {n} for n in names}
    for e in edges:
        if e.a in of and e.b in of and of[e.a] is not of[e.b]:
            of[e.a] |= of[e.b]
            for n in of[e.b]:
                of[n] = of[e.a]
    return list({id(group): group for group in of.values()}.values())


def closing(edges: Sequence[Edge], order: Sequence[str]) -> List[Loop]:
    """What is left after going round: a loop for each kept edge that is not in the tree of those
    with most matches."""
    kept = sorted((e for e in edges if e.kept), key=lambda e: -e.matches)
    tree: Dict[str, Dict[str, gtsam.Similarity3]] = {n: {} for n in order}
    loops = []
    for e in kept:
        way = _way(tree, e.a, e.b)
        if way is None:
            tree[e.a][e.b], tree[e.b][e.a] = e.S_a_b, e.S_a_b.inverse()
            continue
        S = e.S_a_b.inverse()
        for one, other in zip(way[:-1], way[1:]):
            S = S.compose(tree[one][other])
        off = gtsam.Similarity3.Logmap(S)
        loops.append(
            Loop(
                way,
                float(np.linalg.norm(similarity.place(S))),
                float(np.degrees(np.linalg.norm(off[:3]))),
                float(abs(np.expm1(off[6]))),
            )
        )
    return loops


def _way(tree, start: str, end: str) -> Optional[List[str]]:
    """Names from start to end along the tree; None where they are not joined."""
    ways = [[start]]
    seen = {start}
    while ways:
        way = ways.pop(0)
        if way[-1] == end:
            return way
        for name in (n for n in tree[way[-1]] if n not in seen):
            seen.add(name)
            ways.append([*way, name])
    return None
