# SPDX-License-Identifier: Apache-2.0
"""The method ``joint``: refine all poses, match all pictures with the reference at once."""

import time
from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_stereo import instants
from fcsv_stereo.depth import cloud_of
from fcsv_stereo.equations import ErrorThreshold, farthest
from fcsv_stereo.errors import InputError, MatchingError
from fcsv_stereo.joint.bars import with_bars
from fcsv_stereo.joint.checks.axis_conflict import doubt_contradicted
from fcsv_stereo.joint.checks.enough_evidence import require_evidence, why_no_depth
from fcsv_stereo.joint.checks.kinds import supported_only
from fcsv_stereo.joint.checks.moved import leave_out_moved
from fcsv_stereo.joint.match import JointDepth, MatchOptions, match_jointly
from fcsv_stereo.joint.pairs import JointPair, NearestUseful
from fcsv_stereo.joint.tuning import PAIRS
from fcsv_stereo.model import (
    RIG,
    Configuration,
    ConfigurationInput,
    ImageEntry,
    InputKind,
    MapInput,
    MapResult,
    Method,
    Picture,
    PosePrior,
    PoseUncertainty,
    Progress,
    Reference,
    part,
    silent,
)
from fcsv_stereo.pose_covariance import of_scale, prior_covariance
from fcsv_stereo.posed.rig import rig_hint, rig_words
from fcsv_stereo.posed.unit_of_length import in_metres, in_unit, unit_of
from fcsv_stereo.refinement import METRIC, KnownFeatures, RefinedPicture, RefineOptions, refine
from fcsv_stereo.refinement.turning import most_turn_rad

_MONITORED_PIXELS = 640 * 480


@dataclass(frozen=True)
class JointOptions:
    """Choices of the method. An input that says how good its poses are overrules the refinement's
    prior; ``threshold`` is for equation 3.1's farthest depth in the report alone. ``complete``
    keeps depths that no pair's texture supports; ``kind`` tells them. ``bars``: straight thin
    things are matched as wholes besides (docs/lab/tilting.md). ``prior`` is how good the poses of
    photographs are, where the user says so.

    Poses are refined in whole pictures; depth is that of the reference picture at ``scale`` of its
    size, and of at most ``most_pixels``.
    """

    refine_poses: bool = True
    refinement: RefineOptions = field(default_factory=RefineOptions)
    matching: MatchOptions = field(default_factory=MatchOptions)
    threshold: ErrorThreshold = field(default_factory=lambda: ErrorThreshold(0.1, True))
    scale: float = 1.0
    most_pixels: Optional[int] = None
    complete: bool = False
    bars: bool = False
    prior: Optional[PosePrior] = None

    def __post_init__(self):
        if not 0.1 <= self.scale <= 1.0:
            raise InputError(
                f"scale is {self.scale}; it must lie in 0.1 to 1 of the pictures' size"
            )
        if self.most_pixels is not None and self.most_pixels < 1000:
            raise InputError(f"most_pixels is {self.most_pixels}; depth needs 1000 pixels at least")

    def scale_of(self, pixels: int) -> float:
        """Says at which share of its size (0 to 1) a reference picture of so many ``pixels`` is
        matched.

        >>> [JointOptions(most_pixels=307200).scale_of(n) for n in (307200, 4 * 307200)]
        [1.0, 0.5]
        """
        return (
            self.scale
            if self.most_pixels is None
            else min(self.scale, (self.most_pixels / pixels) ** 0.5)
        )


class Joint(Method):
    """All configurations at once, and what the map's pictures say against it."""

    name = "joint"
    options = JointOptions
    refines_poses = True
    matches_bars = True

    def map(
        self, given: MapInput, options: Optional[JointOptions] = None, progress: Progress = silent
    ) -> MapResult:
        """Match jointly; leave out what moved, doubt what an axis denies, refuse a map without
        evidence."""
        options, unit_m = options or JointOptions(), unit_of(given)
        given = in_unit(given, unit_m)
        result = doubt_contradicted(
            given, leave_out_moved(given, _mapped(given, options, progress, unit_m))
        )
        if options.refine_poses:  # else who asks vouches for the poses
            require_evidence(result)
        result = result if options.complete else supported_only(result)
        result = with_bars(result, [p.pictures for p in result.pairs]) if options.bars else result
        return in_metres(result, unit_m)

    @property
    def quick(self) -> JointOptions:
        """Fewer features, a small volume, and surfaces that are interpolated."""
        matching = MatchOptions(volume_pixels=20000, iterations=1, stretch=True)
        return JointOptions(
            refinement=RefineOptions(features=1500, correct_camera=False), matching=matching
        )

    @property
    def monitor(self) -> JointOptions:
        """Gives options as ``quick``, with a volume in which a walker at 20 m is 6 pixels wide (4
        are lost before a car), and large pictures made smaller: what each image costs does not grow
        with the camera's size (docs/lab/at_once.md)."""
        matching = replace(self.quick.matching, volume_pixels=40000)
        return replace(self.quick, matching=matching, most_pixels=_MONITORED_PIXELS)

    @property
    def complete(self) -> JointOptions:
        """Gives options with the depths that no pair's texture supports."""
        return JointOptions(complete=True)

    def remembering(self, options: JointOptions, known: KnownFeatures) -> JointOptions:
        """Gives options with a memory for the features of pictures that come again with every
        configuration."""
        return replace(options, refinement=replace(options.refinement, known=known))

    def trusting_poses(self, options: JointOptions) -> JointOptions:
        """Gives options without refinement."""
        return replace(options, refine_poses=False)

    def with_bars(self, options: JointOptions) -> JointOptions:
        """Gives options with conductors, rails and limbs matched as wholes."""
        return replace(options, bars=True)

    def with_depth_steps(self, options: JointOptions, steps: int) -> JointOptions:
        """The most levels of inverse depth."""
        return replace(options, matching=replace(options.matching, most_levels=steps))


