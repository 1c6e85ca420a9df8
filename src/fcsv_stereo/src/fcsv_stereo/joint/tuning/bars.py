# SPDX-License-Identifier: Apache-2.0
"""Numbers of straight thin things, all chosen on the tilting rig's demo before power lines."""

from dataclasses import dataclass

from fcsv_stereo.joint.tuning.recorded import RIG, Tuned, tuned


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
    least_piece_px: float = tuned(6.0, "px", "shorter pieces of edges are noise; time", RIG)
    least_length_px: float = tuned(
        30.0, "px", "shorter edges are no line: twigs against stripes on fields", RIG
    )
    most_edges: int = tuned(
        150, "edges of a picture, the longest", "time, which grows with its square", RIG
    )
    gap_px: float = tuned(
        120.0, "px", "between pieces of one edge, which changes its contrast on its way", RIG
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
    colours_differ: float = tuned(
        30.0, "grey levels", "beside an edge, on the side that is more alike", RIG
    )
    inner_differ: float = tuned(20.0, "grey levels", "beside both edges of a bar, within", RIG)
    inside_differs: float = tuned(
        8.0,
        "grey levels",
        "of both pictures between the edges: between two conductors lies what is behind",
        RIG,
    )
    least_shared: float = tuned(0.5, "of the shorter one's length", "that both pictures show", RIG)
    nearest_m: float = tuned(0.25, "m", "nearer is no match", RIG)
    behind_px: float = tuned(
        1.0, "px of disparity", "nearer to infinity is no thing before something", RIG
    )
    most_width_px: float = tuned(45.0, "px", "wider things have a texture of their own", RIG)
    least_width_px: float = tuned(0.4, "px", "narrower are two finds of one edge", RIG)
    least_aspect: float = tuned(2.5, "length by width", "shorter is no bar", RIG)
    narrow: float = tuned(
        4.0, "px of length for a px of width", "which of two bars an edge is of", RIG
    )
    one_depth: float = tuned(
        0.7, "of its length", "what a bar counts of which only one edge has a depth", RIG
    )
    edges_differ_px: float = tuned(1.5, "px of disparity", "of both edges of a bar", RIG)
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
    agree: float = tuned(3.0, "standard deviations", "the map has the bar already", RIG)
    sigma_px: float = tuned(0.5, "px of disparity", "of a bar: its error's standard deviation", RIG)


BARS = Bars()
