# SPDX-License-Identifier: Apache-2.0
"""Numbers that several stages mean alike, and numbers that are no matter of choice."""

from dataclasses import dataclass

from fcsv_stereo.joint.tuning.recorded import (
    BENCH,
    CAR,
    FOURTEEN,
    RIG,
    SEED_3,
    SEED_3_AND_PLAIN_1,
    Tuned,
    tuned,
)

#: Inverse depth (1/m) that is as good as infinite: 100 km.
FARTHEST_1_M = 1e-5
#: Share of a depth: what every page calls wrong errs by more.
WRONG = 0.1
#: Levels of inverse depth that a match has at least.
LEAST_LEVELS = 8
#: Baseline (m) below which two pictures are of one place: what is left of rounding.
NO_BASELINE_M = 1e-6
#: Information (grey levels squared times metres squared) that keeps divisions finite.
LEAST_INFORMATION = 1e-6
#: Share of a mean weight that keeps cells without texture finite.
LEAST_WEIGHT = 1e-3
#: Share of the scale within which it is held: as good as fixed, but finite.
SCALE_HELD = 1e-5


@dataclass(frozen=True)
class Shared(Tuned):
    """What is one surface, what is noise, and how large a pixel's surroundings are."""

    noise_grey: float = tuned(
        0.75,
        "grey levels",
        "a smaller step is no texture: less lets noise in, more loses pale ground",
        SEED_3_AND_PLAIN_1,
        "0.5 and less are worse on some world; 1.5: 4 points fewer on plains",
    )
    surface_grey: float = tuned(
        10.0,
        "grey levels",
        "a difference as between two surfaces: it halves the price of a jump, and a pixel's part in "
        "a local mean",
        f"{SEED_3}; as a part in the mean {BENCH}",
    )
    same: float = tuned(
        0.02, "share of inverse depth", "planes nearer to each other are one", SEED_3
    )
    one_surface: float = tuned(
        0.05, "share of inverse depth", "places that differ by less are of one surface"
    )
    step: float = tuned(
        0.1,
        "share of inverse depth",
        "places that differ by more are of two surfaces: less offers more choices and takes time",
        SEED_3,
    )
    window_px: int = tuned(
        5, "px of this scale", "surroundings that tell likeness and texture: noise against edges"
    )
    around_px: int = tuned(
        9,
        "px of the full picture",
        "surroundings whose trust and steps of depth tell how sure a depth is",
        FOURTEEN,
    )
    least_pixels: int = tuned(
        200, "px or cells", "fewer tell nothing of a picture, a band or its poses"
    )
    beyond: float = tuned(
        3.0,
        "times what is usual (a standard deviation, a median, what noise explains)",
        "what differs by more is no noise: misses against alarms",
        f"{BENCH}; of what moved {CAR}; of bars {RIG}",
    )


SHARED = Shared()
