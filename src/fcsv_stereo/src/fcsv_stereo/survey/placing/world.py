# SPDX-License-Identifier: Apache-2.0
"""All views in the earth's coordinates: control points and GPS beside edges and priors.

What the earth does not fix keeps its own frame: views that edges or stations hold together move as
one until three statements (two where gravity is known) place them.
"""

from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Dict, List, Optional, Sequence, Tuple

import gtsam
import numpy as np

from fcsv_geometry import chi_squared, transforms
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.edges.edge import Edge, with_reasons
from fcsv_stereo.survey.placing.adjust import (
    Adjusted,
    adjust,
    closing,
    components,
    optimised,
    placed_in,
    prior_at,
)
from fcsv_stereo.survey.placing.control_points import ControlSight
from fcsv_stereo.survey.views.view import View

_REWEIGHTS = 3  # covariances of statements follow the views' scales


@dataclass(frozen=True)
class Statement:
    """Point ``p_cam`` (3,) m of a view's camera and map, with ``covariance`` (3,3), lies at ``p``
    (3,) m of the earth's frame with ``sigma`` (3,) m per axis. GPS is one, too.

    ``word`` names it for people; ``point`` is a control point's name, empty for GPS.
    """

    view: str
    p_cam: np.ndarray
    covariance: np.ndarray
    p: np.ndarray
    sigma: np.ndarray
    point: str = ""

    @property
    def word(self) -> str:
        """What people read."""
        return f"control point {self.point} in {self.view}" if self.point else f"GPS of {self.view}"


@dataclass(frozen=True)
class Residual:
    """A statement's place by the views less that of the statement (3,) m east, north, up, with
    ``sigma`` (3,) of that difference; ``used``: whether it had a say."""

    statement: Statement
    off_m: np.ndarray
    sigma_m: np.ndarray
    used: bool


@dataclass(frozen=True)
class PointResidual:
    """A control point by all views that see it, less its coordinates: (3,) m east, north, up, and
    sigma."""

    name: str
    check: bool
    used: bool
    views: List[str]
    off_m: np.ndarray
    sigma_m: np.ndarray

    @property
    def unlikely(self) -> bool:
        """Whether it is farther off than ``tuning.UNLIKELY_SIGMAS`` in an axis."""
        return bool((np.abs(self.off_m) > tuning.UNLIKELY_SIGMAS * self.sigma_m).any())

    @property
    def kind(self) -> str:
        """What people read: check point, control point, or unused control point."""
        return "check point" if self.check else f"{'' if self.used else 'unused '}control point"


@dataclass(frozen=True)
class WorldFit:
    """Sigmas that all views have in common: place (m, per axis), heading (rad), scale (share); and
    what is left of each statement."""

    sigma_m: float
    sigma_heading_rad: float
    sigma_scale: float
    points: List[PointResidual] = field(default_factory=list)
    gps: List[Residual] = field(default_factory=list)


def unlikely_points(points: Sequence[PointResidual]) -> List[str]:
    """A sentence that names control and check points whose residuals their sigmas do not explain;
    none where there are none."""
    named = [f"{p.kind} {p.name} ({np.linalg.norm(p.off_m):.2f} m)" for p in points if p.unlikely]
    if not named:
        return []
    return [
        f"off by more than {tuning.UNLIKELY_SIGMAS:g} of their sigmas: {', '.join(named)}; look at their marks and "
        "coordinates, and at the depth there"
    ]


def statements_of(
    sights: Sequence[ControlSight], points: Dict[str, np.ndarray], sigma_m: float
) -> List[Statement]:
    """Statements of control points ``points`` (name to (3,) m in the earth's frame)."""
    sigma = np.full(3, sigma_m)
    return [
        Statement(s.view, s.p_cam, s.covariance, points[s.point], sigma, s.point) for s in sights
    ]


