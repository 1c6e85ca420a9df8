# SPDX-License-Identifier: Apache-2.0
"""Joint matching: depth in the reference picture from all other pictures at once."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_stereo.errors import InputError, MatchingError
from fcsv_stereo.joint.checks.evidence import chance_of_wrong, doubt, features, standing_out
from fcsv_stereo.joint.checks.kinds import infinite, kinds
from fcsv_stereo.joint.checks.reliability import confirmed, is_certain, relied_on, trusted
from fcsv_stereo.joint.checks.sigma import geometry_sigmas, matching_sigma
from fcsv_stereo.joint.checks.sky import in_the_skyline, moved_clouds, sky
from fcsv_stereo.joint.pictures import MatchPictures, usable
from fcsv_stereo.joint.refine.exposure import same_exposure
from fcsv_stereo.joint.refine.pose_alignment import adjust
from fcsv_stereo.joint.refine.residuals import detail, residuals, support_bits, without_mean
from fcsv_stereo.joint.refine.subpixel import Fine, refine
from fcsv_stereo.joint.surfaces.colour import settled
from fcsv_stereo.joint.surfaces.select import Map, choose_surfaces, stretched
from fcsv_stereo.joint.tuning import (
    EVIDENCE,
    FAR_REMATCH,
    LEAST_LEVELS,
    MATCH,
    REFERENCE_SIZE_PX,
    RESIDUALS,
    SHARED,
)
from fcsv_stereo.joint.views import Views, colours, seen_by_any
from fcsv_stereo.joint.volume.far_rematch import sharpened
from fcsv_stereo.joint.volume.pair_costs import must_compile
from fcsv_stereo.joint.volume.winner import (
    VolumeMatch,
    highest_level,
    match_volume,
    nearest_inverse_depth,
)
from fcsv_stereo.model import Picture, PoseUncertainty, Progress, silent
from fcsv_stereo.model.kinds import DepthKind, supported

# a level of the far rematch, in levels of the volume: what that match leaves uncertain
_FINER = FAR_REMATCH.step_px * MATCH.largest_volume
_COMPILES = ": compiled for this machine, once, a minute or two"


@dataclass(frozen=True)
class MatchOptions:
    """Choices of joint matching."""

    volume_pixels: int = 115000  # size of the picture that the whole cost volume is built for
    most_levels: int = 768  # of inverse depth
    iterations: int = 2  # of the sub-pixel step at full size
    most_relative_sigma: float = 0.4  # a depth less certain than this is none (the sky is one such)
    threads: int = 2
    # after the volume's size surfaces are interpolated, not chosen: quicker, edges less sharp
    stretch: bool = False
    adjust_poses: bool = False  # to the pictures, where covariances are given
    # what poses' errors make of a depth speaks against it; else it is in its sigma alone
    poses_withhold: bool = True
    keep_features: bool = False  # what each depth's evidence is judged by (HxWxF): to learn from

    def __post_init__(self):
        if (
            self.volume_pixels < 1000
            or self.most_levels < LEAST_LEVELS
            or self.iterations < 1
            or self.threads < 1
        ):
            raise InputError(
                f"joint matching needs 1000 pixels, {LEAST_LEVELS} levels, 1 iteration and 1 thread at least"
            )
        if not 0.0 < self.most_relative_sigma <= 1.0:
            raise InputError(
                f"largest relative sigma is {self.most_relative_sigma}; it must lie in 0 to 1"
            )


@dataclass(frozen=True)
class JointDepth:
    """Depth and what is known about it, in the reference picture.

    ``depth`` and ``sigma`` are HxW float32 (m along the optical axis, NaN where none). ``support``
    is HxW uint16: bit i is set where pair i of ``used`` agrees. ``used`` are indices into the
    pictures given; ``left_out`` says by index why a picture was not. ``fine`` holds the evidence
    that they were made from, ``pictures`` are those used, with the poses that served. ``kind`` is
    HxW uint8 (``model.kinds``), ``features`` HxWxF where they were kept.
    """

    depth: np.ndarray
    sigma: np.ndarray
    support: np.ndarray
    used: List[int]
    left_out: Dict[int, str] = field(default_factory=dict)
    fine: Optional[Fine] = None
    known: Optional[np.ndarray] = None
    pictures: List[Picture] = field(default_factory=list)
    kind: Optional[np.ndarray] = None
    features: Optional[np.ndarray] = None

    def agrees(self, pair: int) -> np.ndarray:
        """HxW bool: where a pair (of ``used``) agrees."""
        return (self.support >> pair) & 1 > 0

    @property
    def strongest(self) -> np.ndarray:
        """HxW index (uint8) into ``used`` of the pair that tells most about each pixel's depth."""
        r = self.fine.residuals
        rows = zip(r.trust.swapaxes(0, 1), r.speed.swapaxes(0, 1))  # one by one: large pictures
        return np.array(
            [(trust * speed + 1e-6 * speed).argmax(axis=0) for trust, speed in rows], np.uint8
        )


