# SPDX-License-Identifier: Apache-2.0
"""Whether the two pictures of now make a good pair, in figures and in words."""

import math
from dataclasses import dataclass
from typing import List, Optional, Tuple

import numpy as np

from fcsv_console.model.facts import CameraPoseReport, EpipolarReport
from fcsv_console.model.hearing import Aged
from fcsv_console.model.looking import seen_by_both
from fcsv_console.model.mission_file import ConfigurationRow, Optics, overlap_share
from fcsv_stereo.equations import depth_error
from fcsv_stereo.instants import MOST_SKEW_S
from fcsv_stereo.model.inputs import FLOWN

LEAST_OVERLAP = 0.5  # under it half of the reference picture gets no depth
MOST_TURN_DEG = 3.0  # SettleBounds.heading_deg
MOST_APART_M = 0.15  # SettleBounds.hold_m
MOST_REFINED_PX = 1.0  # the map's report warns above it (report.plain_words.MOST_EPIPOLAR_PX)
MOST_SURPRISE = 3.5  # the map doubts the trackers above it (refinement.links.SURPRISE)
# twice the largest turn with which the refinement of poses was measured
MOST_CORRECTED_RAD = math.radians(1.0)
# of pictures that cannot be fitted: as far as the map trusts the trackers
MOST_TRACKED_RAD = FLOWN.rotation_rad

_NOT_COMPARED = "the pair is as planned; its pictures are not compared yet"
_SHOW_LITTLE = "the pair is as planned; its pictures show too little to compare"