def adjust_world(
    views: Sequence[View],
    edges: Sequence[Edge],
    statements: Sequence[Statement],
    checks: Sequence[str] = (),
) -> Tuple[Adjusted, Optional[WorldFit]]:
    """All views' similarities in the earth's frame; ``checks``: control points without a say.

    Without enough statements the site stays in its own frame, the fit is None, and a remark says
    what is missing.
    """
    blocks, local = _blocks(views, edges)
    told = [s for s in statements if s.point not in checks]
    starts, lost = _aligned(views, blocks, told)
    if not starts:
        why = f"the site is not in the world's coordinates: {_too_few(told)}"
        return replace(adjust(views, edges), remarks=[*local.remarks, why]), None
    order = [v.name for v in views if v.name in starts]
    told = [s for s in told if s.view in starts]
    solution, wrong = _without_wrong(order, starts, local, told)
    placed = placed_in(solution.graph, solution.values, order, solution.kept)
    remarks = [*(r for r in local.remarks if "is the site's frame" not in r), *wrong]
    remarks += solution.remarks
    adjusted = Adjusted(
        placed, local.edges, lost, closing(local.edges, [v.name for v in views]), remarks
    )
    return adjusted, _fit(solution, order, placed, statements, checks)


@dataclass(frozen=True)
class _Block:
    """Views in one frame, which may be the stations'."""

    at: Dict[str, gtsam.Similarity3]
    stations: bool
    level: bool


def _blocks(views: Sequence[View], edges: Sequence[Edge]) -> Tuple[List[_Block], Adjusted]:
    """Views that hold each other, each group in a frame of its own; the edges with reasons, the
    priors as they counted."""
    left, blocks, remarks, priors = list(views), [], [], {}
    edges = list(edges)
    while left:
        names = {v.name for v in left}
        found = adjust(left, [e for e in edges if e.a in names and e.b in names])
        reasons = {(e.a, e.b): e.reason for e in found.edges if not e.kept}
        edges = with_reasons(edges, reasons)
        remarks += [r for r in found.remarks if r not in remarks]
        own = {v.name: v.prior for v in left}  # without what held the first view
        priors.update({n: replace(own[n], scale=found.priors[n].scale) for n in found.placed})
        stations = any(v.prior.placed for v in left)
        groups = [set(found.placed)]
        if not stations:
            groups = components([e for e in found.edges if e.kept], list(found.placed))
        for group in groups:
            at = {n: p.S_site_cam for n, p in found.placed.items() if n in group}
            level = any(np.isfinite(v.prior.tilt_rad) for v in left if v.name in at)
            blocks.append(_Block(at, stations, level))
        left = [v for v in left if v.name not in found.placed]
    return blocks, Adjusted({}, edges, {}, [], remarks, priors)


def _aligned(
    views: Sequence[View], blocks: Sequence[_Block], told: Sequence[Statement]
) -> Tuple[Dict[str, gtsam.Similarity3], Dict[str, str]]:
    """Views' starts in the earth's frame, and why others have none."""
    starts, lost = {}, {}
    for block in blocks:
        some = [s for s in told if s.view in block.at]
        M = _alignment(block, some)
        if M is None:
            lost.update({n: f"has no place in the world: {_too_few(some)}" for n in block.at})
            continue
        of = similarity.of_matrix(M)
        starts.update({n: of.compose(S) for n, S in block.at.items()})
    return {v.name: starts[v.name] for v in views if v.name in starts}, lost


def _too_few(told: Sequence[Statement]) -> str:
    points, fixes = len({s.point for s in told if s.point}), sum(not s.point for s in told)
    return (
        f"{points} control points and {fixes} GPS places are with it; three that are apart and not in a line are "
        "needed, two where gravity is known"
    )


