# SPDX-License-Identifier: Apache-2.0
"""The planner: from a range and an accepted error to the baselines to fly (thesis 3.2, 3.5 and
6.6)."""

from dataclasses import dataclass, field
from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.mission import Mission
from fcsv_stereo.equations import ErrorThreshold, baseline_for, depth_error, farthest, segment_ends
from fcsv_stereo.errors import PlanError
from fcsv_stereo.model import AXES, Axis
from fcsv_stereo.planning.overlap import non_overlap, overlap_starts_m

_DEFAULT_COUNT = 4  # n_B of the thesis's own lists (3.2, 6.7)


@dataclass(frozen=True)
class PlanRequest:
    """What is wanted. ``baselines_m`` by hand replaces ``count`` and the segments of 3.3;
    ``trim_m`` by hand replaces the trim points (6.6). ``tilt_per_m_rad`` turns the other camera
    inward per metre of baseline (3.5)."""

    range_m: float
    threshold: ErrorThreshold
    camera: PinholeCamera
    nearest_m: float = 0.0
    count: Optional[int] = None
    baselines_m: Optional[Sequence[float]] = None
    trim_m: Optional[Sequence[float]] = None
    whole: bool = False
    disparity_error_px: float = 1.0
    axes: Tuple[str, ...] = (Axis.HORIZONTAL.value,)  # words, as a mission file has them
    tilt_per_m_rad: float = 0.0

    def __post_init__(self):
        _require(
            np.isfinite(self.range_m) and self.range_m > 0,
            f"--range-m {self.range_m:g} must be positive",
        )
        _require(
            0 <= self.nearest_m < self.range_m,
            f"--nearest-m {self.nearest_m:g} must be 0 or more and under --range-m {self.range_m:g}",
        )
        _require(
            0 < self.disparity_error_px < 100,
            f"--disparity-error-px {self.disparity_error_px:g} is not in 0..100",
        )
        _require(
            self.count is None or 1 <= self.count <= 50, f"--number {self.count} is not in 1..50"
        )
        _require(
            self.count is None or self.baselines_m is None, "give --number or --baselines, not both"
        )
        _require(
            bool(self.axes) and set(self.axes) <= set(AXES),
            f"--axis: {self.axes} is not of {', '.join(AXES)}",
        )
        _require_ascending("--baselines", self.baselines_m)
        _require_ascending("--trim", self.trim_m)
        _require(0 <= self.tilt_per_m_rad < np.radians(20), "--tilt-per-m-deg is not in 0..20")


@dataclass(frozen=True)
class PlannedBaseline:
    """One configuration to fly; lengths in m. ``range_m`` is what its depth is trimmed to,
    ``farthest_m`` is equation 3.1's end, ``error_m`` 2.12's error at the far end of the range.
    ``non_overlap`` is the share of the reference picture that the other does not see, at the near
    end (where that is 0: where the views meet) and at the far end."""

    axis: str
    baseline_m: float
    tilt_rad: float
    range_m: Tuple[float, float]
    farthest_m: float
    error_m: float
    overlap_starts_m: float
    non_overlap: Tuple[float, float]


@dataclass(frozen=True)
class Plan:
    """The planned configurations, per axis with growing baselines, and notes for the person who
    flies them."""

    request: PlanRequest
    baselines: List[PlannedBaseline]
    notes: List[str] = field(default_factory=list)


def make_plan(request: PlanRequest) -> Plan:
    """Baselines, their segments, and what the cameras share. Raises PlanError where the request
    contradicts itself."""
    notes: List[str] = []
    baselines_m = _baselines(request, notes)
    planned = []
    for axis in request.axes:
        focal_px, _ = along(request.camera, axis)
        far_m = [
            farthest(b, focal_px, request.threshold, request.disparity_error_px)
            for b in baselines_m
        ]
        ends_m = _trim_points(request, baselines_m, far_m, notes)
        start_m = request.nearest_m
        for i in _without_superfluous(request, baselines_m, ends_m, notes):
            planned.append(_planned(request, axis, baselines_m[i], (start_m, ends_m[i]), far_m[i]))
            start_m = ends_m[i]
    if request.tilt_per_m_rad and Axis.VERTICAL in request.axes:
        notes.append(
            "a vertical baseline's tilt is pitch, which a fixed camera on a hovering multirotor cannot have"
        )
    notes += _not_flown(planned)
    return Plan(request, planned, notes)


