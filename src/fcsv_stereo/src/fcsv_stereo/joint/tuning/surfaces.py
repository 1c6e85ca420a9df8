# SPDX-License-Identifier: Apache-2.0
"""Numbers of the choice among surfaces."""

from dataclasses import dataclass
from typing import Tuple

from fcsv_stereo.joint.tuning.recorded import (
    EIGHT_THIN,
    FOUR_DENIED,
    FOURTEEN,
    SEED_3,
    Tuned,
    tuned,
)


@dataclass(frozen=True)
class CandidateTuning(Tuned):
    """``surfaces.candidates``."""

    most: int = tuned(
        14, "candidates of a pixel", "the right surface among them against time and memory", SEED_3
    )
    rings_px: Tuple[int, ...] = tuned(
        (2, 4, 6, 9),
        "px of the coarser scale",
        "how far an edge may move back against wrong surfaces",
        SEED_3,
        "more rings are worse",
    )
    most_distant: int = tuned(
        10, "candidates of a place that is not known", "of the surfaces about it"
    )
    inward_px: int = tuned(
        3,
        "px of the coarser scale",
        "from the edge of what is known to a second place: the first may be a mixed one",
    )
    alike: float = tuned(
        0.02, "share of inverse depth", "candidates nearer to each other are one: time"
    )
    alike_px: float = tuned(
        0.6, "px of this scale, fastest pair", "and by this movement besides: time"
    )
    by_a_step_px: int = tuned(
        3, "px of the coarser scale", "further from a step of depth there is no choice: time"
    )
    step: float = tuned(
        0.1,
        "share of inverse depth",
        "what is a step: less of it offers more choices, and takes time",
    )
    farthest_1_m: float = tuned(1e-5, "1/m", "as good as infinite: shares of less mean nothing")
    stretch: float = tuned(
        1.33, "times inverse depth", "by which a plane may change over a ring", SEED_3
    )
    far_stretch: float = tuned(
        3.0, "times inverse depth", "and over the way to what is not known", SEED_3
    )
    near_radius_px: int = tuned(
        3, "px of the coarser scale", "a plane's surroundings: noise against edges"
    )
    near_same: float = tuned(
        0.05, "share of inverse depth", "what of them is of one surface with it"
    )
    near_stiffness: float = tuned(
        0.3, "times the window's pixels", "few pixels have no slope of their own"
    )
    far_radius_px: int = tuned(
        8, "px of the coarser scale", "the same of planes for what is not known"
    )
    far_same: float = tuned(
        0.15, "share of inverse depth", "the same of planes for what is not known"
    )
    far_stiffness: float = tuned(
        0.03, "times the window's pixels", "the same of planes for what is not known"
    )
    least_plane_px: int = tuned(
        4, "px of the coarser scale", "fewer have no plane but their own value"
    )


@dataclass(frozen=True)
class Colour(Tuned):
    """``surfaces.colour``."""

    per_grey: float = tuned(
        0.1,
        "cost units per grey level",
        "a plane is likelier whose place has the pixel's colour",
        SEED_3,
        "heavier colour is worse",
    )
    most_grey: float = tuned(40.0, "grey levels", "the most that colour counts")
    none_grey: float = tuned(
        10.0, "grey levels", "what counts where a plane has no place of its own"
    )
    alike_grey: float = tuned(
        20.0, "grey levels, mean of colours", "census bits beyond it are of another surface"
    )
    least_alike: int = tuned(4, "bits of 32", "with fewer of its own colour, all of them count")
    settle_px: int = tuned(
        5,
        "px of this scale",
        "radius of the surroundings whose surface a pixel takes: noise of edges against thin "
        "things and time, which grows with its square",
    )
    settle_grey: float = tuned(
        14.0,
        "grey levels, all colours together",
        "colours of one surface: less of it mixes fewer surfaces",
        FOURTEEN,
        "18 and 25: fewer within 10 %, together with a larger volume 0.6 to 0.9 points",
    )
    likeness_shift: int = tuned(
        4, "bits of squared distance", "precision of a weight against the table's size"
    )
    likeness_bins: int = tuned(512, "entries", "beyond them a weight is nothing")
    other: float = tuned(1.1, "times inverse depth", "what is another surface's")
    farthest_1_m: float = tuned(1e-5, "1/m", "as good as infinite")


@dataclass(frozen=True)
class DataCost(Tuned):
    """``surfaces.data_cost``."""

    per_bit: float = tuned(
        0.75, "cost units per census bit of 32", "windows against brightness and prices", SEED_3
    )
    per_grey: float = tuned(
        8.0 / 30.0, "cost units per grey level", "brightness against windows", SEED_3
    )
    most_grey: float = tuned(30.0, "grey levels", "the most that brightness counts")
    cut: float = tuned(18.0, "cost units", "the most that one pair objects")
    unseen: float = tuned(8.0, "cost units", "what a pair counts that cannot see the place")
    denied: float = tuned(
        60.0,
        "cost units",
        "what a pair counts that sees something behind it",
        FOUR_DENIED,
        "30 to 120: within 0.3 points",
    )
    seen_through: float = tuned(
        1.2,
        "times inverse depth",
        "what is nearer than this before what a pair shows is denied",
        FOUR_DENIED,
        "1.17 to 1.33: within 0.3 points",
    )
    front: float = tuned(1.08, "times inverse depth", "what is nearer than this hides the place")
    front_1_m: float = tuned(1e-4, "1/m", "and by this besides")


@dataclass(frozen=True)
class ThinUprights(Tuned):
    """``surfaces.thin_uprights``.

    Sizes do not grow with the focal length: what outvotes a thin thing are windows of so many px,
    however large it is.
    """

    widest_px: int = tuned(
        9,
        "px of this scale",
        "narrower is thin: thin things against edges of broad ones",
        EIGHT_THIN,
    )
    tall_px: int = tuned(9, "px of this scale", "at least as high is upright", EIGHT_THIN)
    nearer: float = tuned(
        1.3, "times inverse depth", "by which it is before what is about it", EIGHT_THIN
    )
    leave: float = tuned(
        3.0,
        "cost units",
        "another surface than the own place's costs it there",
        EIGHT_THIN,
        "for all near stripes however they lie: 0.1 to 0.3 points fewer",
    )
    farthest_1_m: float = tuned(1e-4, "1/m", "as good as infinite")


@dataclass(frozen=True)
class Select(Tuned):
    """``surfaces.select``."""

    p1: float = tuned(
        2.0, "cost units", "price of a gap between planes, per ``meet`` of it", SEED_3
    )
    p2: float = tuned(
        40.0,
        "cost units",
        "the most of it: more carries surfaces over edges, less scatters",
        SEED_3,
    )
    edge_grey: float = tuned(10.0, "grey levels", "a step of grey that halves p2", SEED_3)
    meet: float = tuned(
        0.02, "share of inverse depth", "a gap between planes that counts as p1", SEED_3
    )
    stretch_step: float = tuned(
        0.05, "share of inverse depth", "a step that a map which is stretched keeps sharp"
    )


CANDIDATES, COLOUR, DATA_COST = CandidateTuning(), Colour(), DataCost()
THIN_UPRIGHTS, SELECT = ThinUprights(), Select()
