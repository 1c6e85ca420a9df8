# SPDX-License-Identifier: Apache-2.0
"""docs/reference/thresholds.md: from where each user of a condition calls it amber and red."""

import math
from dataclasses import fields

from field_notes import notes_of

from fcsv_geometry.vehicles import thresholds

_TOP = (
    "# Thresholds\n\n"
    "What a flight is judged by (`fcsv_control/conditions.py`), and from where each user acts: "
    "amber / red, a dash where there is none. These are defaults; [files.md](files.md) says which "
    "of them a file may change.\n"
)


def page(head: str) -> str:
    """The page's text; ``head`` stands on top."""
    rows = {n: t for n, t in vars(thresholds).items() if isinstance(t, thresholds.Thresholds)}
    notes, users = notes_of(thresholds.Thresholds), fields(thresholds.Thresholds)[1:-1]
    lines = [head + _TOP, "| condition | who: amber / red | why |", "|---|---|---|"]
    for row in rows.values():
        told = ((user.name, getattr(row, user.name)) for user in users)
        said = [f"{who.replace('_', '-')} {_bounds(b)}" for who, b in told if not math.isnan(b.red)]
        lines.append(f"| {row.what} | {'; '.join(said)} | {row.why} |")
    lines += ["", "| who | is |", "|---|---|"]
    lines += [f"| {u.name.replace('_', '-')} | {notes.get(u.name, '')} |" for u in users]
    return "\n".join(lines) + "\n"


def _bounds(bounds: thresholds.Bounds) -> str:
    """
    >>> _bounds(thresholds.Bounds(0.2, 0.4)), _bounds(thresholds.Bounds(2.0))
    ('0.4 / 0.2', '- / 2')
    """
    amber = "-" if math.isnan(bounds.amber) else f"{bounds.amber:g}"
    return f"{amber} / {bounds.red:g}"