def map_joint(given: MapInput, options: JointOptions, progress: Progress) -> MapResult:
    """The map of all configurations in the first one's reference picture. Raises MatchingError
    where none matched."""
    unit_m = unit_of(given)
    return in_metres(_mapped(in_unit(given, unit_m), options, progress, unit_m), unit_m)


def _mapped(given: MapInput, options: JointOptions, progress: Progress, unit_m: float) -> MapResult:
    """The map of an input in units of ``unit_m``; its ``options`` are in metres."""
    reference, others = choose_pictures(given.configurations)
    hint = rig_hint(reference, others) if _nothing_stated(given, options) else []
    if given.rig and _nothing_stated(given, options) and not options.refinement.refine_focal:
        options = replace(
            options, prior=RIG, refinement=replace(options.refinement, calibrated=True)
        )
        hint = [rig_words(given.rig)]
    prior = _prior(given, options, unit_m).in_scene([_apart(reference, o) for o in others])
    refinement = replace(
        options.refinement,
        prior=prior,
        unit_m=unit_m,
        most_turn_rad=most_turn_rad(given),
        other_lens=given.kind is InputKind.PHOTOGRAPHS,
    )
    options = replace(options, refinement=refinement)
    warnings = list(given.warnings)

    started = time.perf_counter()
    progress("refining poses", 0.0)
    reference, refined, unseen = _refine(reference, others, options, warnings)
    unseen = [*unseen, *hint]
    timing_s = {"refine": time.perf_counter() - started}

    started = time.perf_counter()
    left_out = _unfit_to_match(refined)
    kept = [i for i in range(len(refined)) if i not in left_out]
    warnings += [f"left out: {refined[i].picture.name}: {reason}" for i, reason in left_out.items()]
    pictures = [refined[i].picture for i in kept]
    matching = replace(options.matching, adjust_poses=options.refine_poses)
    # one error of a pose is in all pixels: in sigma, not what a pixel is
    if given.kind is not InputKind.SESSION:
        matching = replace(matching, poses_withhold=False)
    scale = options.scale_of(reference.image.shape[0] * reference.image.shape[1])
    if scale < 1.0:
        reference, pictures = reference.shrunk(scale), [p.shrunk(scale) for p in pictures]
    found = match_jointly(
        reference,
        pictures,
        matching,
        [refined[i].uncertainty for i in kept],
        part(progress, 0.22, 0.98),
    )
    for i, picture in zip(found.used, found.pictures):
        pictures[i] = picture
        refined[kept[i]] = replace(refined[kept[i]], picture=picture)
    warnings += [f"left out: {reason}" for reason in found.left_out.values()]
    left_out.update({kept[i]: reason for i, reason in found.left_out.items()})
    timing_s["match"] = time.perf_counter() - started

    started = time.perf_counter()
    progress("fusing", 0.98)
    cloud = cloud_of(reference, found.depth, found.sigma, found.strongest)
    if not len(cloud):
        why = why_no_depth(reference, pictures, unit_m)
        raise MatchingError(
            f"no pixel of {reference.name} has a depth that can be relied on: {why}"
        )
    configurations = [given.configurations[i].configuration for i in kept]
    pairs = _pairs(
        configurations, given.kind is InputKind.SESSION, reference, pictures, found, options
    )
    timing_s["fuse"] = time.perf_counter() - started
    view, images = Reference.of(reference), _images(reference, others, refined, left_out)
    return MapResult(
        "joint",
        view,
        images,
        pairs,
        found.depth,
        found.sigma,
        cloud,
        timing_s,
        warnings,
        found.kind,
        unseen=unseen,
    )