def _alignment(block: _Block, told: Sequence[Statement]) -> Optional[np.ndarray]:
    """4x4 similarity from the block's frame to the earth's that most statements agree with; None
    where they fix none."""
    if not told:
        return None
    here = np.array([similarity.apply(block.at[s.view], s.p_cam[None])[0] for s in told])
    there = np.array([s.p for s in told])
    sigma = np.array([s.sigma for s in told])
    fewest = 2 if block.level else 3
    if not _spread(there, sigma, fewest):
        return None
    fit = _level_fit if block.level else (lambda a, b: similarity.fit(a[None], b[None])[0])
    # heights of GPS may not be known at all
    weigh = 1.0 / np.maximum(sigma, 0.1)
    best, least = None, np.inf
    count = len(told)
    sets = [list(range(count)), *map(list, combinations(range(count), fewest))]
    if len(sets) > tuning.DRAWS:
        some = np.random.default_rng(count).choice(
            np.arange(1, len(sets)), tuning.DRAWS, replace=False
        )
        sets = [sets[0], *(sets[i] for i in some)]
    for chosen in sets:
        if not _spread(there[chosen], sigma[chosen], fewest):
            continue
        M = fit(there[chosen], here[chosen])
        off = np.linalg.norm((transforms.apply(M, here) - there) * weigh, axis=1)
        if not np.isfinite(off).all():
            continue
        score = float(np.median(off)) + 1e-3 * float(np.mean(np.minimum(off, 1e3)))
        if score < least:
            best, least = M, score
    return best


def _spread(p: np.ndarray, sigma: np.ndarray, fewest: int) -> bool:
    """Whether points (N,3) lie apart: two across the ground, or three not in one line."""
    if len(p) < fewest:
        return False
    apart = tuning.APART_SIGMAS * float(np.median(sigma[:, :2]))
    across = p[:, :2] - p[:, :2].mean(axis=0) if fewest == 2 else p - p.mean(axis=0)
    lengths = np.linalg.svd(across, compute_uv=False)
    return bool(lengths[0 if fewest == 2 else 1] > apart)


def _level_fit(p_a: np.ndarray, p_b: np.ndarray) -> np.ndarray:
    """4x4 similarity with p_a = M p_b that turns about z alone; least squares of x and y."""
    a, b = p_a - p_a.mean(axis=0), p_b - p_b.mean(axis=0)
    z = np.vdot(b[:, 0] + 1j * b[:, 1], a[:, 0] + 1j * a[:, 1])
    z = z / max(float(np.square(b[:, :2]).sum()), 1e-12)
    scale = abs(z)
    M = transforms.from_xyz_yaw(np.zeros(3), float(np.angle(z)))
    M[:3, :3] *= scale
    M[:3, 3] = p_a.mean(axis=0) - M[:3, :3] @ p_b.mean(axis=0)
    return M


@dataclass(frozen=True)
class _WorldSolution:
    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    kept: List[Edge]
    told: List[Statement]
    remarks: List[str]


def _without_wrong(
    order: Sequence[str],
    starts: Dict[str, gtsam.Similarity3],
    local: Adjusted,
    told: List[Statement],
) -> Tuple[_WorldSolution, List[str]]:
    """The adjustment without statements that contradict all others; sentences on these."""
    said, most = [], int(tuning.MOST_WRONG * len(told))
    limit = chi_squared.quantile(tuning.KEPT_P, 3)
    while True:
        found = _solved(order, starts, local, told)
        residuals = [residual(s, found.values, order, False) for s in found.told]
        worst = max(residuals, key=_squared, default=None)
        if worst is None or _squared(worst) <= limit or len(said) >= most:
            return found, said
        said.append(
            f"{worst.statement.word}: {np.linalg.norm(worst.off_m):.2f} m from where all others put it, "
            f"{np.sqrt(_squared(worst)):.0f} times its sigma; it has no say. Look at its coordinates and its pixel"
        )
        told = [s for s in told if s is not worst.statement]


def _squared(r: Residual) -> float:
    """Mahalanobis distance squared, of axes by themselves."""
    return float(np.sum(np.square(r.off_m / r.sigma_m)))


