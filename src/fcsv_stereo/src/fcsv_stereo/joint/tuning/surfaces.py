# SPDX-License-Identifier: Apache-2.0
"""Numbers of the choice among surfaces."""

from dataclasses import dataclass
from typing import Tuple

from fcsv_stereo.joint.tuning.recorded import EIGHT_THIN, FOURTEEN, SEED_3, Tuned, tuned


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
    alike_px: float = tuned(
        0.6, "px of this scale, fastest pair", "and by this movement besides: time"
    )
    far_stretch: float = tuned(
        3.0,
        "times inverse depth",
        "by which a plane may change over the way to what is not known",
        SEED_3,
    )
    near_stiffness: float = tuned(
        0.3, "times the window's pixels", "few pixels have no slope of their own"
    )
    far_radius_px: int = tuned(
        8, "px of the coarser scale", "the same of planes for what is not known"
    )
    mixed_px: int = tuned(
        3,
        "px of the coarser scale",
        "to which windows mix what an edge parts: further from a step of depth there is no choice, "
        "and so far inward from the edge of what is known lies a second place to take a plane from",
    )

    @property
    def most_distant(self) -> int:
        """Counts the candidates of a place that is not known: they leave room for one of each
        ring."""
        return self.most - len(self.rings_px)

    @property
    def far_stiffness(self) -> float:
        """Stiffness (times the window's pixels) of planes for what is not known: a tenth, as their
        windows have seven times the pixels."""
        return 0.1 * self.near_stiffness


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


@dataclass(frozen=True)
class DataCost(Tuned):
    """``surfaces.data_cost``."""

    per_bit: float = tuned(
        0.75, "cost units per census bit of 32", "windows against brightness and prices", SEED_3
    )
    unseen: float = tuned(8.0, "cost units", "what a pair counts that cannot see the place")


@dataclass(frozen=True)
class ThinUprights(Tuned):
    """``surfaces.thin_uprights``.

    Sizes do not grow with the focal length: what outvotes a thin thing are windows of so many px,
    however large it is.
    """

    leave: float = tuned(
        3.0,
        "cost units",
        "another surface than the own place's costs it there",
        EIGHT_THIN,
        "for all near stripes however they lie: 0.1 to 0.3 points fewer",
    )
    size_px: int = tuned(
        9,
        "px of this scale",
        "narrower is thin, at least as high is upright: thin things against edges of broad ones",
        EIGHT_THIN,
    )


@dataclass(frozen=True)
class Select(Tuned):
    """``surfaces.select``."""

    p1: float = tuned(
        2.0, "cost units", "price of a gap between planes, per ``SHARED.same`` of it", SEED_3
    )
    p2: float = tuned(
        40.0,
        "cost units",
        "the most of it: more carries surfaces over edges, less scatters",
        SEED_3,
    )


CANDIDATES, COLOUR, DATA_COST = CandidateTuning(), Colour(), DataCost()
THIN_UPRIGHTS, SELECT = ThinUprights(), Select()
