# SPDX-License-Identifier: Apache-2.0
"""Pose refinement of a session: the story from pictures and priors to adjusted poses."""

from dataclasses import replace
from typing import List, Sequence

import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.model import Picture
from fcsv_stereo.refinement.adjustment import Adjustment, Clock, adjusted
from fcsv_stereo.refinement.cameras import Mended, mended, turns_of
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.judge import all_wrong, decide, scaled, surprise
from fcsv_stereo.refinement.rolling_shutter import could_turn
from fcsv_stereo.refinement.symptoms import symptom
from fcsv_stereo.refinement.systematic import systematic
from fcsv_stereo.refinement.types import RefinedPicture, Refinement, RefineOptions

_DEFAULT = RefineOptions()


def refine(
    reference: Picture, others: Sequence[Picture], options: RefineOptions = _DEFAULT
) -> Refinement:
    """Poses of ``others`` relative to ``reference`` (whose pose stays), from all pictures together.

    Features are matched in the bands that the priors leave, corners tracked from the depths of
    these, and all poses adjusted at once with their priors, from which alone scale comes. A picture
    about which too little is known keeps its prior and says why. Where ``correct_camera``, a
    rolling shutter and wrong focal lengths that the pictures show beyond doubt are taken out of
    them, and a warning says so: pictures come back straightened. Raises InputError for pictures
    that cannot be compared at all, or whose focal lengths contradict each other.
    """
    _check(reference, others)
    away_m = [
        float(np.linalg.norm(o.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])) for o in others
    ]
    options = replace(options, prior=options.prior.in_scene(away_m or [1.0]))
    clock = Clock()
    found = adjusted([reference, *others], options, clock)
    best = Mended(found) if options.calibrated else mended(found, options, clock)
    return _refinement(best, options, clock)


def _refinement(best: Mended, options: RefineOptions, clock: Clock) -> Refinement:
    found, focal = best.found, best.focal
    consensus, views, direct = (
        _with_systematic(_with_focal(best), options),
        found.views,
        found.direct,
    )
    judged = [decide(views, k, direct[k], consensus, options) for k in range(1, len(views))]
    refined = [_explained(r, views, k) for k, r in enumerate(judged, 1)]
    clock.lap("adjust")
    warnings = [*found.unmoving, *best.words, *_warnings(refined, views, options)]
    rest, offsets_s = 1.0, {}
    if consensus.adjusted is not None:
        rest = consensus.adjusted.focal_scale
        offsets_s = {
            m.vehicle: s for m, s in zip(consensus.moving, consensus.adjusted.time_offsets_s)
        }
    reference = replace(found.pictures[0], camera=scaled(found.pictures[0].camera, rest))
    unseen = [focal.unseen] if focal is not None and focal.unseen else []
    return Refinement(
        reference, refined, warnings, clock.laps_s, found.focal_scale * rest, offsets_s, unseen
    )


def _with_focal(best: Mended) -> Adjustment:
    """Adds with what a focal length that may be wrong makes of the poses."""
    found, focal = best.found, best.focal
    if focal is None:
        return found
    adjusted = replace(
        found.consensus.adjusted, focal=focal.if_left, focal_probability=focal.probability
    )
    return replace(found, consensus=replace(found.consensus, adjusted=adjusted))


def _with_systematic(found: Adjustment, options: RefineOptions) -> Consensus:
    """Adds with what errors that all points of a picture share may have made of the poses; rows of
    a calibrated rig are not in doubt."""
    consensus, turns = found.consensus, turns_of(found)
    if consensus.adjusted is None or turns is None:
        return consensus
    shared = systematic(consensus, found.cameras).covariance
    if found.turns:
        shared = shared + turns.covariance
    elif not options.calibrated and could_turn(found.pictures, options.most_turn_rad):
        shared = shared + turns.if_left
    return replace(consensus, adjusted=replace(consensus.adjusted, systematic=shared))


def _check(reference: Picture, others: Sequence[Picture]) -> None:
    """Raises InputError for what is no picture with a pose."""
    for p in (reference, *others):
        if p.image.dtype != np.uint8 or p.image.ndim not in (2, 3):
            raise InputError(
                f"{p.name}: pictures to refine are 8-bit, grey or RGB; this is {p.image.dtype}"
            )
        if p.image.shape[:2] != (p.camera.height, p.camera.width):
            raise InputError(
                f"{p.name}: is {p.image.shape[1]}x{p.image.shape[0]}, its camera is not"
            )
        R = p.T_home_cam[:3, :3]
        if not np.isfinite(p.T_home_cam).all() or np.abs(R @ R.T - np.eye(3)).max() > 1e-3:
            raise InputError(f"{p.name}: its prior pose is no rigid transform")


def _explained(refined: RefinedPicture, views: List[FeatureView], k: int) -> RefinedPicture:
    """Gives the picture with what is wrong with the picture itself, where that can be seen."""
    seen = "" if refined.refined else symptom(views[k].gray, views[0].gray)
    return replace(refined, reason=f"{refined.reason}; {seen}") if seen else refined


def _warnings(
    refined: List[RefinedPicture], views: List[FeatureView], options: RefineOptions
) -> List[str]:
    """Says, in plain words: pictures that keep their prior, and priors that were wrong."""
    together = all_wrong(views, refined, options)
    out = [together] if together else []
    for k, r in enumerate(refined, 1):
        if not r.refined:
            out.append(f"{r.picture.name}: keeps the pose that it came with: {r.reason}")
        elif not together:
            words = surprise(views, k, r, options)
            out += [f"{r.picture.name}: {words}"] if words else []
    return out