def _solved(order, starts, local: Adjusted, told: List[Statement]) -> _WorldSolution:
    """The least squares of edges, priors and statements."""
    keys = {n: i for i, n in enumerate(order)}
    kept = [e for e in local.edges if e.kept and e.a in keys and e.b in keys]
    values = gtsam.Values()
    for name, S in ((n, starts[n]) for n in order):
        values.insert(keys[name], S)
    at_stations = [n for n in order if local.priors[n].placed]
    if at_stations:
        first = at_stations[0]
        T = similarity.of_pose(local.priors[first].T_site_cam)
        values.insert(len(order), _rigid(starts[first].compose(T.inverse())))
    priors, remarks = _in_metres(order, starts, local)
    for _ in range(_REWEIGHTS):
        graph = gtsam.NonlinearFactorGraph()
        for name in order:
            _add_prior(graph, priors[name], keys[name], len(order), values)
        if at_stations:
            graph.add(_stations_factor(len(order), values))
        for e in kept:
            noise = gtsam.noiseModel.Gaussian.Covariance(e.covariance)
            graph.add(gtsam.BetweenFactorSimilarity3(keys[e.a], keys[e.b], e.S_a_b, noise))
        for s in told:
            graph.add(_point_factor(s, keys[s.view], values.atSimilarity3(keys[s.view])))
        values = optimised(graph, values)
    return _WorldSolution(graph, values, kept, told, remarks)


def _rigid(S: gtsam.Similarity3) -> gtsam.Similarity3:
    """S with scale 1 and the same image of the origin."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = similarity.rotation(S), similarity.place(S)
    return similarity.of_pose(T)


def _in_metres(order, starts, local: Adjusted):
    """Priors by name; of models whose unit is no metre without a say on scale, which a sentence
    tells."""
    priors = {n: local.priors[n] for n in order}
    off = {n: starts[n].scale() for n in order if not priors[n].placed}
    free = {n for n, s in off.items() if abs(np.log(s)) > tuning.MOST_METRE_OFF}
    if not free:
        return priors, []
    scale = float(np.median([off[n] for n in free]))
    said = (
        f"{', '.join(sorted(free))}: lengths are not metres: {scale:.4g} m each by the world's coordinates, "
        "which alone tell the scale"
    )
    return {
        n: replace(p, scale=tuning.FREE_SCALE) if n in free else p for n, p in priors.items()
    }, [said]


def _add_prior(graph, prior, key: int, stations: int, values) -> None:
    """A station's prior stands in the stations' frame, another's in the earth's."""
    S = values.atSimilarity3(key)
    if not prior.placed:
        mean, covariance = prior_at(prior, S)
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        graph.add(gtsam.PriorFactorSimilarity3(key, mean, noise))
        return
    mean, covariance = prior_at(prior, S)
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    graph.add(gtsam.BetweenFactorSimilarity3(stations, key, mean, noise))


def _stations_factor(key: int, values):
    """The stations' frame: upright, in metres, of any place and heading."""
    S = values.atSimilarity3(key)
    R = transforms.from_xyz_yaw(np.zeros(3), transforms.yaw(similarity.matrix(_rigid(S))))
    R[:3, 3] = similarity.place(S)
    tilt, free = tuning.STATIONS_TILT_RAD, tuning.FREE_RAD
    sigmas = np.array([tilt, tilt, free, *[tuning.FREE_M] * 3, tuning.STATIONS_SCALE])
    return gtsam.PriorFactorSimilarity3(
        key, similarity.of_pose(R), gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    )


def point_jacobian(S: gtsam.Similarity3, p: np.ndarray) -> np.ndarray:
    """(3,7) of S p by S's tangent.

    >>> S = similarity.of_pose(np.eye(4), 2.0)
    >>> point_jacobian(S, np.array([1.0, 0.0, 0.0]))[:, 6].tolist()
    [2.0, 0.0, 0.0]
    """
    x, y, z = p
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return S.scale() * similarity.rotation(S) @ np.column_stack([-cross, np.eye(3), p])


