# SPDX-License-Identifier: Apache-2.0
"""Pose refinement of a session: the story from pictures and priors to adjusted poses."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import Picture
from fcsv_stereo.refinement.consensus import Consensus, adjust_robustly
from fcsv_stereo.refinement.features import View, prepare
from fcsv_stereo.refinement.focal import FocalFit, focal_fit
from fcsv_stereo.refinement.graph import link_all, start_poses
from fcsv_stereo.refinement.judge import judge, scaled, surprise
from fcsv_stereo.refinement.links import Link
from fcsv_stereo.refinement.rolling_shutter import ReadoutTurns, readout_turns, straightened
from fcsv_stereo.refinement.symptoms import symptom
from fcsv_stereo.refinement.systematic import systematic
from fcsv_stereo.refinement.time_offset import motions
from fcsv_stereo.refinement.tracks import observe
from fcsv_stereo.refinement.types import ANY_FOCAL, RefinedPicture, Refinement, RefineOptions

_DEFAULT = RefineOptions()
_SIFT_FEATURES = 1500
_STRAIGHTENINGS = 2


def refine(reference: Picture, others: Sequence[Picture], options: RefineOptions = _DEFAULT) -> Refinement:
    """Poses of ``others`` relative to ``reference`` (whose pose stays), from all pictures together.

    Features are matched in the bands that the priors leave, corners tracked from the depths of these, and all poses
    adjusted at once with their priors, from which alone scale comes. A picture about which too little is known keeps
    its prior and says why. Where ``correct_camera``, a rolling shutter and a wrong focal length that the pictures show
    beyond doubt are taken out of them, and a warning says so: pictures come back straightened. Raises InputError for
    pictures that cannot be compared at all.
    """
    _check(reference, others)
    away_m = [float(np.linalg.norm(o.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])) for o in others]
    options = replace(options, prior=options.prior.in_scene(away_m or [1.0]))
    clock = _Clock()
    found = _adjusted([reference, *others], options, clock)
    words: List[str] = []
    if options.correct_camera and not options.calibrated:
        found, words = _straightened(found, options, clock)
    focal = None if options.calibrated else focal_fit(found.consensus, _cameras(found))
    if focal is not None and focal.known and options.correct_camera:
        freed = replace(options, refine_focal=True, focal_sigma=ANY_FOCAL)
        found = replace(_adjusted(found.pictures, freed, clock), turns=found.turns)
        words.append(f"{focal.words}: it was taken; calibrate the camera, or --keep-camera")
    elif focal is not None:
        found = _doubted(found, focal)
        words += [f"{focal.words}: calibrate the camera, or map with --refine-focal"] if focal.words else []
    refined = _refinement(found, words, options, clock)
    return replace(refined, unseen=[focal.unseen] if focal is not None and focal.unseen else [])


@dataclass(frozen=True)
class _Adjustment:
    """Of ``pictures``, the reference first; ``direct`` are their links with it by number. ``turns`` by which they were
    straightened, None: they are as they came."""

    pictures: List[Picture]
    views: List[View]
    direct: Dict[int, Link]
    consensus: Consensus
    unmoving: List[str]  # warnings
    turns: Optional[ReadoutTurns] = None


def _adjusted(pictures: List[Picture], options: RefineOptions, clock: "_Clock") -> _Adjustment:
    with ThreadPoolExecutor(options.threads) as pool:
        look = prepare if options.known is None else options.known.prepare
        views = list(pool.map(lambda p: look(p, _SIFT_FEATURES), pictures))
        clock.lap("features")
        direct, between = link_all(views, options, pool)
        trusted = [l for l in direct.values() if not l.reason] + between
        starts = start_poses(len(views), trusted)
        trusted = [l for l in trusted if l.a in starts and l.b in starts]
        clock.lap("match")
        found = observe(views, trusted, options.features, pool) if trusted else None
        clock.lap("track")
    moving, unmoving = motions(pictures[0], pictures[1:], options)
    consensus = adjust_robustly(views, found, trusted, starts, moving, options)
    clock.lap("adjust")
    return _Adjustment(pictures, views, direct, consensus, unmoving)


def _straightened(found: _Adjustment, options: RefineOptions, clock: "_Clock") -> Tuple[_Adjustment, List[str]]:
    """With pictures whose rows were read at once, and words about it, where the given ones show that they were not."""
    given = found.pictures
    for _ in range(_STRAIGHTENINGS):
        turns = _turns(found)
        if turns is None or not (found.turns or turns.sure):
            break
        pictures = [straightened(p, turns.turns_rad[k]) if k in turns.turns_rad else p for k, p in enumerate(given)]
        found = replace(_adjusted(pictures, options, clock), turns=turns)
    if found.turns is None:
        return found, []
    words = (
        "rows were read one after the other while the cameras turned (rolling shutter): up to "
        f"{found.turns.most_px:.1f} px from the first row to the last; the pictures were straightened (--keep-camera "
        "leaves them)"
    )
    return found, [words]


def _turns(found: _Adjustment) -> Optional[ReadoutTurns]:
    return readout_turns(found.consensus, _cameras(found), found.turns.turns_rad if found.turns else {})


def _cameras(found: _Adjustment) -> Dict[int, PinholeCamera]:
    return {k: v.camera for k, v in enumerate(found.views)}


def _doubted(found: _Adjustment, focal: FocalFit) -> _Adjustment:
    """With what a focal length that may be wrong makes of the poses."""
    adjusted = replace(found.consensus.adjusted, doubted=focal.if_left, focal_doubt=focal.probability)
    return replace(found, consensus=replace(found.consensus, adjusted=adjusted))


def _refinement(found: _Adjustment, words: List[str], options: RefineOptions, clock: "_Clock") -> Refinement:
    consensus, views, direct = _with_systematic(found, options.calibrated), found.views, found.direct
    refined = [_explained(judge(views, k, direct[k], consensus, options), views, k) for k in range(1, len(views))]
    clock.lap("adjust")
    warnings = [*found.unmoving, *words, *_warnings(refined, views, options)]
    scale, offsets_s = 1.0, {}
    if consensus.adjusted is not None:
        scale = consensus.adjusted.focal_scale
        offsets_s = {m.vehicle: s for m, s in zip(consensus.moving, consensus.adjusted.time_offsets_s)}
    reference = replace(found.pictures[0], camera=scaled(found.pictures[0].camera, scale))
    return Refinement(reference, refined, warnings, clock.laps_s, scale, offsets_s)


def _with_systematic(found: _Adjustment, calibrated: bool) -> Consensus:
    """With what errors that all points of a picture share may have made of the poses; rows of a calibrated rig are not
    in doubt."""
    consensus, turns = found.consensus, _turns(found)
    if consensus.adjusted is None or turns is None:
        return consensus
    shared = systematic(consensus, _cameras(found)).covariance
    if not calibrated:
        shared = shared + (turns.covariance if found.turns else turns.if_left)
    return replace(consensus, adjusted=replace(consensus.adjusted, systematic=shared))


class _Clock:
    """Seconds of each kind of step."""

    def __init__(self):
        self.laps_s: Dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps_s[name] = self.laps_s.get(name, 0.0) + now - self._last
        self._last = now


def _check(reference: Picture, others: Sequence[Picture]) -> None:
    """Raises InputError for what is no picture with a pose."""
    for p in (reference, *others):
        if p.image.dtype != np.uint8 or p.image.ndim not in (2, 3):
            raise InputError(f"{p.name}: pictures to refine are 8-bit, grey or RGB; this is {p.image.dtype}")
        if p.image.shape[:2] != (p.camera.height, p.camera.width):
            raise InputError(f"{p.name}: is {p.image.shape[1]}x{p.image.shape[0]}, its camera is not")
        R = p.T_home_cam[:3, :3]
        if not np.isfinite(p.T_home_cam).all() or np.abs(R @ R.T - np.eye(3)).max() > 1e-3:
            raise InputError(f"{p.name}: its prior pose is no rigid transform")


def _explained(refined: RefinedPicture, views: List[View], k: int) -> RefinedPicture:
    """With what is wrong with the picture itself, where that can be seen."""
    seen = "" if refined.refined else symptom(views[k].gray, views[0].gray)
    return replace(refined, reason=f"{refined.reason}; {seen}") if seen else refined


def _warnings(refined: List[RefinedPicture], views: List[View], options: RefineOptions) -> List[str]:
    """In plain words: pictures that keep their prior, and priors that were wrong."""
    out = []
    for k, r in enumerate(refined, 1):
        words = surprise(views, k, r, options) if r.refined else f"keeps the pose that it came with: {r.reason}"
        if words:
            out.append(f"{r.picture.name}: {words}")
    return out
