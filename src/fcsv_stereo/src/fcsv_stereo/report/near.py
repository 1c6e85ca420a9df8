# SPDX-License-Identifier: Apache-2.0
"""The report's section on the near field: what depth cameras brought, and whether it meets the
map."""

from typing import List

from fcsv_stereo.report.parts import Paragraph, Part, Table, Tone, note, number
from fcsv_stereo.report.sections import ReportData

_MOST_STEP = 0.05  # of the depth: what a seam may be


def near_field(data: ReportData) -> List[Part]:
    """Frames, points, pixels; the seam. Nothing where there is no near field."""
    n = data.result.near
    if n is None:
        return []
    rows = [
        (
            "frames summed",
            ", ".join(f"{v}: {count}" for v, count in sorted(n.frames.items())) or "none",
        ),
        ("points of it in the cloud", f"{n.points:,}"),
        ("pixels of the reference picture", f"{n.pixels:,}, of which {n.new:,} had no depth"),
        ("pixels that both know", f"{n.shared:,}"),
    ]
    if n.step is None:
        return [
            Table((), rows),
            note("The near field and the map do not meet in the reference picture."),
        ]
    rows += [
        ("where", f"{n.from_m:.1f} to {n.to_m:.1f} m"),
        ("seam: step of the map, median", f"{n.step:+.1%}"),
        ("seam: distance between both, median", number(n.apart, "{:.1%}")),
        ("within two standard deviations", number(n.agree, "{:.0%}")),
    ]
    said = note(
        "Step: the map's depth over the near field's, less one, where both know a pixel. The near field's scale is the "
        "depth camera's own, the map's that of its baselines."
    )
    if abs(n.step) <= _MOST_STEP:
        return [Table((), rows), said]
    wrong = f"Near field and map differ by {n.step:+.1%} where they meet: a baseline, or the depth camera, is wrong."
    return [Paragraph(wrong, Tone.WARNING), Table((), rows), said]