@dataclass(frozen=True)
class Suspicion:
    """That the poses are off, all of them or none: with this ``probability``, by errors of
    ``covariances`` (6x6 each, relative to the reference: rad in camera axes, m in home's)."""

    probability: float
    covariances: Sequence[np.ndarray]

    @classmethod
    def of(cls, poses: Sequence[PoseUncertainty]) -> Optional["Suspicion"]:
        """That of their focal length; None where it is not in doubt."""
        probability = max(p.focal_probability for p in poses)
        return (
            cls(probability, [p.focal / probability for p in poses]) if probability > 0.0 else None
        )


def match_jointly(
    reference: Picture,
    others: Sequence[Picture],
    options: Optional[MatchOptions] = None,
    poses: Optional[Sequence[PoseUncertainty]] = None,
    progress: Progress = silent,
) -> JointDepth:
    """Depth of ``reference`` from all ``others``; ``poses`` says how well each pose is known (None:
    exactly).

    What poses share is in sigma, and has no part in whether there is a depth, nor in what speaks
    for it. A focal length that may be wrong has, and is in sigma. Poses with ``pixel`` errors are
    adjusted as little as these say. Raises MatchingError where no other picture can be used.
    """
    options = options or MatchOptions()
    used, left_out = usable(reference, others)
    if not used:
        raise MatchingError("no picture can be matched: " + "; ".join(left_out.values()))
    known_poses = [poses[i] for i in used] if poses else None
    suspicion = Suspicion.of(poses) if poses else None
    pictures = MatchPictures.of(
        reference, [others[i] for i in used], known_poses, options.adjust_poses
    )
    first, *between = _scales(pictures.shape[0] * pictures.shape[1], options)
    progress(f"matching roughly{_COMPILES if must_compile() else ''}", 0.0)
    with ThreadPoolExecutor(options.threads) as pool:
        pictures, rough = _match_roughly(pictures, first / 2.0, options, pool)
        progress("matching every distance", 0.09)
        pictures, surfaces, levels = _match_in_volume(pictures, rough, first, options, pool)
        known = _enlarged(surfaces.known, reference)
        for number, scale in enumerate(between, 1):
            progress("choosing surfaces", 0.48)
            # the last is half the full size at least: precise enough to choose among surfaces by
            iterations = int(number < len(between))
            surfaces = _surfaces_between(
                pictures, surfaces, levels, scale, iterations, options, pool
            )
        progress("matching at full size", 0.53)
        pictures, fine = _at_full_size(pictures, surfaces, levels, known, options, pool)
    del surfaces
    geometry, pose_sigma_share, shared = _by_poses(pictures, fine, suspicion, known_poses, used)
    progress("judging each depth", 0.92)
    own_w = matching_sigma(fine, known)
    fine = fine.without_slopes()
    sigma_w = np.hypot(own_w, geometry, out=geometry)
    own_w = sigma_w if options.poses_withhold else own_w
    with ThreadPoolExecutor(options.threads) as pool:
        kind, columns = _judged(
            pictures, fine, own_w, known, options, pool, suspicion, pose_sigma_share
        )
    depth, sigma, support = _certain_depth(fine, sigma_w, own_w, reference.blank, options)
    if shared is not None:
        sigma = np.hypot(sigma, depth * shared)
    if suspicion:
        sigma = np.hypot(sigma, depth * np.float32(suspicion.probability**0.5) * pose_sigma_share)
    if reference.blank is not None:
        kind[reference.blank] = DepthKind.NOTHING
    return JointDepth(
        depth, sigma, support, used, left_out, fine, known, pictures.others, kind, columns
    )


def _by_poses(
    pictures: MatchPictures,
    fine: Fine,
    suspicion: Optional[Suspicion],
    poses: Optional[Sequence[PoseUncertainty]],
    used: Sequence[int],
) -> Tuple[np.ndarray, Optional[np.ndarray], Optional[np.ndarray]]:
    """HxW float32 each, what errors of the poses make: of inverse depth (1/m) by their covariances;
    of the depth, as a share of it, by those suspected and those that all share, None where there
    are none."""
    sets = [pictures.covariances]
    sets += [[suspicion.covariances[i] for i in used]] if suspicion else []
    sets += [[p.shared for p in poses]] if poses else []
    geometry, *shares = geometry_sigmas(pictures.reference, pictures.others, sets, fine)
    for sigma_w in shares:
        sigma_w /= np.maximum(fine.w, np.float32(1e-9))
    focal = shares.pop(0) if suspicion else None
    return geometry, focal, shares.pop() if poses else None


