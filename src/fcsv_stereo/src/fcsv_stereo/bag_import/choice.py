# SPDX-License-Identifier: Apache-2.0
"""Which pictures of posed cameras make a good map: one reference and others at baselines in equal ratios. No I/O.

A baseline serves a range of distances that grows with it in proportion: useful ones for a scene are a hundredth to a
tenth of its distance (docs/user/concepts.md), sideways or up, with nearly the same view.
"""

from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

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
_CANDIDATES = 400  # of each camera, evenly in time, at most


@dataclass(frozen=True)
class PosedStamp:
    """A picture that was not decoded yet: its camera's number and intrinsics, T_world_cam (4, 4), its stamp (s) by the
    poses' clock and by its own."""

    camera: int
    stamp_s: float
    own_stamp_s: float
    intrinsics: PinholeCamera
    T_world_cam: np.ndarray


def choose(
    posed: Sequence[PosedStamp], range_m: float, most: int, reference_s: Optional[float] = None
) -> List[PosedStamp]:
    """The reference, of camera 0, then others by length of baseline; ``most`` in all.

    Without ``reference_s`` the reference is the picture whose others fill the most steps of the baseline. Raises
    InputError where no two pictures make a pair.
    """
    first = [p for p in posed if p.camera == 0]
    if reference_s is not None:
        references = sorted(first, key=lambda p: abs(p.stamp_s - reference_s))[:1]
    else:
        references = _spread(first, _REFERENCES)
    candidates = [p for k in sorted({p.camera for p in posed}) for p in _spread([q for q in posed if q.camera == k],
                                                                               _CANDIDATES)]  # fmt: skip
    best: Tuple[tuple, List[PosedStamp]] = ((), [])
    for reference in references:
        found = _others(reference, candidates, range_m, most - 1)
        rank = (len(found), -sum(abs(p.stamp_s - reference.stamp_s) for p in found))
        if found and (not best[1] or rank > best[0]):
            best = (rank, [reference, *found])
    if not best[1]:
        raise InputError(_why_none(references, candidates, range_m))
    return best[1]


def _others(
    reference: PosedStamp, candidates: Sequence[PosedStamp], range_m: float, count: int
) -> List[PosedStamp]:
    """At most one for each step of the baseline and each axis, the nearest in time to the reference."""
    serving = [p for p in candidates if p is not reference and _serves(reference, p, range_m)]
    if not serving:
        return []
    baselines = {id(p): _baseline(reference, p) for p in serving}
    vertical = {id(p) for p in serving if abs(baselines[id(p)][1]) > abs(baselines[id(p)][0])}
    axes = 2 if 0 < len(vertical) < len(serving) and count > 1 else 1
    steps = max(1, count // axes)
    bins: Dict[Tuple[int, bool], PosedStamp] = {}
    low, high = np.log(np.array(SHARES) * range_m)
    for p in serving:
        length = np.log(np.linalg.norm(baselines[id(p)]))
        place = (
            int(np.clip((length - low) / (high - low) * steps, 0, steps - 1)),
            axes == 2 and id(p) in vertical,
        )
        held = bins.get(place)
        if held is None or _rank(reference, p, baselines) < _rank(reference, held, baselines):
            bins[place] = p
    return sorted(bins.values(), key=lambda p: float(np.linalg.norm(baselines[id(p)])))


def _rank(reference: PosedStamp, p: PosedStamp, baselines) -> tuple:
    """Nearest in time, to a tenth of a second: what moves stands nearly where it was; then the longer baseline."""
    return round(abs(p.stamp_s - reference.stamp_s), 1), -float(np.linalg.norm(baselines[id(p)]))


def _baseline(reference: PosedStamp, p: PosedStamp) -> np.ndarray:
    """(3,) m in the reference's optical axes."""
    return reference.T_world_cam[:3, :3].T @ (p.T_world_cam[:3, 3] - reference.T_world_cam[:3, 3])


def _serves(reference: PosedStamp, p: PosedStamp, range_m: float) -> bool:
    baseline = _baseline(reference, p)
    length = float(np.linalg.norm(baseline))
    if (
        not SHARES[0] * range_m <= length <= SHARES[1] * range_m
        or abs(baseline[2]) > _MOST_FORWARD * length
    ):
        return False
    return overlap(reference, p, range_m) >= _LEAST_OVERLAP


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
    """At most so many, evenly over the order."""
    if len(posed) <= most:
        return list(posed)
    return [posed[i] for i in np.linspace(0, len(posed) - 1, most).round().astype(int)]


def _why_none(
    references: Sequence[PosedStamp], candidates: Sequence[PosedStamp], range_m: float
) -> str:
    least, longest = (share * range_m for share in SHARES)
    said = f"no two pictures make a pair for a scene {range_m:g} m away"
    lengths = [
        float(np.linalg.norm(_baseline(r, p))) for r in references for p in candidates if p is not r
    ]
    fit = [b for b in lengths if least <= b <= longest]
    if fit:
        return f"{said}: those {least:.3g} to {longest:.3g} m apart move forward, or look elsewhere; check --mount"
    far = max(lengths, default=0.0)
    return f"{said}: none are {least:.3g} to {longest:.3g} m apart, and at most {far:.3g} m; does --range-m fit?"
