# SPDX-License-Identifier: Apache-2.0
"""Faults of cameras that an adjustment shows, taken out of the pictures or said: focal lengths
first, then shutters.

A wrong focal length bends whatever else is fitted: poses seem wrong, rows seem to be read late. So
it is looked for before a pose is blamed, first in single pictures, then in all.
"""

from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.refinement.adjustment import Adjustment, Clock, adjusted, with_cameras
from fcsv_stereo.refinement.focal import FocalFit, fitted, focal_fit
from fcsv_stereo.refinement.judge import contradicted, unclear
from fcsv_stereo.refinement.own_focal import odd_focals
from fcsv_stereo.refinement.rolling_shutter import (
    ReadoutTurns,
    could_turn,
    readout_turns,
    straightened,
)
from fcsv_stereo.refinement.types import ANY_FOCAL, RefineOptions

_ROUNDS = 3
_SETTLED = 0.02  # share: a smaller change is linear enough to need no new links
_STRAIGHTENINGS = 2
# times the noise of the pictures as they came: straightened ones fit each other better
_LESS_NOISE = 0.95


@dataclass(frozen=True)
class Mended:
    """An adjustment with cameras as good as the pictures tell, what is said about them, and the
    focal length that is in doubt (None: none is)."""

    found: Adjustment
    words: List[str] = field(default_factory=list)
    focal: Optional[FocalFit] = None


def mended(found: Adjustment, options: RefineOptions, clock: Clock) -> Mended:
    """Single focal lengths, the common one, and a rolling shutter, in this order; without
    ``correct_camera`` focal lengths are only said."""
    found, words = _own_focals(found, options, clock)
    found, focal, taken = _common_focal(found, options, clock)
    if options.correct_camera:
        found, rows = _straightened(found, options, clock)
        words += rows
        if rows and not taken:
            found, focal, taken = _common_focal(found, options, clock)
    if taken:
        words.append(f"{taken}: it was taken; calibrate the camera, or --keep-camera")
    elif focal is not None and focal.words:
        looks_alike = "a wrong principal point looks alike where cameras turn"
        words.append(
            f"{focal.words} ({looks_alike}): calibrate the camera, or map with --refine-focal"
        )
    return Mended(found, words, focal)


def _own_focals(
    found: Adjustment, options: RefineOptions, clock: Clock
) -> Tuple[Adjustment, List[str]]:
    """Mends pictures with the focal length of a picture that is not the others', where some picture
    did not come out clear. Raises InputError where focal lengths contradict each other and no
    majority tells which are wrong."""
    if not unclear(found.views, found.consensus, found.direct, options):
        return found, []
    odd = odd_focals(found.views, options)
    clock.lap("match")
    names = [p.name for p in found.pictures]
    if odd.factors and not odd.outvoted:
        words = _disagreeing(names, odd.factors)
        if options.correct_camera:
            raise InputError(words)
        return found, [words]
    advice = "calibrate this camera"
    if odd.factors and options.correct_camera:
        found = with_cameras(found, odd.factors, options, clock)
        advice = "it was taken; calibrate this camera, or --keep-camera"
    return found, [
        f"{names[k]}: against the other pictures its focal length is {_length(f)} than the given one "
        f"(another lens, zoom or size of picture): {advice}"
        for k, f in odd.factors.items()
    ]


def _disagreeing(names: List[str], factors: Dict[int, float]) -> str:
    against = ", ".join(f"{names[k]} {_length(f)}" for k, f in factors.items())
    return (
        f"{', '.join(names[k] for k in factors)}: the stated focal lengths do not fit those of {names[0]} (as the "
        f"pictures show it, {against}), and no majority tells which are wrong: calibrate the cameras, or --keep-camera "
        "maps with them as they are"
    )


def _length(factor: float) -> str:
    return f"{abs(factor - 1.0):.1%} {'longer' if factor > 1.0 else 'shorter'}"


def _common_focal(
    found: Adjustment, options: RefineOptions, clock: Clock
) -> Tuple[Adjustment, Optional[FocalFit], str]:
    """Mends all pictures with the focal length that the pictures tell, and words about it; as it
    was, with the doubt, where they do not contradict the given one or do not tell it well
    enough."""
    doubted = contradicted(found.views, found.consensus, options)
    focal = focal_fit(found.consensus, found.cameras, doubted, options.other_lens)
    if focal is None or not focal.evident or not options.correct_camera:
        return found, focal, ""
    scale = 1.0 + focal.change if abs(focal.change) > ANY_FOCAL else 1.0
    for _ in range(_ROUNDS):
        again = _with_focal(found, scale, options, clock)
        if again is None:
            break
        change, sigma = fitted(again.consensus, again.cameras)
        total = scale * (1.0 + change)
        if abs(change) <= (_SETTLED if scale != 1.0 else ANY_FOCAL):
            fit = replace(focal, change=total - 1.0, sigma=sigma, probability=1.0)
            return (again, None, fit.words) if fit.known else (found, focal, "")
        scale = total
    return found, focal, ""


def _with_focal(
    found: Adjustment, scale: float, options: RefineOptions, clock: Clock
) -> Optional[Adjustment]:
    """Links by cameras with focal lengths ``scale`` times the given ones, and the rest of it
    free."""
    factors = dict.fromkeys(range(len(found.pictures)), scale)
    again = with_cameras(found, factors, _with_free_focal(options), clock)
    return None if again.consensus.adjusted is None else replace(again, focal_scale=scale)


def _with_free_focal(options: RefineOptions) -> RefineOptions:
    return (
        options
        if options.refine_focal
        else replace(options, refine_focal=True, focal_sigma=ANY_FOCAL)
    )


def _straightened(
    found: Adjustment, options: RefineOptions, clock: Clock
) -> Tuple[Adjustment, List[str]]:
    """Mends pictures with pictures whose rows were read at once, and words about it, where the
    given ones show that they were not."""
    given, first = found.pictures, found
    if not could_turn(given, options.most_turn_rad):
        return found, []
    freed = found.consensus.problem is not None and found.consensus.problem.focal_sigma > 0.0
    for _ in range(_STRAIGHTENINGS):
        turns = turns_of(found)
        if turns is None or not (found.turns or turns.sure):
            break
        pictures = [
            straightened(p, turns.turns_rad[k]) if k in turns.turns_rad else p
            for k, p in enumerate(given)
        ]
        again = adjusted(pictures, _with_free_focal(options) if freed else options, clock)
        found = replace(again, turns=turns, focal_scale=found.focal_scale)
    if found.turns is None or not _better(first, found):
        return first, []
    words = (
        "rows were read one after the other while the cameras turned (rolling shutter): up to "
        f"{found.turns.most_px:.1f} px from the first row to the last; the pictures were straightened (--keep-camera "
        "leaves them)"
    )
    return found, [words]


def _better(before: Adjustment, after: Adjustment) -> bool:
    """Whether straightened pictures fit each other better than those that were given, and are all
    still used."""
    if after.consensus.adjusted is None:
        return False
    old, new = before.consensus, after.consensus
    return set(old.adjusted.order) <= set(new.adjusted.order) and _noise_px(
        new
    ) < _LESS_NOISE * _noise_px(old)


def _noise_px(consensus) -> float:
    noise_px = consensus.problem.noise_px
    return float(np.median([noise_px[k] for k in consensus.adjusted.order]))


def turns_of(found: Adjustment) -> Optional[ReadoutTurns]:
    """How the cameras turned while their rows were read, by what is left of the residuals."""
    return readout_turns(
        found.consensus, found.cameras, found.turns.turns_rad if found.turns else {}
    )