def _apart(reference: Picture, other: Picture) -> float:
    return float(np.linalg.norm(other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]))


def _prior(given: MapInput, options: JointOptions, unit_m: float) -> PosePrior:
    """How good the poses are by the user's word, or the input's (in units of ``unit_m``), else the
    refinement's; of photographs relative to the scene. Raises InputError where both say it."""
    if options.prior is None:
        prior = options.refinement.prior
        assumed = PosePrior() if given.kind is not InputKind.SESSION and prior == METRIC else prior
        return given.prior or assumed.in_unit(unit_m)
    if not _nothing_stated(given, replace(options, prior=None)):
        raise InputError(
            "--prior-... and --rig are for photographs without priors.csv: sessions and priors.csv say how good their "
            "poses are"
        )
    return options.prior.in_unit(unit_m)


def _nothing_stated(given: MapInput, options: JointOptions) -> bool:
    """Whether nobody says how good the poses of photographs are."""
    known = any(p.covariance is not None for c in given.configurations for p in c.others)
    return (
        given.kind is not InputKind.SESSION
        and given.prior is None
        and not known
        and options.prior is None
    )


def choose_pictures(configurations: List[ConfigurationInput]) -> Tuple[Picture, List[Picture]]:
    """One reference picture for all, and one other of each configuration, each from the middle of
    its recording; the others with a reference picture of their instant, where there is one
    (``instants.middle``).

    The scene stands still while vehicles move from one configuration to the next, and every picture
    has its own pose: there is no need for a reference picture of each configuration.
    """
    references = configurations[0].references
    reference = references[len(references) // 2]
    return reference, [instants.middle(c) for c in configurations]


def _refine(
    reference: Picture, others: List[Picture], options: JointOptions, warnings: List[str]
) -> Tuple[Picture, List[RefinedPicture], List[str]]:
    """The reference keeps its pose; its focal length follows the others' where that is refined.
    Last what may be wrong and would show nowhere."""
    if options.refine_poses:
        refinement = refine(reference, others, options.refinement)
        warnings += refinement.warnings
        return refinement.reference, refinement.others, refinement.unseen
    prior = options.refinement.prior
    unrefined = []
    for o in others:
        scale = of_scale(o.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3], prior.scale_sigma)
        known, nan = PoseUncertainty(prior_covariance(reference, o, prior), scale), float("nan")
        unrefined.append(
            RefinedPicture(o, o.T_home_cam, False, "refinement is off", 0, nan, nan, known)
        )
    return reference, unrefined, []


def _unfit_to_match(refined: List[RefinedPicture]) -> Dict[int, str]:
    """Pictures that refinement refused lie pixels away from the others: they are left out where
    others serve.

    Why, by index."""
    if not any(r.refined for r in refined):
        return {}
    reasons = {}
    for i, r in enumerate(refined):
        rotation_rad = float(np.sqrt(np.max(np.diag(r.uncertainty.covariance)[:3])))
        off_px = r.picture.camera.fx * rotation_rad
        if not r.refined and off_px > PAIRS.most_pose_off_px(r.picture.camera.fx):
            reasons[i] = f"its pose is only known to {off_px:.1f} px ({r.reason})"
    return reasons


def _pairs(
    configurations: List[Configuration],
    level: bool,
    reference: Picture,
    others: List[Picture],
    found: JointDepth,
    options: JointOptions,
):
    pairs, nearest_m = [], NearestUseful(found.depth)
    for bit, i in enumerate(found.used):
        configuration = configurations[i]
        agrees = found.agrees(bit)
        near_m = nearest_m.of(agrees, found.fine.residuals.seen[bit] > 0)
        far_m = farthest(
            max(configuration.baseline_m, 1e-6), reference.camera.fx, options.threshold
        )
        range_m = min(near_m, far_m), far_m
        pairs.append(
            JointPair(configuration, reference, others[i], found.depth, agrees, range_m, level)
        )
    return pairs


def _images(
    reference: Picture,
    others: List[Picture],
    refined: List[RefinedPicture],
    left_out: Dict[int, str],
) -> List[ImageEntry]:
    def entry(p: Picture, prior, **found) -> ImageEntry:
        return ImageEntry(p.name, p.vehicle, p.stamp_s, p.T_home_cam, prior, **found)

    images = {reference.name: entry(reference, reference.T_home_cam)}
    for i, (o, r) in enumerate(zip(others, refined)):
        rms = r.epipolar_after_px if np.isfinite(r.epipolar_after_px) else None
        found = entry(
            r.picture,
            o.T_home_cam,
            refined=r.refined,
            inliers=r.inliers,
            epipolar_rms_px=rms,
            left_out=left_out.get(i),
        )
        images.setdefault(o.name, found)
    return list(images.values())
