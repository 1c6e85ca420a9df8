# SPDX-License-Identifier: Apache-2.0
"""Which pictures of posed cameras make a good map: one reference and others at baselines in equal
ratios. No I/O.

A baseline serves a range of distances that grows with it in proportion: useful ones for a scene are
a hundredth to a tenth of its distance (docs/user/concepts.md), sideways or up, with nearly the same
view.
"""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.depth import shown_share
from fcsv_stereo.errors import InputError

SHARES = (0.01, 0.1)  # of the scene's distance: the shortest and the longest baseline that serve it
_LEAST_OVERLAP = 0.5  # of the reference picture, at the scene's distance
_MOST_FORWARD = 0.5  # of the baseline: forward motion gives disparity at the border alone
_GRID = 7
_REFERENCES = 60  # pictures of the first camera, evenly in time, that are tried as the reference
_TRIED = 50  # pictures of a step of the baseline whose overlap is looked at, nearest in time first


@dataclass(frozen=True)
class PosedStamp:
    """A picture that was not decoded yet: its camera's number and intrinsics, T_world_cam (4, 4),
    its stamp (s) by the poses' clock and by its own.
    """

    camera: int
    stamp_s: float
    own_stamp_s: float
    intrinsics: PinholeCamera
    T_world_cam: np.ndarray


def choose(
    posed: Sequence[PosedStamp], range_m: float, most: int, reference_s: Optional[float] = None
) -> List[PosedStamp]:
    """The reference, of camera 0, then others by length of baseline; ``most`` in all.

    Without ``reference_s`` the reference is the picture whose others fill the most steps of the
    baseline. Raises InputError where no two pictures make a pair.
    """
    first = [p for p in posed if p.camera == 0]
    if reference_s is not None:
        references = sorted(first, key=lambda p: abs(p.stamp_s - reference_s))[:1]
    else:
        references = _spread(first, _REFERENCES)
    candidates = _Candidates(posed, range_m)
    best: Tuple[tuple, List[PosedStamp]] = ((), [])
    for reference in references:
        found = candidates.of(reference, most - 1)
        rank = (len(found), -sum(abs(p.stamp_s - reference.stamp_s) for p in found))
        if found and (not best[1] or rank > best[0]):
            best = (rank, [reference, *found])
    if not best[1]:
        raise InputError(candidates.why_none(references))
    return best[1]


class _Candidates:
    """All pictures, and which of them serve a reference: an hour of a camera is 100,000, so by
    arrays.
    """

    def __init__(self, posed: Sequence[PosedStamp], range_m: float):
        self._posed, self._range_m = posed, range_m
        self._places_m = np.array([p.T_world_cam[:3, 3] for p in posed]).reshape(-1, 3)
        self._stamps_s = np.array([p.stamp_s for p in posed])

    def of(self, reference: PosedStamp, count: int) -> List[PosedStamp]:
        """Chooses at most one for each step of the baseline and each axis, the nearest in time to
        the reference.
        """
        baselines_m, lengths_m = self._baselines(reference)
        low_m, high_m = (share * self._range_m for share in SHARES)
        fit = (lengths_m >= low_m) & (lengths_m <= high_m)
        (fit,) = np.nonzero(fit & (np.abs(baselines_m[:, 2]) <= _MOST_FORWARD * lengths_m))
        if not len(fit):
            return []
        vertical = np.abs(baselines_m[fit, 1]) > np.abs(baselines_m[fit, 0])
        axes = 2 if vertical.any() and not vertical.all() and count > 1 else 1
        steps = max(1, count // axes)
        step = np.log(lengths_m[fit] / low_m) / np.log(high_m / low_m) * steps
        places = np.clip(step.astype(int), 0, steps - 1) * axes + (vertical if axes == 2 else 0)
        # to a tenth of a second: what moves stands nearly where it was; then the longer baseline
        apart_s = np.round(np.abs(self._stamps_s[fit] - reference.stamp_s), 1)
        order = np.lexsort((-lengths_m[fit], apart_s))
        found = [self._first(reference, fit[order[places[order] == k]]) for k in np.unique(places)]
        return [
            self._posed[i] for i in sorted((i for i in found if i >= 0), key=lambda i: lengths_m[i])
        ]

    def _first(self, reference: PosedStamp, indices: np.ndarray) -> int:
        """The first that sees enough of the reference picture; -1: none of the first ones does."""
        tried = (i for i in indices[:_TRIED])
        sees = (
            i for i in tried if overlap(reference, self._posed[i], self._range_m) >= _LEAST_OVERLAP
        )
        return int(next(sees, -1))

    def _baselines(self, reference: PosedStamp) -> Tuple[np.ndarray, np.ndarray]:
        """(N, 3) m in the reference's optical axes, and (N,) their lengths."""
        away_m = self._places_m - reference.T_world_cam[:3, 3]
        return away_m @ reference.T_world_cam[:3, :3], np.linalg.norm(away_m, axis=1)

    def why_none(self, references: Sequence[PosedStamp]) -> str:
        """Says in words, why no reference has a partner."""
        low_m, high_m = (share * self._range_m for share in SHARES)
        said = f"no two pictures make a pair for a scene {self._range_m:g} m away"
        lengths_m = np.concatenate([self._baselines(r)[1] for r in references])
        if ((lengths_m >= low_m) & (lengths_m <= high_m)).any():
            apart = f"those {low_m:.3g} to {high_m:.3g} m apart"
            return f"{said}: {apart} move forward, or look elsewhere; check --mount"
        far = f"none are {low_m:.3g} to {high_m:.3g} m apart, and at most {lengths_m.max():.3g} m"
        return f"{said}: {far}; does --range-m fit?"


def overlap(reference: PosedStamp, p: PosedStamp, range_m: float) -> float:
    """Share of the reference picture that another sees of what is ``range_m`` away."""
    camera = reference.intrinsics
    edges = (np.linspace(0.0, n - 1.0, _GRID) for n in (camera.width, camera.height))
    xy = camera.normalize(np.stack(np.meshgrid(*edges), -1).reshape(-1, 2))
    points_cam = np.hstack([xy, np.ones((len(xy), 1))]) * range_m
    return shown_share(
        p.intrinsics, p.T_world_cam, transforms.apply(reference.T_world_cam, points_cam)
    )


def _spread(posed: Sequence[PosedStamp], most: int) -> List[PosedStamp]:
    """Keeps at most so many, evenly over the order."""
    if len(posed) <= most:
        return list(posed)
    return [posed[i] for i in np.linspace(0, len(posed) - 1, most).round().astype(int)]
