# SPDX-License-Identifier: Apache-2.0
"""One picture whose focal length is not the others': told by how much larger it shows what others
show.

A picture of another focal length than is stated for it is scaled about its middle, which no turn
and, where points lie at several distances, no movement is. Matches are made in a band that is wide
enough for it; poses follow.
"""

from dataclasses import dataclass
from typing import Dict, List, Optional

import numpy as np

from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.geometry import PairPrior, epipolar_error, fit_pair, moved, prior_offset
from fcsv_stereo.refinement.graph import prior_to_reference
from fcsv_stereo.refinement.matching import match_in_band
from fcsv_stereo.refinement.types import RefineOptions

_TRIED = np.exp(np.linspace(-0.3, 0.3, 13))  # scales: 0.74 to 1.35
# of the picture's half height that a band is wide: what a scale of 1.3 does to most matches
_WIDE_SHARE = 0.16
_TURN_RAD, _POSITION_SHARE = np.radians(2.0), 0.03  # priors may be as wrong beside
_ANYWHERE_SHARE = 0.5  # of the baseline
_LEAST = 0.02  # a smaller difference is told by no pair beyond doubt
_MARGIN = 25.0  # drop of twice the robust cost, at which a scale is taken for one
_LEAST_SHARE = 0.3  # of the matches must agree
_CORRELATION = 2.5  # as in the adjustment


@dataclass(frozen=True)
class Scale:
    """A picture's focal length over the stated one, relative to the reference's: its logarithm and
    how well known."""

    log: float
    sigma: float


@dataclass(frozen=True)
class OddFocals:
    """Holds, by number the ``factors`` of the focal lengths of pictures that differ from the
    others; ``outvoted`` where most pictures agree, so that these are the wrong ones."""

    factors: Dict[int, float]
    outvoted: bool


def relative_scale(a: FeatureView, b: FeatureView, prior: PairPrior, least: int) -> Optional[Scale]:
    """Gives the scale of b against a; None where their features do not tell it, 0 where they do not
    contradict the stated one."""
    baseline_m = float(np.linalg.norm(prior.T_a_b[:3, 3]))
    if not baseline_m > 0.0:  # such a pair has no epipolar lines
        return None
    position_m = max(prior.position_m, _POSITION_SHARE * baseline_m)
    wide = PairPrior(prior.T_a_b, max(prior.rotation_rad, _TURN_RAD), position_m)
    band_px = _WIDE_SHARE * 0.5 * b.camera.height + 3.0 * wide.rotation_rad * b.camera.fx
    matches = match_in_band(a, b, wide, band_px)
    if len(matches) < least:
        return None
    rays_a, rays_b, f = a.rays[matches.a], b.rays[matches.b], b.camera.fx
    fits = []
    for scale in _TRIED:
        T, error_px = fit_pair(
            wide, rays_a, _scaled(rays_b, 1.0 / scale), f * scale, band_px, b.noise_px
        )
        fits.append((_cost(error_px, b.noise_px) + _prior_cost(wide, T), T, scale))
    as_stated = min(fits[len(_TRIED) // 2][0], _moved_instead(wide, rays_a, rays_b, b, band_px))
    cost, T, scale = min(fits, key=lambda fit: fit[0])
    log, sigma, share, cost = _finished(
        wide, rays_a, rays_b, f, b.noise_px, T, float(np.log(scale)), cost
    )
    if share < _LEAST_SHARE or share * len(matches) < least:
        return None
    return Scale(log, sigma) if as_stated - cost > _MARGIN else Scale(0.0, sigma)


def _moved_instead(prior: PairPrior, rays_a, rays_b, b: FeatureView, band_px: float) -> float:
    """Cost of the stated focal length where the place may be anywhere near: before a flat scene,
    that of a camera which stood nearer looks like that of a longer lens."""
    anywhere = PairPrior(
        prior.T_a_b, prior.rotation_rad, _ANYWHERE_SHARE * float(np.linalg.norm(prior.T_a_b[:3, 3]))
    )
    T, error_px = fit_pair(anywhere, rays_a, rays_b, b.camera.fx, band_px, b.noise_px)
    return _cost(error_px, b.noise_px) + _prior_cost(anywhere, T)


def odd_focals(views: List[FeatureView], options: RefineOptions) -> OddFocals:
    """Finds the focal lengths of pictures whose focal length differs from what most have in
    common."""
    found = {0: Scale(0.0, 0.0)}
    for k in range(1, len(views)):
        prior = prior_to_reference(views, k, options.prior)
        scale = relative_scale(views[0], views[k], prior, options.least_inliers)
        if scale is not None:
            found[k] = scale
    common = float(np.median([s.log for s in found.values()])) if len(found) > 2 else 0.0
    off = {k: s.log - common for k, s in found.items()}
    odd = {
        k: float(np.exp(v)) for k, v in off.items() if abs(v) > max(_LEAST, 5.0 * found[k].sigma)
    }
    return OddFocals(odd, 2 * len(odd) < len(found))


def _finished(prior, rays_a, rays_b, focal_px, noise_px, T_a_b, log, cost):
    """Scale and pose by Gauss-Newton from the best that was tried: log, its sigma, share that
    agrees, cost."""
    best = (log, 1.0, 0.0, cost)
    for _ in range(8):
        rays = _scaled(rays_b, np.exp(-log))
        error, J = epipolar_error(T_a_b, rays_a, rays)
        there = epipolar_error(T_a_b, rays_a, _scaled(rays_b, np.exp(-log - 1e-4)))[0]
        f = focal_px * np.exp(log)
        to_log = (there - error) / 1e-4 + error
        error, J = error * f, np.column_stack([J, to_log]) * f
        width_px = 3.0 * noise_px
        weight = (width_px**2 / (width_px**2 + error**2)) ** 2 / noise_px**2
        information = np.append(prior.information, 1e-6)
        H = (J * weight[:, None]).T @ J + np.diag(information)
        sigma = _CORRELATION * float(np.sqrt(np.linalg.inv(H)[6, 6]))
        now = _cost(error, noise_px) + _prior_cost(prior, T_a_b)
        best = (log, sigma, float((np.abs(error) < width_px).mean()), now)
        offset = np.append(prior_offset(prior, T_a_b), 0.0)
        step = np.linalg.solve(H, -(J.T @ (weight * error) + information * offset))
        T_a_b, log = moved(T_a_b, step[:6]), log + float(step[6])
    return best


def _cost(error_px: np.ndarray, noise_px: float) -> float:
    """Twice the robust cost (Geman-McClure): wrong matches cost as much as each other."""
    square = np.square(error_px / noise_px)
    return float((9.0 * square / (9.0 + square)).sum())


def _prior_cost(prior: PairPrior, T_a_b: np.ndarray) -> float:
    return float(prior.information @ np.square(prior_offset(prior, T_a_b)))


def _scaled(rays: np.ndarray, scale: float) -> np.ndarray:
    return rays * [scale, scale, 1.0]
