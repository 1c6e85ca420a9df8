# SPDX-License-Identifier: Apache-2.0
"""Lines, arrows and words as SVG: all that tools/docs/figures.py draws with."""

import math
from html import escape
from typing import List, Sequence, Tuple

Point = Tuple[float, float]
BLUE, ORANGE, GREEN, RED, GREY, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#777777",
    "#222222",
)


class Drawing:
    """A picture of ``width`` x ``height`` px on white (the site has a dark scheme, too); y goes
    down."""

    def __init__(self, width: int, height: int, title: str):
        self._head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
            f'height="{height}" role="img" font-family="DejaVu Sans, Arial, sans-serif">'
        )
        self._parts: List[str] = [
            f"<title>{escape(title)}</title>",
            f'<rect width="{width}" height="{height}" fill="white"/>',
        ]

    def line(self, a: Point, b: Point, color: str = BLACK, width: float = 1.5, dash: str = ""):
        self.path([a, b], color, width, dash)

    def path(self, points: Sequence[Point], color: str = BLACK, width: float = 1.5, dash: str = ""):
        """A line through all points."""
        more = f' stroke-dasharray="{dash}"' if dash else ""
        self._parts.append(
            f'<polyline points="{_points(points)}" fill="none" stroke="{color}" stroke-width="{width:g}"{more}/>'
        )

    def arrow(
        self,
        a: Point,
        b: Point,
        color: str = BLACK,
        width: float = 1.5,
        dash: str = "",
        both: bool = False,
    ):
        """A line from a to b with a head at b, and with ``both`` at a."""
        self.line(a, b, color, width, dash)
        for tail, tip in ((a, b), (b, a))[: 2 if both else 1]:
            along = math.atan2(tip[1] - tail[1], tip[0] - tail[0])
            wings = [
                (tip[0] - 9 * math.cos(along + s), tip[1] - 9 * math.sin(along + s))
                for s in (0.38, -0.38)
            ]
            self.area([tip, *wings], color, 1.0)

    def area(self, points: Sequence[Point], color: str, opacity: float = 0.18):
        self._parts.append(
            f'<polygon points="{_points(points)}" fill="{color}" fill-opacity="{opacity:g}"/>'
        )

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        words: Sequence[str],
        color: str = BLACK,
    ):
        """A frame with one line of words or several in its middle."""
        self._parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="5" fill="{color}" '
            f'fill-opacity="0.10" stroke="{color}" stroke-width="1.5"/>'
        )
        for i, line in enumerate(words):
            middle = y + height / 2 + 5 + 17 * (i - (len(words) - 1) / 2)
            self.text((x + width / 2, middle), line, size=13, anchor="middle", bold=i == 0)

    def dot(self, at: Point, color: str = BLACK, radius: float = 4):
        self._parts.append(
            f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:g}" fill="{color}"/>'
        )

    def camera(self, at: Point, color: str, heading_deg: float = 0.0):
        """A vehicle from above or from the side: a disc, and a line where its camera looks (0: up,
        90: right)."""
        self.dot(at, color, 8)
        self.line(at, turned(at, 17, heading_deg), color, 3)

    def text(
        self,
        at: Point,
        words: str,
        color: str = BLACK,
        size: int = 13,
        anchor: str = "start",
        bold: bool = False,
    ):
        weight = ' font-weight="bold"' if bold else ""
        self._parts.append(
            f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" fill="{color}" font-size="{size}" '
            f'text-anchor="{anchor}"{weight}>{escape(words)}</text>'
        )

    def __str__(self) -> str:
        return "\n".join(
            [
                "<!-- SPDX-License-Identifier: Apache-2.0, drawn by tools/docs/figures.py -->",
                self._head,
                *self._parts,
                "</svg>",
                "",
            ]
        )


def turned(at: Point, length: float, heading_deg: float) -> Point:
    """The point ``length`` px from ``at``; heading 0 is up, 90 right."""
    angle = math.radians(heading_deg)
    return at[0] + length * math.sin(angle), at[1] - length * math.cos(angle)


def _points(points: Sequence[Point]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
