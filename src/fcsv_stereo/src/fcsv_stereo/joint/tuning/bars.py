# SPDX-License-Identifier: Apache-2.0
"""Numbers of straight thin things, all chosen on the tilting rig's demo before power lines."""

from dataclasses import dataclass

from fcsv_stereo.joint.tuning.recorded import RIG, Tuned, tuned
from fcsv_stereo.joint.tuning.shared import SHARED


@dataclass(frozen=True)
class Bars(Tuned):
    """``bars``."""

    enlarged: float = tuned(
        2.0,
        "times the full picture",
        "before edges are sought: bars of one px have two edges then",
        RIG,
        "3: a third of the lines at 6 m, else within 3 points",
    )
    least_length_px: float = tuned(
        30.0, "px", "shorter edges are no line: twigs against stripes on fields", RIG
    )
    most_edges: int = tuned(
        150, "edges of a picture, the longest", "time, which grows with its square", RIG
    )
    beside_px: float = tuned(
        1.2, "px", "of pieces to their edge's line: both edges of a thin bar would be one", RIG
    )
    turned_deg: float = tuned(
        3.0, "deg", "of these pieces, of both edges of a bar, of things that stand alike", RIG
    )
    least_crossing_deg: float = tuned(
        20.0, "deg", "between edge and the way of matches: along it is no disparity", RIG
    )
    side_px: float = tuned(1.5, "px", "how far beside an edge its colours are taken", RIG)
    inside_differs: float = tuned(
        8.0,
        "grey levels",
        "of both pictures between the edges: between two conductors lies what is behind",
        RIG,
    )
    nearest_m: float = tuned(0.25, "m", "nearer is no match", RIG)
    least_width_px: float = tuned(0.4, "px", "narrower are two finds of one edge", RIG)
    least_aspect: float = tuned(2.5, "length by width", "shorter is no bar", RIG)
    narrow: float = tuned(
        4.0, "px of length for a px of width", "which of two bars an edge is of", RIG
    )
    one_depth: float = tuned(
        0.7, "of its length", "what a bar counts of which only one edge has a depth", RIG
    )
    same_depth: float = tuned(
        0.25, "of the logarithms of inverse depth", "things that stand beside each other", RIG
    )
    worth: float = tuned(
        0.3, "of an edge's best match", "what is asked whether it explains as much", RIG
    )
    as_well: float = tuned(
        0.95,
        "of the length that is explained",
        "another depth is as good, and nothing is told",
        RIG,
        "0.85: the same from 2 m on, no line at 1 m",
    )
    most_denied: float = tuned(
        0.2, "of a bar's pixels", "at which the map has another depth: a stripe on that", RIG
    )
    sigma_px: float = tuned(0.5, "px of disparity", "of a bar: its error's standard deviation", RIG)

    @property
    def gap_px(self) -> float:
        """Widest gap (px) between pieces of one edge, which changes its contrast on its way."""
        return 4.0 * self.least_length_px

    @property
    def most_width_px(self) -> float:
        """Greatest width (px) of a bar: wider things have a texture of their own."""
        return 1.5 * self.least_length_px

    @property
    def edges_differ_px(self) -> float:
        """Difference (px of disparity) of both edges of a bar at most."""
        return self.agree * self.sigma_px

    @property
    def behind_px(self) -> float:
        """Disparity (px) below which a thing may be at infinity: two standard deviations."""
        return 2.0 * self.sigma_px

    @property
    def inner_differ(self) -> float:
        """Difference of colour (grey levels) beside both edges of a bar, within."""
        return 2.0 * SHARED.surface_grey

    @property
    def colours_differ(self) -> float:
        """Difference of colour (grey levels) beside an edge, on the side that is more alike: more,
        as each picture has its own exposure."""
        return 3.0 * SHARED.surface_grey

    @property
    def agree(self) -> float:
        """Standard deviations within which the map has the bar already."""
        return SHARED.beyond

    @property
    def least_piece_px(self) -> float:
        """Length (px) of a piece of an edge at least: a fifth of the shortest edge."""
        return 0.2 * self.least_length_px


BARS = Bars()
