# SPDX-License-Identifier: Apache-2.0
"""A link: what two views say about their relative pose, or why they say nothing that can be
trusted."""

from dataclasses import dataclass, field, replace
from typing import Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.geometry import PairPrior, fit_pair, inverse_depth
from fcsv_stereo.refinement.matching import (
    Matches,
    band_px,
    match_anywhere,
    match_in_band,
    rotation_anywhere,
)

_LEAST_SHARE = 0.35  # of the matches must agree: wrong ones agree with any pose by chance
_LEAST_OVER_CHANCE = 2.5  # times as many as would by chance
_LEAST_CELLS = 6  # of a grid of 8 by 6 must hold inliers: one object is not the scene
# nine tenths of the features with less: the same place again, whatever the prior says
_LEAST_PARALLAX_PX = 1.0
SURPRISE = 3.5  # a correction of so many standard deviations puts the prior in doubt
_MORE_WITHOUT_PRIOR = 2  # times as many inliers are asked of a pose that its prior speaks against
_WIDE_RAD = float(np.radians(1.0))  # standard deviation of a rotation found without the prior
# more than this and the prior's position cannot be right either
_FARTHEST_WRONG_RAD = float(np.radians(25.0))


@dataclass(frozen=True)
class PairLink:
    """Views ``a`` and ``b`` by number, the pose that their features agree on, and the features that
    do.

    ``prior`` is the one in force: looser than the session's where the pictures show that it is
    wrong. ``seed_uv`` (N, 2) px in a with inverse depths ``seed_rho`` (N,) 1/m. ``reason`` is empty
    where it can be trusted.
    """

    a: int
    b: int
    prior: PairPrior
    T_a_b: np.ndarray
    reason: str = ""
    loosened: bool = False
    same_place: bool = False  # their features agree, and do not move
    seed_uv: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    seed_rho: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class _LinkFit:
    prior: PairPrior
    T_a_b: np.ndarray
    matches: Matches
    inlier: np.ndarray
    reason: str

    @property
    def turned(self) -> float:
        """Largest correction of the rotation about an axis, in standard deviations of the prior."""
        return float(
            np.abs(_rotation(self.prior.T_a_b, self.T_a_b)).max() / self.prior.rotation_rad
        )

    @property
    def displaced(self) -> float:
        """Largest correction of the position along an axis, in standard deviations of the prior."""
        return float(
            np.abs(self.T_a_b[:3, 3] - self.prior.T_a_b[:3, 3]).max() / self.prior.position_m
        )

    @property
    def surprise(self) -> float:
        """The larger of both."""
        return max(self.turned, self.displaced)


def link(
    numbers: Tuple[int, int],
    a: FeatureView,
    b: FeatureView,
    prior: PairPrior,
    least: int,
    unit_m: float = 1.0,
) -> PairLink:
    """The pose within the prior's band; where that fails, one found without the prior, if it is
    beyond doubt.

    Positions are in units of ``unit_m``."""
    baseline_m = float(np.linalg.norm(prior.T_a_b[:3, 3]))
    if baseline_m < 3.0 * prior.position_m:
        reason = (
            f"its baseline of {_words_m(baseline_m * unit_m)} is not three times as long as its prior is unsure "
            f"({prior.position_m * unit_m:.2g} m): say so where it is better known (--prior-position-m, priors.csv)"
        )
        return PairLink(*numbers, prior, prior.T_a_b, reason)
    for view in (a, b):
        if len(view.uv) < least:
            return PairLink(
                *numbers, prior, prior.T_a_b, f"{view.picture.name} has too little texture"
            )
    fit = _fit(a, b, prior, least)
    if fit.reason:
        wide = _search(a, b, prior, least)
        if wide is None or wide.reason or wide.displaced > SURPRISE:
            return PairLink(*numbers, prior, prior.T_a_b, fit.reason)
        fit = wide
    elif fit.surprise > SURPRISE:
        fit = _reconsidered(a, b, fit, prior, least)
    if fit.reason:
        return PairLink(*numbers, prior, prior.T_a_b, fit.reason)
    i, j = fit.matches.a[fit.inlier], fit.matches.b[fit.inlier]
    rho, parallax = inverse_depth(fit.T_a_b, a.rays[i], b.rays[j])
    if np.percentile(np.abs(rho) * parallax * b.camera.fx, 90) < _LEAST_PARALLAX_PX:
        reason = f"it shows no parallax against {a.picture.name}: the same picture or place again, or only sky"
        return PairLink(*numbers, prior, prior.T_a_b, reason, same_place=True)
    return PairLink(
        *numbers, fit.prior, fit.T_a_b, "", fit.prior is not prior, seed_uv=a.uv[i], seed_rho=rho
    )