def _covariance(s: Statement, S: gtsam.Similarity3) -> np.ndarray:
    """(3,3) m² of a statement in the earth's frame: that of the view's point, and of the
    coordinates."""
    A = S.scale() * similarity.rotation(S)
    return A @ s.covariance @ A.T + np.diag(np.square(s.sigma))


def _point_factor(s: Statement, key: int, S: gtsam.Similarity3):
    def error(factor, values, jacobians):
        at = values.atSimilarity3(factor.keys()[0])
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(point_jacobian(at, s.p_cam))
        return similarity.apply(at, s.p_cam[None])[0] - s.p

    noise = gtsam.noiseModel.Gaussian.Covariance(_covariance(s, S))
    return gtsam.CustomFactor(noise, [key], error)


def residual(s: Statement, values, order, used: bool) -> Residual:
    """What is left of a statement; sigma is that of the statement alone where it had a say."""
    S = values.atSimilarity3(list(order).index(s.view))
    off = similarity.apply(S, s.p_cam[None])[0] - s.p
    return Residual(s, off, np.sqrt(np.diag(_covariance(s, S))), used)


def _fit(
    solution: _WorldSolution, order, placed, statements: Sequence[Statement], checks
) -> WorldFit:
    """Common sigmas, and what is left of all statements."""
    used = {id(s) for s in solution.told}
    said = [s for s in statements if s.view in placed]
    gps = [residual(s, solution.values, order, id(s) in used) for s in said if not s.point]
    names = sorted({s.point for s in said if s.point})
    points = []
    for name in names:
        of = [s for s in said if s.point == name]
        points.append(_of_point(name, of, placed, name in checks, used))
    return WorldFit(*_common(solution, order), points, gps)


def _of_point(name: str, of: List[Statement], placed, check: bool, used) -> PointResidual:
    """A control point by the views that see it, weighed by their covariances."""
    counted = [s for s in of if check or id(s) in used] or of
    weight, mean, pose = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    for s in counted:
        P = placed[s.view]
        S = P.S_site_cam
        own = _covariance(replace(s, sigma=np.full(3, 1e-4)), S)
        J = point_jacobian(S, s.p_cam)
        pose += J @ P.covariance @ J.T / len(counted)
        W = np.linalg.inv(own)
        weight += W
        mean += W @ similarity.apply(S, s.p_cam[None])[0]
    own = np.linalg.inv(weight)
    covariance = own + pose + np.diag(np.square(of[0].sigma))
    return PointResidual(
        name,
        check,
        any(id(s) in used for s in of),
        [s.view for s in of],
        own @ mean - of[0].p,
        np.sqrt(np.diag(covariance)),
    )


def _common(solution: _WorldSolution, order) -> Tuple[float, float, float]:
    """Sigmas of the mean place (m), heading (rad) and scale of all views."""
    count = len(order)
    ordering = gtsam.Ordering()
    for key in sorted(solution.values.keys()):
        ordering.push_back(key)
    H = solution.graph.linearize(solution.values).hessian(ordering)[0]
    C = np.linalg.inv(H)
    place, heading, scale = np.zeros((3, len(C))), np.zeros(len(C)), np.zeros(len(C))
    for i in range(count):
        S, at = solution.values.atSimilarity3(i), similarity.TANGENT * i
        R = similarity.rotation(S)
        place[:, at + 3 : at + 6] = S.scale() * R / count
        heading[at : at + 3] = R[2] / count
        scale[at + 6] = 1.0 / count
    spread = place @ C @ place.T
    return (
        float(np.sqrt(np.trace(spread) / 3.0)),
        float(np.sqrt(heading @ C @ heading)),
        float(np.sqrt(scale @ C @ scale)),
    )