def along(camera: PinholeCamera, axis: str) -> Tuple[float, float]:
    """Focal length (px) and angle of view (rad) along a baseline's axis."""
    if axis == Axis.HORIZONTAL:
        return camera.fx, 2.0 * float(np.arctan(camera.width / 2.0 / camera.fx))
    return camera.fy, 2.0 * float(np.arctan(camera.height / 2.0 / camera.fy))


def whole_trim_point(farthest_m: float) -> float:
    """The largest number of two digits that is not beyond 3.1's end: what a person sets by hand
    (3.2, 6.6).

    >>> [whole_trim_point(z) for z in (120.4, 240.8, 361.2, 481.6)]
    [120.0, 240.0, 360.0, 480.0]
    """
    step = 10.0 ** (np.floor(np.log10(farthest_m)) - 1)
    return float(np.floor(farthest_m / step + 1e-9) * step)


def _baselines(request: PlanRequest, notes: List[str]) -> List[float]:
    """Gives the baselines by hand, or one per segment of 3.3 by 3.2."""
    if request.baselines_m is not None:
        return [float(b) for b in request.baselines_m]
    # the coarser axis must reach it too
    focal_px = min(along(request.camera, axis)[0] for axis in request.axes)

    count = request.count or _DEFAULT_COUNT
    ends_m = segment_ends(request.nearest_m, request.range_m, count)
    found = [
        baseline_for(z, focal_px, request.threshold, request.disparity_error_px) for z in ends_m
    ]
    if request.whole:
        found = _in_whole_metres(found, notes)
    least_m = Mission.min_separation_m
    if request.count is not None or found[-1] < least_m:
        return found
    short = ", ".join(f"{b:.2f}" for b in found if b < least_m)
    if short:
        notes.append(f"left out, as nearer than two vehicles may fly ({least_m:g} m): {short} m")
    return [b for b in found if b >= least_m]


def _in_whole_metres(found: List[float], notes: List[str]) -> List[float]:
    whole = sorted({float(np.ceil(b - 1e-9)) for b in found})
    if len(whole) < len(found):
        notes.append(f"rounded up to whole metres, {len(found)} baselines became {len(whole)}")
    return whole


def _trim_points(
    request: PlanRequest, baselines_m: List[float], far_m: List[float], notes: List[str]
) -> List[float]:
    """Far end (m) of each baseline's range; the last one not beyond the wanted range. One that is
    not beyond the end before it has nothing left to see."""
    if request.trim_m is not None:
        return _trimmed_by_hand(request, baselines_m, far_m, notes)
    whole = request.whole or request.baselines_m is not None
    reached = [z >= request.range_m * (1 - 1e-9) for z in far_m]
    ends_m = [
        request.range_m if r else whole_trim_point(z) if whole else z
        for z, r in zip(far_m, reached)
    ]
    if not reached[-1]:
        notes.append(
            f"the longest baseline, {baselines_m[-1]:g} m, holds the error to {far_m[-1]:.1f} m only; "
            f"{request.range_m:g} m needs {_needed(request):.2f} m"
        )
    return ends_m


