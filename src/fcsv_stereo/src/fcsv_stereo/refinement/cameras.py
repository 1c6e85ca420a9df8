# SPDX-License-Identifier: Apache-2.0
"""Faults of cameras that an adjustment shows, taken out of the pictures or said: focal lengths first, then shutters.

A wrong focal length bends whatever else is fitted: poses seem wrong, rows seem to be read late. So it is looked for
before a pose is blamed, first in single pictures, then in all.
"""

from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_stereo.refinement.adjustment import Adjustment, Clock, adjusted, with_cameras
from fcsv_stereo.refinement.focal import FocalFit, fitted, focal_fit, is_known
from fcsv_stereo.refinement.judge import contradicted, unclear
from fcsv_stereo.refinement.own_focal import odd_focals
from fcsv_stereo.refinement.rolling_shutter import ReadoutTurns, could_turn, readout_turns, straightened
from fcsv_stereo.refinement.types import ANY_FOCAL, RefineOptions

_ROUNDS = 3
_SETTLED = 0.02  # share: a smaller change is linear enough to need no new links
_STRAIGHTENINGS = 2


@dataclass(frozen=True)
class Mended:
    """An adjustment with cameras as good as the pictures tell, what is said about them, and the focal length that is
    in doubt (None: none is)."""

    found: Adjustment
    words: List[str] = field(default_factory=list)
    focal: Optional[FocalFit] = None
    blamed: Dict[int, str] = field(default_factory=dict)  # by picture: what is wrong with its camera


def mended(found: Adjustment, options: RefineOptions, clock: Clock) -> Mended:
    """Single focal lengths, the common one, and a rolling shutter, in this order; each is only said where
    ``correct_camera`` is off."""
    found, words, blamed = _own_focals(found, options, clock)
    focal = focal_fit(found.consensus, found.cameras, contradicted(found.views, found.consensus, options))
    taken = _common_focal(found, focal, options, clock) if options.correct_camera else None
    if taken is not None:
        found, focal = taken, None
        words.append(f"{_change_words(found)}: it was taken; calibrate the camera, or --keep-camera")
    if options.correct_camera:
        found, more = _straightened(found, options, clock)
        words = more + words
        if more and taken is None:
            focal = focal_fit(found.consensus, found.cameras, contradicted(found.views, found.consensus, options))
    if focal is not None and focal.words:
        words.append(f"{focal.words}: calibrate the camera, or map with --refine-focal")
    return Mended(found, words, focal, blamed)


def _own_focals(
    found: Adjustment, options: RefineOptions, clock: Clock
) -> Tuple[Adjustment, List[str], Dict[int, str]]:  # fmt: skip
    """With the focal length of a picture that is not the others', where some picture did not come out clear."""
    if len(found.pictures) < 3 or not unclear(found.views, found.consensus, found.direct, options):
        return found, [], {}
    factors = odd_focals(found.views, options)
    clock.lap("match")
    if not factors:
        return found, [], {}
    blamed = {k: f"its focal length is {_length(f)} than the given one" for k, f in factors.items()}
    if options.correct_camera:
        found = adjusted(with_cameras(found.pictures, factors), options, clock)
    what = "it was taken; calibrate this camera, or --keep-camera" if options.correct_camera else "calibrate this camera"
    words = [
        f"{found.pictures[k].name}: against the other pictures {blamed[k]} (another lens, zoom or size of picture): {what}"
        for k in factors
    ]
    return found, words, blamed


def _length(factor: float) -> str:
    return f"{abs(factor - 1.0):.1%} {'longer' if factor > 1.0 else 'shorter'}"


def _common_focal(
    found: Adjustment, focal: Optional[FocalFit], options: RefineOptions, clock: Clock
) -> Optional[Adjustment]:  # fmt: skip
    """With the focal length of all cameras free, and links by cameras that have it; None where the pictures do not
    contradict the given one, or do not tell it well enough in the end."""
    if focal is None or not focal.evident or options.refine_focal:
        return None
    freed = replace(options, refine_focal=True, focal_sigma=ANY_FOCAL)
    scale = 1.0 + focal.change if abs(focal.change) > ANY_FOCAL else 1.0
    for _ in range(_ROUNDS):
        pictures = with_cameras(found.pictures, dict.fromkeys(range(len(found.pictures)), scale))
        again = replace(adjusted(pictures, freed, clock), focal_scale=scale)
        if again.consensus.adjusted is None:
            return None
        change, sigma = fitted(again.consensus, again.cameras)
        total = scale * (1.0 + change)
        if abs(change) <= (_SETTLED if scale != 1.0 else ANY_FOCAL):
            return again if is_known(total - 1.0, sigma) else None
        scale = total
    return None


def _change_words(found: Adjustment) -> str:
    change, sigma = fitted(found.consensus, found.cameras)
    return FocalFit(found.focal_scale * (1.0 + change) - 1.0, sigma, 1.0, np.zeros((0, 0))).words


def _straightened(found: Adjustment, options: RefineOptions, clock: Clock) -> Tuple[Adjustment, List[str]]:
    """With pictures whose rows were read at once, and words about it, where the given ones show that they were not."""
    given, first = found.pictures, found
    if not could_turn(given, options.most_turn_rad):
        return found, []
    for _ in range(_STRAIGHTENINGS):
        turns = turns_of(found)
        if turns is None or not (found.turns or turns.sure):
            break
        pictures = [straightened(p, turns.turns_rad[k]) if k in turns.turns_rad else p for k, p in enumerate(given)]
        freed = found.consensus.problem.focal_sigma > 0.0
        again = replace(options, refine_focal=True, focal_sigma=ANY_FOCAL) if freed and not options.refine_focal else options
        found = replace(adjusted(pictures, again, clock), turns=turns, focal_scale=found.focal_scale)
    if found.turns is None or not _better(first, found):
        return first, []
    words = (
        "rows were read one after the other while the cameras turned (rolling shutter): up to "
        f"{found.turns.most_px:.1f} px from the first row to the last; the pictures were straightened (--keep-camera "
        "leaves them)"
    )
    return found, [words]


def _better(before: Adjustment, after: Adjustment) -> bool:
    """Whether straightened pictures fit each other better than those that were given, and are all still used."""
    if after.consensus.adjusted is None:
        return False
    old, new = before.consensus, after.consensus
    return set(old.adjusted.order) <= set(new.adjusted.order) and _noise_px(new) < _LESS_NOISE * _noise_px(old)


def _noise_px(consensus) -> float:
    noise_px = consensus.problem.noise_px
    return float(np.median([noise_px[k] for k in consensus.adjusted.order]))


_LESS_NOISE = 0.95


def turns_of(found: Adjustment) -> Optional[ReadoutTurns]:
    """How the cameras turned while their rows were read, by what is left of the residuals."""
    return readout_turns(found.consensus, found.cameras, found.turns.turns_rad if found.turns else {})
