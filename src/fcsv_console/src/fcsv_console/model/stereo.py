# SPDX-License-Identifier: Apache-2.0
"""Whether the two pictures of now make a good pair, in figures and in words."""

import math
from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from fcsv_console.model.facts import CameraInHome
from fcsv_console.model.hearing import Aged
from fcsv_console.model.looking import seen_by_both
from fcsv_console.model.mission_file import ConfigurationRow, Optics, overlap_share
from fcsv_stereo.equations import depth_error

LEAST_OVERLAP = 0.5  # under it half of the reference picture gets no depth
MOST_SKEW_S = 0.05  # at 0.15 m/s (SettleBounds.speed_mps) a camera moves 8 mm meanwhile
MOST_TURN_DEG = 3.0  # SettleBounds.heading_deg
MOST_APART_M = 0.15  # SettleBounds.hold_m
MOST_EPIPOLAR_PX = 10.0  # 1 degree at 602 px: twice the largest turn with which the refinement of poses was measured


@dataclass(frozen=True)
class StereoHealth:
    """Of the reference and the vehicle that moves; NaN: not known. ``apart_m``: from the planned place; ``turn_deg``:
    of the headings against the plan; ``pitch_deg``, ``roll_deg``: of one camera against the other, as wind leans the
    vehicles: rectification takes them out, so that they count by the overlap only; ``judged``: there is enough to say
    go or no-go; ``before``: nothing is flown yet, pictures and places alone are judged."""

    pair: Tuple[str, str] = ("", "")
    overlap: float = math.nan
    skew_s: float = math.nan
    turn_deg: float = math.nan
    epipolar_px: float = math.nan
    apart_m: float = math.nan
    baseline_m: float = math.nan
    error_m: float = math.nan
    target_m: float = math.nan
    go: bool = False
    reasons: Tuple[str, ...] = ("no configuration is flown",)
    judged: bool = False
    before: bool = False
    pitch_deg: float = math.nan
    roll_deg: float = math.nan

    @property
    def words(self) -> str:
        """Go or no-go; neither where there is nothing to judge."""
        if not self.judged:
            return f"stereo: {'; '.join(self.reasons)}"
        if self.go and self.before:
            return "GO so far: pictures of the same moment, and they agree with the places"
        return "GO: the pair is as planned" if self.go else f"NO-GO: {'; '.join(self.reasons)}"


def judge(
    row: ConfigurationRow, pair: Tuple[str, str], reference: Aged[CameraInHome], moving: Aged[CameraInHome],
    skew_s: float, target_m: float, optics: Optics, epipolar_px: float = math.nan,
) -> StereoHealth:  # fmt: skip
    """While ``row`` is flown. ``skew_s`` between both pictures, ``epipolar_px`` as measured (NaN: not known);
    ``target_m``: the range that is wanted. Places that are not known leave the plan's overlap."""
    reasons: List[str] = []
    for name, place in zip(pair, (reference, moving)):
        if place.value is None or place.stale:
            reasons.append(f"{name}'s place in home is not known" if place.value is None else
                           f"{name}'s place is {place.words} old")  # fmt: skip
    overlap = overlap_share(row, target_m, optics)
    turn_deg = pitch_deg = roll_deg = apart_m = baseline_m = error_m = math.nan
    if not reasons:
        a, b = np.array(reference.value.p_home_m), np.array(moving.value.p_home_m)
        overlap = seen_by_both(reference.value, moving.value, target_m, optics)
        baseline_m = float(np.linalg.norm(b - a))
        apart_m = float(np.linalg.norm(b - a - np.array(row.goal_m)))
        turn_deg = abs(_degrees(moving.value.heading_rad - reference.value.heading_rad - row.goal_heading_rad))
        pitch_deg = abs(_degrees(moving.value.pitch_rad - reference.value.pitch_rad))
        roll_deg = abs(_degrees(moving.value.roll_rad - reference.value.roll_rad))
        focal_px = optics.focal_along(row.axis)
        error_m = float(depth_error(target_m, max(baseline_m, 1e-3), focal_px, optics.disparity_error_px))
    reasons += _wrong(overlap, target_m, skew_s, turn_deg, apart_m)
    reasons += _disagree(epipolar_px)
    return StereoHealth(pair, overlap, skew_s, turn_deg, epipolar_px, apart_m, baseline_m, error_m, target_m,
                        not reasons, tuple(reasons), True, pitch_deg=pitch_deg, roll_deg=roll_deg)  # fmt: skip


def _degrees(angle_rad: float) -> float:
    """Within -180..180."""
    return math.degrees((angle_rad + math.pi) % (2.0 * math.pi) - math.pi)


def judge_before(pair: Tuple[str, str], skew_s: float, epipolar_px: float) -> StereoHealth:
    """Before the first configuration, by the pictures that cross the radio all the time (NaN: not known)."""
    reasons = _apart_in_time(skew_s) + _disagree(epipolar_px)
    unknown = ["no pictures of both yet"] if math.isnan(skew_s) else []
    unknown += ["no epipolar error yet: no home, or too little in common"] if math.isnan(epipolar_px) else []
    told, go = tuple(reasons or unknown), not (reasons or unknown)
    judged = bool(reasons) or not unknown
    return StereoHealth(pair, skew_s=skew_s, epipolar_px=epipolar_px, go=go, reasons=told, judged=judged, before=True)


def _apart_in_time(skew_s: float) -> List[str]:
    return [f"the pictures are {1e3 * skew_s:.0f} ms apart"] if skew_s > MOST_SKEW_S else []


def _disagree(epipolar_px: float) -> List[str]:
    wrong = epipolar_px > MOST_EPIPOLAR_PX
    return [f"pictures and places disagree by {epipolar_px:.0f} px across the epipolar lines"] if wrong else []


def _wrong(overlap: float, target_m: float, skew_s: float, turn_deg: float, apart_m: float) -> List[str]:
    found = []
    if overlap < LEAST_OVERLAP:
        found.append(f"only {overlap:.0%} of the picture is seen by both at {target_m:.0f} m")
    found += _apart_in_time(skew_s)
    if turn_deg > MOST_TURN_DEG:
        found.append(f"the cameras are turned {turn_deg:.1f} degrees against the plan")
    if apart_m > MOST_APART_M:
        found.append(f"the camera is {apart_m:.2f} m from its place")
    return found