def _fit(a: FeatureView, b: FeatureView, prior: PairPrior, least: int) -> _LinkFit:
    near_m = 1.5 * float(np.linalg.norm(prior.T_a_b[:3, 3]))
    half_width_px = band_px(prior, b.camera.fx, near_m)
    return _fit_matches(
        a, b, match_in_band(a, b, prior, half_width_px), prior, half_width_px, least
    )


def _fit_matches(
    a: FeatureView,
    b: FeatureView,
    matches: Matches,
    prior: PairPrior,
    half_width_px: float,
    least: int,
) -> _LinkFit:
    if len(matches) < least:
        return _LinkFit(
            prior,
            prior.T_a_b,
            matches,
            np.zeros(len(matches), bool),
            f"only {len(matches)} features match",
        )
    rays_a, rays_b = a.rays[matches.a], b.rays[matches.b]
    T_a_b, error_px = fit_pair(prior, rays_a, rays_b, b.camera.fx, half_width_px, b.noise_px)
    rho, parallax = inverse_depth(T_a_b, rays_a, rays_b)
    in_front = rho * parallax * b.camera.fx > -3.0 * b.noise_px
    inlier = (np.abs(error_px) < 3.0 * b.noise_px) & in_front
    return _LinkFit(
        prior,
        T_a_b,
        matches,
        inlier,
        _doubt(a, matches, inlier, 3.0 * b.noise_px / half_width_px, least),
    )


def _doubt(a: FeatureView, matches: Matches, inlier: np.ndarray, chance: float, least: int) -> str:
    count = int(inlier.sum())
    if count < least:
        return f"only {count} of {len(matches)} matched features agree with one pose"
    if inlier.mean() < max(_LEAST_SHARE, min(_LEAST_OVER_CHANCE * chance, 0.8)):
        return f"matched features do not agree: {inlier.mean():.0%} fit one pose"
    uv = a.uv[matches.a[inlier]]
    cells = set(
        zip((uv[:, 0] * 8 // a.camera.width).tolist(), (uv[:, 1] * 6 // a.camera.height).tolist())
    )
    if len(cells) < _LEAST_CELLS:
        return "the features that agree lie in one small part of the picture"
    return ""


def _search(a: FeatureView, b: FeatureView, prior: PairPrior, least: int):
    """A fit about a rotation from matches without the prior, or None."""
    R_a_b = rotation_anywhere(a, b, match_anywhere(a, b), b.camera.fx)
    if R_a_b is None:
        return None
    T_a_b = prior.T_a_b.copy()
    T_a_b[:3, :3] = R_a_b
    if np.linalg.norm(_rotation(prior.T_a_b, T_a_b)) > _FARTHEST_WRONG_RAD:
        return None
    wide = PairPrior(T_a_b, max(_WIDE_RAD, prior.rotation_rad), prior.position_m)
    return _fit(a, b, wide, _MORE_WITHOUT_PRIOR * least)


def _reconsidered(
    a: FeatureView, b: FeatureView, fit: _LinkFit, prior: PairPrior, least: int
) -> _LinkFit:
    """A surprising pose, unless what disagrees with it agrees with the prior: then the greater part
    has moved."""
    rest = Matches(fit.matches.a[~fit.inlier], fit.matches.b[~fit.inlier])
    half_width_px = band_px(prior, b.camera.fx, 1.5 * float(np.linalg.norm(prior.T_a_b[:3, 3])))
    second = _fit_matches(a, b, rest, prior, half_width_px, least)
    if not second.reason and second.surprise < SURPRISE:
        return second
    if fit.turned <= SURPRISE:
        return fit
    size_rad = float(np.linalg.norm(_rotation(prior.T_a_b, fit.T_a_b)))
    wide = PairPrior(
        fit.T_a_b, max(_WIDE_RAD, prior.rotation_rad, size_rad / 3.0), prior.position_m
    )
    loose = _fit(a, b, wide, _MORE_WITHOUT_PRIOR * least)
    return loose if not loose.reason else replace(fit, reason=loose.reason)


def _rotation(T_a_b: np.ndarray, T_a_c: np.ndarray) -> np.ndarray:
    return Rotation.from_matrix(T_a_b[:3, :3].T @ T_a_c[:3, :3]).as_rotvec()


def _words_m(length_m: float) -> str:
    """
    >>> _words_m(0.0), _words_m(12.345), _words_m(0.00123)
    ('0.00 m', '12.35 m', '0.0012 m')
    """
    return f"{length_m:.2f} m" if length_m == 0.0 or length_m >= 0.1 else f"{length_m:.2g} m"
