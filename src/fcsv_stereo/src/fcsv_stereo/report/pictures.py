# SPDX-License-Identifier: Apache-2.0
"""Sections of the report about its pictures: what a pixel covers, which pictures there were."""

from typing import List

from fcsv_stereo.evaluating.ground_sample import GroundSample
from fcsv_stereo.map_files.picture_list import PictureUse, picture_list
from fcsv_stereo.report.naming import are_photographs, time_of
from fcsv_stereo.report.parts import Part, Table, note
from fcsv_stereo.report.sections import ReportData


def ground_sample(data: ReportData) -> List[Part]:
    """Centimetres of a pixel by depth; the median depth of the map is among them."""
    found = GroundSample.of(data.result)
    rows = [
        (
            f"{depth_m:.0f} m"
            + (" (median of the map)" if depth_m == found.median_depth_m else ""),
            f"{100 * size_m:.1f} cm",
        )
        for depth_m, size_m in found.table()
    ]
    said = "What one pixel of the reference picture covers across the line of sight; ground seen at a slant is longer."
    return [Table(("depth", "one pixel covers"), rows), note(said)]


def pictures(data: ReportData) -> List[Part]:
    """Name, stamp, role, shift by refinement, used or why not; what the recordings hold beyond."""
    head = ["picture", "vehicle", "taken", "role", "matched for", "turned by", "moved by", "used"]
    rows = [_row(p) for p in picture_list(data.result)]
    if are_photographs(data.result):  # of no vehicle, and their stamps are only their order
        head, *rows = ([row[0], *row[3:]] for row in (head, *rows))
    parts: List[Part] = [Table(head, rows)]
    if data.result.spare:
        said = ", ".join(f"{count:,} of {vehicle}" for vehicle, count in data.result.spare.items())
        parts.append(note(f"Not needed, since one picture of each recording is enough: {said}."))
    return parts


def _row(p: PictureUse) -> List[str]:
    matched = (
        ", ".join(p.configurations) if p.role == "other" else "all" if p.configurations else ""
    )
    shift = (f"{p.turned_deg:.3f}°", f"{p.moved_m:.3f} m") if p.refined else ("–", "–")
    return [
        p.name,
        p.vehicle,
        time_of(p.stamp_s),
        p.role,
        matched or "–",
        *shift,
        "yes" if p.used else f"no: {p.why_not}",
    ]
