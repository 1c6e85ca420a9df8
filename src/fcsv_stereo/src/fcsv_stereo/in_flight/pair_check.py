# SPDX-License-Identifier: Apache-2.0
"""Do two vehicles' pictures of one scene agree with where both trackers say that the vehicles are?

A tracker that drifts slowly takes its vehicle along, and nothing on board may tell. Points that two
pictures both show tell where one camera is from the other, but for how far (Hartley and Zisserman
2004, 9.6): a vehicle that has drifted across the way to the other is found, one that has drifted
along it is not.
"""

from dataclasses import dataclass
from itertools import product
from typing import Dict, Iterator, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_stereo.model import LivePicture, Picture
from fcsv_stereo.refinement.features import KnownFeatures
from fcsv_stereo.refinement.geometry import PairPrior, fit_pair, inverse_depth, prior_offset
from fcsv_stereo.refinement.matching import match_anywhere

FEATURES = 600  # of a picture
_BAND_RAD = 0.05  # from an epipolar line, within which a match may pull at first
_OUT = 3.0  # standard deviations; what is further off counts as if it were so far
# so many matches tell as much as one whose error is its own (refinement.consensus)
_CORRELATION = 2.5
_WELL = 0.75  # share of the matches; where so many agree no other place is looked for far away


def _ways() -> np.ndarray:
    """(26, 3) unit vectors, all around."""
    ways = np.array([w for w in product((-1.0, 0.0, 1.0), repeat=3) if any(w)])
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)


_WAYS = _ways()


@dataclass(frozen=True)
class PairRules:
    """``rotation_rad`` and ``position_m``: standard deviations of what trackers and calibration
    tell of two cameras' rotation and place to each other, of each axis, where nobody drifts. Off is
    a pair of whose matches at least ``matches``, and at least ``share`` of all, fit a place that is
    ``off_m`` and more away, if the trackers' place is less likely by ``surprise`` (difference of
    chi squares)."""

    rotation_rad: float = float(np.radians(0.3))
    position_m: float = 0.25
    matches: int = 40
    share: float = 0.5
    off_m: float = 0.7
    surprise: float = 12.0

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class PairLook:
    """What two pictures say: ``agree`` of their ``matches`` fit a place of the second camera that
    is ``off_m`` from where the trackers say; that is ``surprise`` (difference of chi squares)
    likelier. ``off``: beyond doubt."""

    matches: int
    agree: int
    off_m: float
    surprise: float
    off: bool


@dataclass(frozen=True)
class _Fit:
    T_a_b: np.ndarray
    chi2: float
    strain: float  # what the prior has in it
    agree: int
    off_m: float


_DEFAULT = PairRules()


def look(a: Picture, b: Picture, known: KnownFeatures, rules: PairRules = _DEFAULT) -> PairLook:
    """Two undistorted pictures with the poses that trackers tell; ``known``: of pictures that come
    again, as the reference's does for each other vehicle."""
    one, other = known.prepare(a, FEATURES), known.prepare(b, FEATURES)
    matches = match_anywhere(one, other)
    T_a_b = transforms.invert(a.T_home_cam) @ b.T_home_cam
    rays = one.rays[matches.a], other.rays[matches.b]
    return compare(T_a_b, *rays, other.camera.fx, other.noise_px, rules)