def _judged(
    pictures: MatchPictures,
    fine: Fine,
    sigma_w: np.ndarray,
    known: np.ndarray,
    options: MatchOptions,
    pool: ThreadPoolExecutor,
    suspicion: Optional[Suspicion] = None,
    pose_sigma_share: Optional[np.ndarray] = None,
) -> Tuple[np.ndarray, Optional[np.ndarray]]:
    """What kind each pixel is of (HxW uint8), and where they are kept the features (HxWxF) that
    tell it. ``pose_sigma_share`` (HxW) is what the suspected poses make of the depth, as a share of
    it."""
    full = fine.w.shape
    small = pictures.views(
        min(1.0, max(EVIDENCE.scale, EVIDENCE.scale * REFERENCE_SIZE_PX[0] / full[1]))
    )
    w = cv2.resize(fine.w, small.shape[::-1], interpolation=cv2.INTER_NEAREST)
    here = residuals(small, w, pool)
    colour, seeing = colours(pictures.reference, small.shape), (here.seen > 0).sum(axis=0)
    is_sky = infinite(w, here, colour, ~seen_by_any(small, 0.0), full)
    out = standing_out(small, w, here, full, pool)
    del small, w, here  # large pictures
    grey = pictures.grey(0)
    bright = grey > np.median(grey)
    contrast = without_mean(grey)
    del grey
    contrast = cv2.blur(np.abs(contrast, out=contrast), (SHARED.window_px,) * 2)
    columns = features(fine, sigma_w, known, out, contrast)
    kept = np.stack(list(columns), axis=-1) if options.keep_features else None
    doubts = doubt(columns if kept is None else np.moveaxis(kept, -1, 0))
    if suspicion:
        doubts += (
            (1.0 - doubts) * np.float32(suspicion.probability) * chance_of_wrong(pose_sigma_share)
        )
    kind = kinds(doubts, out, fine.residuals, contrast, is_sky, bright)
    kind[moved_clouds(kind, seeing, colour)] = DepthKind.SKY
    moves_px = fine.w * fine.residuals.speed.max(axis=0)
    kind[
        in_the_skyline(kind == DepthKind.SKY, supported(kind), moves_px, pictures.reference.image)
    ] = DepthKind.SKY
    return kind, kept


@dataclass(frozen=True)
class _Rough:
    """The first match, at half the volume's size, in the pictures ``found``: it bounds the volume's
    depths."""

    match: VolumeMatch
    found: Views


def _scales(pixels: int, options: MatchOptions) -> List[float]:
    """Gives the scales of the volume and of those between it and the full size, in even steps, each
    at most twice the one before."""
    first = min(MATCH.largest_volume, float(np.sqrt(options.volume_pixels / pixels)))
    steps = max(1 if options.stretch else MATCH.least_choices, int(np.ceil(-np.log2(first))))
    return [first ** (1.0 - k / steps) for k in range(steps)]


def _match_roughly(
    pictures: MatchPictures, scale: float, options: MatchOptions, pool: ThreadPoolExecutor
) -> Tuple[MatchPictures, _Rough]:
    """Every depth at every pixel of small pictures; poses adjusted by it."""
    found = pictures.views(scale)
    everywhere = np.full(found.shape[0], np.inf)
    match = match_volume(found, everywhere, np.inf, options.most_levels, pool, MATCH.rough_step_px)
    if pictures.prior:
        known = trusted(match, found, residuals(found, match.w, pool))
        pictures, _ = _with_adjusted_poses(pictures, detail(found), match.w, known, pool)
    return pictures, _Rough(match, found)


def _match_in_volume(
    pictures: MatchPictures,
    rough: _Rough,
    scale: float,
    options: MatchOptions,
    pool: ThreadPoolExecutor,
) -> Tuple[MatchPictures, Map, np.ndarray]:
    """The cost volume's map and its levels (1/m); exposures and poses adjusted by it; the sky at
    infinity."""
    found = pictures.views(scale)
    nearest = nearest_inverse_depth(rough.match, rough.found.reference, found.shape[0])
    match = match_volume(
        found, nearest, highest_level(rough.match, rough.found), options.most_levels, pool
    )
    w, r = match.w, residuals(found, match.w, pool)
    known = trusted(match, found, r)
    pictures = replace(pictures, exposures=same_exposure(found, w, r, pool))
    if pictures.prior:
        pictures, w = _with_adjusted_poses(pictures, detail(pictures.views(scale)), w, known, pool)
        found = found.with_poses(pictures.reference, pictures.others)
    infinite = sky(w, r, colours(pictures.reference, found.shape), ~seen_by_any(found, 0.0))
    w = np.where(infinite, np.float32(0.0), w)
    return pictures, Map(found, w, known, known, confirmed(known, r)), match.levels