def _without_superfluous(request, baselines_m, ends_m, notes) -> List[int]:
    """Indices of the baselines that see something beyond the one before. One by hand that does not
    is an error; the planner's own, rounded to whole metres, is left out."""
    kept, superfluous, reached_m = [], [], request.nearest_m
    for i, end_m in enumerate(ends_m):
        (kept if end_m > reached_m else superfluous).append(i)
        reached_m = max(reached_m, end_m)
    names = ", ".join(f"{baselines_m[i]:g}" for i in superfluous)
    if superfluous and request.baselines_m is not None:
        raise PlanError(
            f"baseline {names} m has nothing left to see between {request.nearest_m:g} and {request.range_m:g} m: a "
            f"shorter one reaches the whole range already; leave it out, or raise --range-m"
        )
    if superfluous:
        notes.append(f"left out, as its neighbour reaches as far in whole numbers: {names} m")
    return kept


def _trimmed_by_hand(request, baselines_m, far_m, notes) -> List[float]:
    ends_m = [float(z) for z in request.trim_m]
    if len(ends_m) != len(baselines_m):
        raise PlanError(
            f"--trim has {len(ends_m)} points for {len(baselines_m)} baselines; give one for each"
        )
    if ends_m[0] <= request.nearest_m:
        raise PlanError(f"--trim {ends_m[0]:g} is not beyond --nearest-m {request.nearest_m:g}")
    for b, end_m, f in zip(baselines_m, ends_m, far_m):
        if end_m > f * 1.005:
            notes.append(
                f"{b:g} m is trimmed at {end_m:g} m, beyond the {f:.1f} m that hold the error"
            )
    return ends_m


def _planned(
    request: PlanRequest, axis: str, b: float, range_m: Tuple[float, float], far_m: float
) -> PlannedBaseline:
    focal_px, fov_rad = along(request.camera, axis)
    tilt_rad = request.tilt_per_m_rad * b
    if fov_rad / 2 + tilt_rad >= np.radians(85):
        raise PlanError(
            f"{axis} {b:g} m would be tilted by {np.degrees(tilt_rad):.0f} degrees; lower --tilt-per-m-deg"
        )
    starts_m = overlap_starts_m(b, fov_rad, tilt_rad)
    near_m = range_m[0] if range_m[0] > 0 else starts_m
    shares = tuple(float(non_overlap(z, b, fov_rad, tilt_rad)) for z in (near_m, range_m[1]))
    error_m = float(depth_error(range_m[1], b, focal_px, request.disparity_error_px))
    return PlannedBaseline(axis, b, tilt_rad, range_m, far_m, error_m, starts_m, shares)


def _not_flown(planned: Sequence[PlannedBaseline]) -> List[str]:
    """Why some baselines cannot be flown with the usual fence and separation, a line for each
    axis."""
    fence, least_m, notes = Fence(), Mission.min_separation_m, []
    for axis, most_m in ((Axis.HORIZONTAL, fence.radius_m), (Axis.VERTICAL, fence.ceiling_m)):
        lengths_m = [b.baseline_m for b in planned if b.axis == axis]
        long = ", ".join(f"{b:.0f}" for b in lengths_m if b > most_m)
        short = ", ".join(f"{b:.2f}" for b in lengths_m if b < least_m)
        if long:
            notes.append(
                f"{axis.value}: {long} m would leave the fence ({most_m:g} m): accept a larger --error, a shorter "
                f"--range-m, or a longer focal length"
            )
        if short:
            notes.append(
                f"{axis.value}: {short} m is nearer than two vehicles may fly ({least_m:g} m): lower --number, or "
                f"raise --nearest-m"
            )
    return notes


def _needed(request: PlanRequest) -> float:
    focal_px = min(along(request.camera, axis)[0] for axis in request.axes)
    return baseline_for(request.range_m, focal_px, request.threshold, request.disparity_error_px)


def _require(condition: bool, words: str) -> None:
    if not condition:
        raise PlanError(words)


def _require_ascending(flag: str, values: Optional[Sequence[float]]) -> None:
    if values is None:
        return
    v = np.asarray(values, float)
    good = v.size > 0 and np.isfinite(v).all() and (v > 0).all() and (np.diff(v) > 0).all()
    _require(bool(good), f"{flag} {' '.join(f'{x:g}' for x in v)}: give positive numbers that grow")