def compare(
    T_a_b: np.ndarray,
    rays_a: np.ndarray,
    rays_b: np.ndarray,
    focal_px: float,
    noise_px: float,
    rules: PairRules = _DEFAULT,
) -> PairLook:
    """Matched rays (N, 3) with z = 1, each in its own optical frame, against T_a_b by the trackers;
    ``noise_px``: standard deviation of a ray's place."""
    if len(rays_a) < rules.matches:
        return PairLook(len(rays_a), 0, 0.0, 0.0, False)
    near = PairPrior(T_a_b, rules.rotation_rad, rules.position_m)
    free = PairPrior(
        T_a_b, rules.rotation_rad, max(4.0 * rules.off_m, float(np.linalg.norm(T_a_b[:3, 3])))
    )
    measured = rays_a, rays_b, focal_px, noise_px
    told = _fit(near, T_a_b, *measured)
    if told.agree >= _WELL * len(rays_a) and told.strain < 0.5 * rules.surprise:
        return PairLook(len(rays_a), told.agree, told.off_m, 0.0, False)
    best = min(
        (_fit(free, start, *measured) for start in (T_a_b, told.T_a_b)), key=lambda f: f.chi2
    )
    if best.agree < _WELL * len(rays_a):
        best = min(
            [best, *(_fit(free, start, *measured) for start in _elsewhere(T_a_b))],
            key=lambda f: f.chi2,
        )
    surprise = told.chi2 - best.chi2
    seen = best.agree >= max(rules.matches, rules.share * len(rays_a))
    off = seen and best.off_m >= rules.off_m and surprise >= rules.surprise
    return PairLook(len(rays_a), best.agree, best.off_m, surprise, bool(off))


def _elsewhere(T_a_b: np.ndarray) -> Iterator[np.ndarray]:
    """Poses as far from a as b is, all around it."""
    far_m = float(np.linalg.norm(T_a_b[:3, 3]))
    return (transforms.transform(T_a_b[:3, :3], far_m * way) for way in _WAYS)


def _fit(
    prior: PairPrior,
    start: np.ndarray,
    rays_a: np.ndarray,
    rays_b: np.ndarray,
    focal_px: float,
    noise_px: float,
) -> _Fit:
    shared = PairPrior(
        prior.T_a_b, *(s / np.sqrt(_CORRELATION) for s in (prior.rotation_rad, prior.position_m))
    )
    T_a_b, error_px = fit_pair(
        shared, rays_a, rays_b, focal_px, _BAND_RAD * focal_px, noise_px, start
    )
    rho, parallax = inverse_depth(T_a_b, rays_a, rays_b)
    # a rotation that is known so well may put what is far away behind both cameras
    behind = rho * parallax * focal_px < -_OUT * (noise_px + prior.rotation_rad * focal_px)
    off = np.where(behind, _OUT, np.minimum(np.abs(error_px) / noise_px, _OUT))
    offset = prior_offset(prior, T_a_b)
    strain = float(prior.information @ offset**2)
    chi2 = float((off**2).sum()) / _CORRELATION + strain
    return _Fit(T_a_b, chi2, strain, int((off < _OUT).sum()), float(np.linalg.norm(offset[3:])))


class PairsToLookAt:
    """Newest pictures of each vehicle, the reference first: the reference's and another's, of about
    the same time, at most once in ``every_s`` for each other vehicle. Vehicles hold: what a picture
    is older its pose is, too."""

    def __init__(self, vehicles: Sequence[str], every_s: float = 1.0, apart_s: float = 0.5):
        self._reference, *self._others = vehicles
        self._every_s, self._apart_s = every_s, apart_s
        self._newest: Dict[str, LivePicture] = {}
        self._looked_s: Dict[str, float] = {}  # stamp of the other's picture

    def add(self, picture: LivePicture) -> None:
        """A picture came."""
        self._newest[picture.vehicle] = picture

    def next_pair(self) -> Optional[Tuple[LivePicture, LivePicture]]:
        """The pair that is to be looked at now, whose other vehicle waited longest; None: there is
        none."""
        a = self._newest.get(self._reference)
        due = (
            []
            if a is None
            else [p for v, p in self._newest.items() if v in self._others and self._due(a, p)]
        )
        if not due:
            return None
        b = min(due, key=lambda p: self._looked_s.get(p.vehicle, float("-inf")))
        self._looked_s[b.vehicle] = b.stamp_s
        return a, b

    def _due(self, a: LivePicture, b: LivePicture) -> bool:
        since_s = b.stamp_s - self._looked_s.get(b.vehicle, float("-inf"))
        return abs(a.stamp_s - b.stamp_s) <= self._apart_s and not 0.0 <= since_s < self._every_s
