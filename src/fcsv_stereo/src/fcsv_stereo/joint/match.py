# SPDX-License-Identifier: Apache-2.0
"""Joint matching: depth in the reference picture from all other pictures at once."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Sequence

import cv2
import numpy as np

from fcsv_stereo.errors import InputError, MatchingError
from fcsv_stereo.joint.checks.reliability import confirmed, consistent, relied_on, trusted
from fcsv_stereo.joint.checks.sigma import LEAST_TRUST, geometry_sigma, matching_sigma
from fcsv_stereo.joint.checks.sky import sky
from fcsv_stereo.joint.refine.pose_alignment import adjust
from fcsv_stereo.joint.refine.residuals import Residuals, detail, residuals, support_bits
from fcsv_stereo.joint.refine.subpixel import Fine, refine
from fcsv_stereo.joint.surfaces.colour import settled
from fcsv_stereo.joint.surfaces.select import Map, choose_surfaces, stretched
from fcsv_stereo.joint.views import Views, grey, inverse_depths, seen_by_any, views
from fcsv_stereo.joint.volume.far_rematch import FINER, sharpened
from fcsv_stereo.joint.volume.winner import Coarse, coarse, highest_level, nearest_inverse_depth
from fcsv_stereo.model import Picture

_LEAST_BASELINE_M = 1e-6
_LEAST_PIXELS = 16
_ADJUSTMENTS = 4
_SETTLED_PIXELS = 100000
_LARGEST_VOLUME = 0.6  # of the picture's size
_ROUGH_STEP_PX = 1.5


@dataclass(frozen=True)
class MatchOptions:
    """Choices of joint matching."""

    volume_pixels: int = 115000  # size of the picture that the whole cost volume is built for
    most_levels: int = 768  # of inverse depth
    iterations: int = 2  # of the sub-pixel step at full size
    most_relative_sigma: float = 0.4  # a depth less certain than this is none (the sky is one such)
    threads: int = 2
    stretch: bool = False  # after the volume's size surfaces are interpolated, not chosen: quicker, edges less sharp
    adjust_poses: bool = False  # to the pictures, where covariances are given

    def __post_init__(self):
        if self.volume_pixels < 1000 or self.most_levels < 8 or self.iterations < 1 or self.threads < 1:
            raise InputError("joint matching needs 1000 pixels, 8 levels, 1 iteration and 1 thread at least")
        if not 0.0 < self.most_relative_sigma <= 1.0:
            raise InputError(f"largest relative sigma is {self.most_relative_sigma}; it must lie in 0 to 1")


@dataclass(frozen=True)
class JointDepth:
    """Depth and what is known about it, in the reference picture.

    ``depth`` and ``sigma`` are HxW float32 (m along the optical axis, NaN where none). ``support`` is HxW uint16: bit i
    is set where pair i of ``used`` agrees. ``used`` are indices into the pictures given; ``left_out`` says by index why
    a picture was not. ``fine`` holds the evidence that they were made from, ``pictures`` are those
    used, with the poses that served.
    """

    depth: np.ndarray
    sigma: np.ndarray
    support: np.ndarray
    used: List[int]
    left_out: Dict[int, str] = field(default_factory=dict)
    fine: Optional[Fine] = None
    known: Optional[np.ndarray] = None
    pictures: List[Picture] = field(default_factory=list)

    def agrees(self, pair: int) -> np.ndarray:
        """HxW bool: where a pair (of ``used``) agrees."""
        return (self.support >> pair) & 1 > 0

    @property
    def strongest(self) -> np.ndarray:
        """HxW index into ``used`` of the pair that tells most about each pixel's depth."""
        r = self.fine.residuals
        return (r.trust * r.speed + 1e-6 * r.speed).argmax(axis=0)


def match_jointly(
    reference: Picture,
    others: Sequence[Picture],
    options: Optional[MatchOptions] = None,
    covariances: Optional[Sequence[Optional[np.ndarray]]] = None,
) -> JointDepth:
    """Depth of ``reference`` from all ``others``; poses are taken as they are, with their 6x6 ``covariances``.

    Raises MatchingError where no other picture can be used.
    """
    options = options or MatchOptions()
    used, left_out = usable(reference, others)
    if not used:
        raise MatchingError("no picture can be matched: " + "; ".join(left_out.values()))
    chosen = [others[i] for i in used]
    poses = [covariances[i] for i in used] if covariances else [None] * len(used)
    prior = poses if options.adjust_poses and all(p is not None for p in poses) else None
    greys = [grey(p) for p in (reference, *chosen)]
    scales = _scales(greys[0].size, options.volume_pixels, 1 if options.stretch else 2)
    with ThreadPoolExecutor(options.threads) as pool:
        chosen, poses, levels, coarsest = _coarse(reference, chosen, poses, prior, greys, scales[0], options, pool)
        known = cv2.resize(coarsest.known.astype(np.uint8), greys[0].shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        now = coarsest
        for scale in scales[1:]:
            found = views(reference, chosen, scale, greys)
            w = _finer(found, now, _colour(reference, found.shape), scale, options, pool)
            sharp = np.False_
            if scale == 1.0 and not options.stretch:
                w, sharp = sharpened(found, w, options.volume_pixels * options.most_levels, pool)
            if scale == 1.0 and prior:
                details = detail(found)
                certain = known & relied_on(found, w, residuals(details, w, pool))[1]
                chosen, poses, w = adjust(reference, chosen, prior, details, w, certain, _ADJUSTMENTS, pool)
                found = views(reference, chosen, scale, greys)
            step = np.interp(w, levels[:-1], np.diff(levels)).astype(np.float32) * np.where(sharp, FINER, 1.0)
            fine = refine(detail(found), w, step, _iterations(scale, options), pool)
            if scale < 1.0:
                now = Map(found, fine.w, *relied_on(found, fine.w, fine.residuals))
    geometry = geometry_sigma(reference, chosen, poses, fine)
    sigma_w = np.hypot(matching_sigma(fine, known), geometry)
    return _answer(fine, known, sigma_w, reference.blank, used, left_out, chosen, options)


def usable(reference: Picture, others: Sequence[Picture]):
    """Indices of the pictures that see something of the reference's from another place, and why others do not."""
    used, left_out = [], {}
    for i, other in enumerate(others):
        baseline_m = float(np.linalg.norm(other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]))
        if min(*reference.image.shape[:2], *other.image.shape[:2]) < _LEAST_PIXELS:
            left_out[i] = f"{other.name} or {reference.name} is smaller than {_LEAST_PIXELS} px: nothing to match"
        elif baseline_m < _LEAST_BASELINE_M:
            left_out[i] = f"{other.name} and {reference.name} were taken from one place: no baseline"
        elif len(inverse_depths(views(reference, [other], 0.25, [grey(reference), grey(other)]), 1.0, 64)) < 3:
            left_out[i] = f"{other.name} does not overlap {reference.name}"
        else:
            used.append(i)
    return used, left_out