@dataclass(frozen=True)
class StereoHealth:
    """Holds the state of the reference and the vehicle that moves; NaN: not known. ``apart_m``:
    from the planned place; ``turn_deg``: of the headings against the plan; ``pitch_deg``,
    ``roll_deg``: of one camera against the other, as wind leans the vehicles: rectification takes
    them out, so that they count by the overlap only; ``judged``: there is enough to say go or
    no-go; ``before``: nothing is flown yet, pictures and places alone are judged. ``epipolar_px``,
    ``refined_px`` and ``surprise``: as EpipolarReport. ``remarks``: what a map of this pair says, but
    does not doubt."""

    pair: Tuple[str, str] = ("", "")
    overlap: float = math.nan
    skew_s: float = math.nan
    turn_deg: float = math.nan
    epipolar_px: float = math.nan
    refined_px: float = math.nan
    surprise: float = math.nan
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
    remarks: Tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Go or no-go; neither where there is nothing to judge."""
        if not self.judged:
            return f"stereo: {'; '.join(self.reasons)}"
        if not self.go:
            return f"NO-GO: {'; '.join(self.reasons)}"
        if self.before:
            return "; ".join(["GO so far: pictures agree with the places", *self.remarks])
        return "; ".join(["GO: the pair is as planned", *self.remarks])


def assess(
    row: ConfigurationRow,
    pair: Tuple[str, str],
    reference: Aged[CameraPoseReport],
    moving: Aged[CameraPoseReport],
    skew_s: float,
    target_m: float,
    optics: Optics,
    told: Optional[EpipolarReport] = None,
    at_once: bool = False,
) -> StereoHealth:
    """While ``row`` is flown. ``skew_s``: of the pictures that the map would take (NaN: not known),
    ``told``: how they agree (None: not known); ``target_m``: the range that is wanted. Places that
    are not known leave the plan's overlap. ``at_once``: its map takes pictures of one instant only;
    any other map takes each picture with its own pose.
    """
    places = tuple(zip(pair, (reference, moving)))
    unknown = tuple(
        f"{name}'s place in home is not known yet" for name, place in places if place.value is None
    )
    if unknown:  # a window that was opened a moment ago
        return StereoHealth(pair, reasons=unknown)
    reasons = [f"{name}'s place is {place.words} old" for name, place in places if place.stale]
    overlap = overlap_share(row, target_m, optics)
    turn_deg = pitch_deg = roll_deg = apart_m = baseline_m = error_m = math.nan
    if not reasons:
        a, b = np.array(reference.value.p_home_m), np.array(moving.value.p_home_m)
        overlap = seen_by_both(reference.value, moving.value, target_m, optics)
        baseline_m = float(np.linalg.norm(b - a))
        apart_m = float(np.linalg.norm(b - a - np.array(row.goal_m)))
        turn_deg = abs(
            _degrees(moving.value.heading_rad - reference.value.heading_rad - row.goal_heading_rad)
        )
        pitch_deg = abs(_degrees(moving.value.pitch_rad - reference.value.pitch_rad))
        roll_deg = abs(_degrees(moving.value.roll_rad - reference.value.roll_rad))
        focal_px = optics.focal_along(row.axis)
        error_m = float(
            depth_error(target_m, max(baseline_m, 1e-3), focal_px, optics.disparity_error_px)
        )
    apart = _apart_in_time(skew_s)
    reasons += _wrong(overlap, target_m, turn_deg, apart_m) + _disagree(told, optics)
    reasons += [told.unlike] if told is not None and told.unlike else []
    reasons += apart if at_once else []
    judged = bool(reasons) or (told is not None and not math.isnan(told.error_px))
    unknown = () if judged else (_NOT_COMPARED if told is None else _SHOW_LITTLE,)
    return StereoHealth(
        pair,
        overlap,
        skew_s,
        turn_deg,
        *_figures(told),
        apart_m,
        baseline_m,
        error_m,
        target_m,
        judged and not reasons,
        tuple(reasons) or unknown,
        judged,
        pitch_deg=pitch_deg,
        roll_deg=roll_deg,
        remarks=() if at_once else tuple(apart),
    )


def _degrees(angle_rad: float) -> float:
    """Within -180..180."""
    return math.degrees((angle_rad + math.pi) % (2.0 * math.pi) - math.pi)


def assess_before(
    pair: Tuple[str, str], skew_s: float, told: Optional[EpipolarReport], optics: Optics
) -> StereoHealth:
    """Judges the pair before the first configuration, by the pictures that cross the radio all the
    time.

    Vehicles stand in a column: one looks along the baseline, nothing can be fitted, the error as
    tracked is judged.
    """
    reasons = _disagree(told, optics)
    figures = _figures(told)
    unknown = ["no pictures of both yet"] if math.isnan(skew_s) else []
    unknown += (
        ["no epipolar error yet: no home, or too little in common"]
        if math.isnan(figures[0])
        else []
    )
    words, go = tuple(reasons or unknown), not (reasons or unknown)
    judged = bool(reasons) or not unknown
    return StereoHealth(
        pair,
        math.nan,
        skew_s,
        math.nan,
        *figures,
        go=go,
        reasons=words,
        judged=judged,
        before=True,
        remarks=tuple(_apart_in_time(skew_s)),
    )


def _apart_in_time(skew_s: float) -> List[str]:
    """Gives what a map cannot tell of pictures that were not taken in one instant."""
    if not skew_s > MOST_SKEW_S:
        return []
    return [f"what moves may be mapped wrongly: pictures are {1e3 * skew_s:.0f} ms apart"]


def _figures(told: Optional[EpipolarReport]) -> Tuple[float, float, float]:
    """Error as tracked, what the fit leaves of it, and surprise."""
    return (math.nan,) * 3 if told is None else (told.error_px, told.refined_px, told.surprise)


def _disagree(told: Optional[EpipolarReport], optics: Optics) -> List[str]:
    """What of pictures and places the map would doubt. Pictures that it can fit are judged by what
    the fit leaves."""
    if told is None or math.isnan(told.error_px):
        return []
    focal_px = optics.focal_px if math.isnan(told.picture_focal_px) else told.picture_focal_px
    most_rad = MOST_TRACKED_RAD if math.isnan(told.refined_px) else MOST_CORRECTED_RAD
    found = []
    if told.error_px > focal_px * most_rad:
        found.append(
            f"pictures and places disagree by {told.error_px:.0f} px across the epipolar lines"
        )
    if told.refined_px > MOST_REFINED_PX:
        found.append(
            f"pictures miss their epipolar lines by {told.refined_px:.1f} px, however the map fits them"
        )
    if told.surprise > MOST_SURPRISE:
        found.append(
            f"pictures put the cameras {told.surprise:.1f} standard deviations off their trackers"
        )
    return found


def _wrong(overlap: float, target_m: float, turn_deg: float, apart_m: float) -> List[str]:
    found = []
    if overlap < LEAST_OVERLAP:
        found.append(f"only {overlap:.0%} of the picture is seen by both at {target_m:.0f} m")
    if turn_deg > MOST_TURN_DEG:
        found.append(f"the cameras are turned {turn_deg:.1f} degrees against the plan")
    if apart_m > MOST_APART_M:
        found.append(f"the camera is {apart_m:.2f} m from its place")
    return found