def _surfaces_between(
    pictures: MatchPictures,
    coarser: Map,
    levels: np.ndarray,
    scale: float,
    iterations: int,
    options: MatchOptions,
    pool: ThreadPoolExecutor,
) -> Map:
    """Surfaces chosen at a size between, with ``iterations`` of the sub-pixel step, and what of them
    the pictures confirm."""
    found = pictures.views(scale)
    w = _finer(pictures, found, coarser, options, pool)
    fine = refine(found, w, _level_sizes(w, levels), iterations, pool)
    return Map(found, fine.w, *relied_on(found, fine.w, fine.residuals))


def _at_full_size(
    pictures: MatchPictures,
    coarser: Map,
    levels: np.ndarray,
    known: np.ndarray,
    options: MatchOptions,
    pool: ThreadPoolExecutor,
) -> Tuple[MatchPictures, Fine]:
    """Surfaces chosen, what is far matched again, poses adjusted, and inverse depth between the
    levels."""
    found = pictures.views(1.0)
    w, rematched = _finer(pictures, found, coarser, options, pool), np.False_
    if not options.stretch:
        w, rematched = sharpened(found, w, options.volume_pixels * options.most_levels, pool)
    if pictures.prior:
        certain = known & is_certain(found, w, residuals(found, w, pool))
        pictures, w = _with_adjusted_poses(pictures, detail(found), w, certain, pool)
        found = found.with_poses(pictures.reference, pictures.others)
    step = _level_sizes(w, levels) * np.where(rematched, np.float32(_FINER), 1.0)
    return pictures, refine(found, w, step, options.iterations, pool)


def _with_adjusted_poses(
    pictures: MatchPictures,
    details: Views,
    w: np.ndarray,
    known: np.ndarray,
    pool: ThreadPoolExecutor,
) -> Tuple[MatchPictures, np.ndarray]:
    """Poses that fit the pictures where ``w`` is ``known`` (HxW), and inverse depth (1/m) with
    them."""
    others, covariances, w = adjust(
        pictures.reference,
        pictures.others,
        pictures.prior,
        details,
        w,
        known,
        MATCH.pose_steps,
        pool,
        pictures.pixel_errors,
    )
    return pictures.posed(others, covariances), w


def _finer(
    pictures: MatchPictures,
    found: Views,
    coarser: Map,
    options: MatchOptions,
    pool: ThreadPoolExecutor,
) -> np.ndarray:
    """Inverse depth (HxW, 1/m) in the finer pictures ``found``: surfaces chosen, or interpolated
    and settled."""
    image = colours(pictures.reference, found.shape, np.int16)  # half the memory
    if not options.stretch:
        return choose_surfaces(found, coarser, image, pool)
    w = stretched(coarser.w, found.shape)
    full = found.shape == pictures.shape
    # at a large full size it costs more than it mends
    settles = not full or w.size <= options.volume_pixels
    return settled(image, w, pool) if settles else w


def _level_sizes(w: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """HxW float32, 1/m: what the volume's ``levels`` leave uncertain at ``w``."""
    return np.interp(w, levels[:-1], np.diff(levels)).astype(np.float32)


def _enlarged(mask: np.ndarray, reference: Picture) -> np.ndarray:
    """A mask at the reference picture's full size."""
    size = reference.image.shape[1::-1]
    return cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0


def _certain_depth(
    fine: Fine,
    sigma_w: np.ndarray,
    own_w: np.ndarray,
    blank: Optional[np.ndarray],
    options: MatchOptions,
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth and sigma (HxW float32, m) and support, where depth is certain enough by the pixel's
    ``own_w`` (HxW, 1/m) and the camera saw something; sigma of 1/w to first order."""
    w = np.maximum(fine.w, 1e-9)
    relative = sigma_w / w
    none = ~(own_w / w < options.most_relative_sigma)
    if blank is not None:
        none |= blank
    depth, sigma = 1.0 / w, relative / w
    depth[none], sigma[none] = np.nan, np.nan
    support = support_bits(fine.residuals, RESIDUALS.least_trust)
    support[none] = 0
    return depth.astype(np.float32), sigma.astype(np.float32), support
