# SPDX-License-Identifier: Apache-2.0
"""The adjustment repeated until every picture in it agrees with the others; those that do not are
left out."""

from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_stereo.pose_covariance import relative_common, to_camera
from fcsv_stereo.refinement.adjust import AdjustedPoses, Problem, adjust
from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.geometry import PairPrior
from fcsv_stereo.refinement.graph import prior_to_reference
from fcsv_stereo.refinement.links import PairLink
from fcsv_stereo.refinement.structure import Observations
from fcsv_stereo.refinement.time_offset import Motion
from fcsv_stereo.refinement.types import RefineOptions
from fcsv_stereo.refinement.wrong_priors import settled

_FIRST_NOISE = 0.4  # of a feature's: what tracking is taken to leave until the residuals tell
_LEAST_NOISE_PX = 0.05
_LEAST_SHARE = 0.5  # of a picture's observations must fit the others'
_FEWEST = 8  # points that a pose is from
# of the inliers that a link must have: what is tracked is surer than what only looks alike
_LEAST_MEASURED = 0.6
# Neighbouring patches share pixels and the same change of view, so their errors are not
# independent. This factor makes the reported covariance agree with the errors on scenes with known
# truth (bench_refinement.py, docs/lab/results.md).
_CORRELATION = 2.5


@dataclass(frozen=True)
class Consensus:
    """``adjusted`` from ``observations`` (those that fit), None where nothing was left; why
    pictures were left out.

    ``problem`` is what was adjusted last.
    """

    adjusted: Optional[AdjustedPoses]
    observations: Optional[Observations]
    refused: Dict[int, str] = field(default_factory=dict)
    moving: List[Motion] = field(default_factory=list)
    problem: Optional[Problem] = None


def adjust_robustly(
    views: List[FeatureView],
    found: Optional[Tuple[Observations, np.ndarray]],
    links: List[PairLink],
    starts: Dict[int, np.ndarray],
    moving: List[Motion],
    options: RefineOptions,
) -> Consensus:
    """All pictures that the links reach, less those that the others contradict."""
    if found is None:
        return Consensus(None, None)
    observations, rho = found
    priors = _priors(views, links, starts, options)
    refused: Dict[int, str] = {}
    least = max(int(_LEAST_MEASURED * options.least_inliers), _FEWEST)
    poses = dict(starts)
    while priors:
        of = _among(observations, [0, *priors])
        few = _few(of, priors, least)
        if few:
            refused.update(few)
            priors = {k: p for k, p in priors.items() if k not in few}
            continue
        problem = _problem(
            views,
            of,
            priors,
            {k: _FIRST_NOISE * views[k].noise_px for k in priors},
            moving,
            options,
        )
        first = adjust(problem, poses, rho)
        noise_px, fits = _noise_and_fit(of, first)
        worst = _worst(of, fits, priors)
        if worst is not None:
            refused[worst] = (
                "what it shows contradicts the other pictures (another place, or something moved)"
            )
            priors = {k: p for k, p in priors.items() if k != worst}
            continue
        of = of.select(fits)
        few = _few(of, priors, least)
        if few:
            refused.update(few)
            priors = {k: p for k, p in priors.items() if k not in few}
            continue
        problem = _problem(views, of, priors, noise_px, moving, options)
        problem, adjusted = settled(problem, adjust(problem, first.poses, first.rho))
        return Consensus(adjusted, of, refused, problem.moving, problem)
    return Consensus(None, None, refused)


def _priors(views, links, starts, options) -> Dict[int, PairPrior]:
    """Gives the prior of each reached picture relative to the reference, in force: looser where a
    link showed it to be wrong."""
    priors = {}
    for k in sorted(starts):
        if k:
            given = prior_to_reference(views, k, options.prior)
            direct = [l.prior for l in links if (l.a, l.b) == (0, k)]
            loose = [l for l in links if l.loosened and l.b == k and l.a]
            if direct:
                given = direct[0]
            elif loose:
                T = given.T_a_b.copy()
                T[:3, :3] = starts[k][:3, :3]
                given = replace(given, T_a_b=T, rotation_rad=loose[0].prior.rotation_rad)
            priors[k] = given
    return priors


def _problem(views, observations, priors, noise_px, moving, options) -> Problem:
    pictures = [0, *priors]
    focals_px = {k: views[k].camera.fx for k in pictures}
    # one that only anchors has none
    noise = {**dict.fromkeys(pictures, min(noise_px.values())), **noise_px}
    focal_sigma = options.focal_sigma if options.refine_focal else 0.0
    still = [m for m in (m.among(list(priors)) for m in moving) if m.pictures]
    shared = _shared(views, priors)
    return Problem(
        observations,
        priors,
        focals_px,
        noise,
        focal_sigma,
        still,
        options.time_offset_sigma_s,
        shared,
    )


def _shared(
    views: List[FeatureView], priors: Dict[int, PairPrior]
) -> Dict[Tuple[int, int], np.ndarray]:
    """What the priors of two pictures have in common: the reference's error, and that of a
    vehicle's odometry."""
    known = [k for k, p in sorted(priors.items()) if p.covariance is not None]
    turn = {k: to_camera(views[k].picture, position_too=True) for k in known}
    return {
        (a, b): turn[a] @ relative_common(*(views[i].picture for i in (0, a, b))) @ turn[b].T
        for a in known
        for b in known
        if a < b
    }


def _among(observations: Observations, pictures: List[int]) -> Observations:
    known = np.isin(observations.picture, pictures) & np.isin(
        observations.anchor[observations.point], pictures
    )
    return observations.select(known)


def _few(observations: Observations, priors, least: int) -> Dict[int, str]:
    """Pictures with fewer observations than need be; those seen only as anchors count what hangs on
    them."""
    out = {}
    anchors = observations.anchor[observations.point]
    for k in priors:
        count = int(((observations.picture == k) | (anchors == k)).sum())
        if count < least:
            out[k] = (
                f"only {count} points with parallax could be measured in it (blur, exposure, sky, nothing near)"
            )
    return out


def _noise_and_fit(
    observations: Observations, adjusted: AdjustedPoses
) -> Tuple[Dict[int, float], np.ndarray]:
    """Measuring noise by picture (px, per axis) and which observations fit.

    From points that three pictures see; of others the residual along the epipolar line is nil by
    construction, and its length the error across.
    """
    several = np.bincount(observations.point)[observations.point] > 1
    noise_px, fits = {}, np.zeros(len(observations.point), bool)
    for k in set(adjusted.order) | {0}:
        of = observations.picture == k
        if not of.any():
            continue
        both = of & several
        errors_px = (
            np.abs(adjusted.residual_px[both])
            if both.sum() > 20
            else np.hypot(*adjusted.residual_px[of].T)
        )
        spread_px = 1.4826 * float(np.median(errors_px))
        spread_px = max(spread_px, _LEAST_NOISE_PX)
        fits[of] = np.hypot(*adjusted.residual_px[of].T) < max(4.0 * spread_px, 0.5)
        noise_px[k] = _CORRELATION * spread_px
    return noise_px, fits


def _worst(observations: Observations, fits: np.ndarray, priors) -> Optional[int]:
    shares = {
        k: float(fits[observations.picture == k].mean())
        for k in priors
        if (observations.picture == k).any()
    }
    k = min(shares, key=shares.get) if shares else None
    return k if k is not None and shares[k] < _LEAST_SHARE else None