def _scales(pixels: int, volume_pixels: int, least_steps: int) -> List[float]:
    """From the volume's size to the full one in even steps, each at most twice the one before."""
    first = min(_LARGEST_VOLUME, float(np.sqrt(volume_pixels / pixels)))
    steps = max(least_steps, int(np.ceil(-np.log2(first))))
    return [first ** (1.0 - k / steps) for k in range(steps)] + [1.0]


def _finer(found: Views, coarser: Map, image: np.ndarray, scale: float, options: MatchOptions, pool) -> np.ndarray:
    """Inverse depth (1/m) in the finer pictures ``found``, whose reference in colour is ``image``."""
    if not options.stretch:
        return choose_surfaces(found, coarser, image, pool)
    w = stretched(coarser.w, found.shape)
    settles = scale < 1.0 or w.size <= _SETTLED_PIXELS  # at a large full size it costs more than it mends
    return settled(image, w, pool) if settles else w


def _iterations(scale: float, options: MatchOptions) -> int:
    """Of the sub-pixel step; half the size is precise enough to choose among surfaces by."""
    return options.iterations if scale == 1.0 else int(scale < 0.5)


def _coarse(reference: Picture, chosen, poses, prior, greys, scale: float, options: MatchOptions, pool):
    """The map at a reduced size and its levels of inverse depth; poses adjusted on the way where there is a prior."""
    small = views(reference, chosen, scale / 2.0, greys)
    rough = coarse(small, np.full(small.shape[0], np.inf), np.inf, options.most_levels, pool, _ROUGH_STEP_PX)
    if prior:
        known, r = _trusted(rough, small, pool)
        chosen, poses, _ = adjust(reference, chosen, prior, detail(small), rough.w, known, _ADJUSTMENTS, pool)
    found = views(reference, chosen, scale, greys)
    nearest = nearest_inverse_depth(rough, small.reference, found.shape[0])
    result: Coarse = coarse(found, nearest, highest_level(rough, small), options.most_levels, pool)
    known, r = _trusted(result, found, pool)
    _equalise(greys, r, found, result.w, pool)
    if prior:
        found = views(reference, chosen, scale, greys)
        chosen, poses, w = adjust(reference, chosen, prior, detail(found), result.w, known, _ADJUSTMENTS, pool)
        found = views(reference, chosen, scale, greys)
        result = replace(result, w=w)
    infinite = sky(result.w, r, _colour(reference, found.shape), ~seen_by_any(found, 0.0))
    w = np.where(infinite, np.float32(0.0), result.w)
    return chosen, poses, result.levels, Map(found, w, known, known, confirmed(known, r))


def _colour(picture: Picture, shape) -> np.ndarray:
    """HxWx3 float32 at a reduced size."""
    image = picture.image if picture.image.ndim == 3 else np.repeat(picture.image[..., None], 3, axis=2)
    return cv2.resize(image, shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)


def _trusted(result: Coarse, found: Views, pool):
    """HxW bool, and the residuals that it is from."""
    r = residuals(detail(found), result.w, pool)
    return trusted(result, consistent(found, result.w, r)), r


def _equalise(greys: List[np.ndarray], r: Residuals, found: Views, w: np.ndarray, pool) -> None:
    """Brings each other picture's exposure to the reference's, by what agrees at ``w``; in place."""
    differences = residuals(found, w, pool).difference
    for i, (t, d) in enumerate(zip(r.trust, differences)):
        good = t > LEAST_TRUST
        if good.sum() < 200:
            continue
        here, there = found.reference[good], (found.reference - d)[good]
        gain = float(np.clip(here.std() / max(there.std(), 1e-3), 0.5, 2.0))
        greys[i + 1] = gain * greys[i + 1] + float(np.median(here - gain * there))


def _answer(
    fine: Fine, known, sigma_w: np.ndarray, blank: Optional[np.ndarray], used, left_out, chosen, options: MatchOptions
) -> JointDepth:  # fmt: skip
    """Depth where it is certain enough and the camera saw something; sigma of 1/w to first order."""
    w = np.maximum(fine.w, 1e-9)
    relative = sigma_w / w
    none = ~(relative < options.most_relative_sigma)
    if blank is not None:
        none |= blank
    depth, sigma = 1.0 / w, relative / w
    depth[none], sigma[none] = np.nan, np.nan
    support = support_bits(fine.residuals, LEAST_TRUST)
    support[none] = 0
    return JointDepth(depth.astype(np.float32), sigma.astype(np.float32), support, used, left_out, fine, known, chosen)
