# SPDX-License-Identifier: Apache-2.0
"""Numbers of what is relied on, of sigma, of the sky, and of the checks of a finished map."""

from dataclasses import dataclass
from typing import Tuple

from fcsv_stereo.joint.tuning.recorded import (
    CAR,
    FOUR_DENIED,
    FOURTEEN,
    LIT,
    SIX,
    TILTED,
    Tuned,
    tuned,
)

SKYLINE_SAME = "11 px, and 35 px about it: within 0.15 points of the sky"


@dataclass(frozen=True)
class Reliability(Tuned):
    """``checks.reliability``."""

    speckle_px: int = tuned(
        60, "px of this scale", "smaller parts are no surface: small things against mismatches"
    )
    speckle_levels: int = tuned(
        3, "levels of the volume", "neighbours that differ by no more are of one part"
    )
    certain: float = tuned(
        0.5, "trust, 0 to 1", "of the best pair: what may hide things behind it", SIX
    )
    tells: float = tuned(
        0.2,
        "trust, 0 to 1",
        "by which a match must agree better: than nothing, so that its surroundings may take it "
        "over, and than what it is seen behind, to deny that",
        f"{SIX}; to deny {FOUR_DENIED}",
    )


@dataclass(frozen=True)
class Sigma(Tuned):
    """``checks.sigma``: fitted, not chosen (docs/design/decisions/0007). Relative errors of depth,
    one per step."""

    steps: Tuple[float, ...] = tuned(
        (0.003, 0.01, 0.03, 0.1, 0.25, 0.5),
        "relative step of inverse depth in the surroundings",
        "where errors stand",
    )
    agreed: Tuple[float, ...] = tuned(
        (0.28, 0.23, 0.23, 0.38, 0.63, 1.26),
        "share of depth, times a power of the noise",
        "errors where a pair agrees and the volume's match was trusted",
        FOURTEEN,
    )
    noise_power: float = tuned(
        0.69, "exponent of the match's relative noise", "the power of it", FOURTEEN
    )
    half_known: Tuple[float, ...] = tuned(
        (0.006, 0.01, 0.023, 0.05, 0.1, 0.26),
        "share of depth",
        "errors where only one of the two holds",
        FOURTEEN,
    )
    hidden: Tuple[float, ...] = tuned(
        (0.25, 0.25, 0.27, 0.33, 0.385, 0.385),
        "share of depth",
        "errors where neither holds and some pair's field of view has the place",
        FOURTEEN,
    )
    unseen: Tuple[float, ...] = tuned(
        (0.07, 0.06, 0.1, 0.36, 0.385, 0.385),
        "share of depth",
        "errors outside of every other picture",
        FOURTEEN,
    )
    correlated: float = tuned(
        1.8,
        "times",
        "neighbours' residuals are not independent, and matching errors have long tails",
    )
    floor_px: float = tuned(
        0.05,
        "px of the full picture, fastest pair that agrees",
        "what interpolation and sampling leave at least",
    )
    unknown_noise: float = tuned(
        0.25, "share of depth", "noise from which on the match tells nothing"
    )
    least_speed: float = tuned(
        0.25, "of the fastest pair's", "speed that counts where only slow pairs agree"
    )


@dataclass(frozen=True)
class Sky(Tuned):
    """``checks.sky``.

    Sizes do not grow with the focal length: the volume's windows of so many px are what they mend,
    and the volume's size is bounded.
    """

    most_px: float = tuned(
        1.2, "px of the volume's scale, fastest pair", "infinity, as well as a match can tell"
    )
    growth_px: int = tuned(
        12, "px of the volume's scale", "by which the match makes what is before the sky too large"
    )
    skyline_grey: float = tuned(
        12.0,
        "grey levels",
        "a step of colour at which it stops",
        same="10: noise on soft clouds stops it",
    )
    about_px: int = tuned(
        25,
        "px of the volume's scale, of the full picture for gaps of a skyline",
        "what is about it",
    )
    least_share: float = tuned(0.02, "share of that", "sky that there must be about it")
    top_rows: int = tuned(2, "rows of the volume's scale", "the sky begins in them")
    bins: int = tuned(16, "of each colour", "precision of colours' shares against noise", TILTED)
    beside_px: int = tuned(
        8, "px of the full picture", "from the sky: gaps of a skyline", LIT, SKYLINE_SAME
    )
    far_px: float = tuned(
        12.0, "px of the full picture, fastest pair", "nearer skylines have none: fog", LIT
    )
    known_share: float = tuned(
        0.2, "share of what is joined by soft edges", "sky that is known otherwise, at least"
    )
    most_agreed: float = tuned(
        0.3, "share of what is answered", "of moved clouds that pairs agree on"
    )


@dataclass(frozen=True)
class Moved(Tuned):
    """``checks.moved``."""

    corners: int = tuned(800, "corners", "precision of the alignment against time", CAR)
    least_corners: int = tuned(40, "corners", "with fewer two pictures cannot be compared", CAR)
    least_inliers: float = tuned(
        0.4, "share of the tracked corners", "with fewer the alignment is none", CAR
    )
    most_off_px: float = tuned(
        1.0, "px of the full picture", "of a corner from where the pose puts it", CAR
    )
    track_px: int = tuned(
        15, "px of the full picture", "window of the tracking (Lucas and Kanade)", CAR
    )
    off_px: float = tuned(
        0.35,
        "px of the full picture",
        "what the alignment leaves: edges differ by so much of their slope",
        CAR,
    )
    unknown_1_m: float = tuned(0.05, "1/m", "uncertainty of inverse depth where there is none", CAR)
    noise: float = tuned(2.0, "times the median difference", "what noise explains", CAR)
    least_share: float = tuned(1e-4, "share of the picture", "smaller spots are noise", CAR)
    least_spot_px: int = tuned(9, "px of the full picture", "and never fewer", CAR)
    margin_px: int = tuned(3, "px of the full picture", "about a spot", CAR)
    exposure_rounds: int = tuned(3, "rounds", "in which what is unusual is left out")
    apart_s: float = tuned(
        2.0, "s", "a picture nearer in time does not tell that something stands: a walker goes 3 m"
    )

    @property
    def warning_share(self) -> float:
        """Share of the picture left out that is worth a warning: five of the smallest spots."""
        return 5.0 * self.least_share


@dataclass(frozen=True)
class AxisConflict(Tuned):
    """``checks.axis_conflict``."""

    least_relative_sigma: float = tuned(
        0.2, "share of depth", "sigma of a depth that an axis denies", CAR
    )
    pixels: float = tuned(
        8e4, "px", "that are looked at: places that are denied are larger than pixels", CAR
    )
    share: float = tuned(0.7, "share of them", "that must be denied", CAR)
    apart_s: float = tuned(
        0.5, "s", "a picture no further from a reference picture is of its moment"
    )


@dataclass(frozen=True)
class EnoughEvidence(Tuned):
    """``checks.enough_evidence``."""

    least_across: float = tuned(
        0.25, "share of a baseline", "across the line of sight: with less it is an approach"
    )


@dataclass(frozen=True)
class Visibility(Tuned):
    """``checks.visibility``."""

    border_px: int = tuned(2, "px of the full picture", "of the other picture that does not count")


RELIABILITY, SIGMA, SKY, MOVED = Reliability(), Sigma(), Sky(), Moved()
AXIS_CONFLICT, ENOUGH_EVIDENCE, VISIBILITY = AxisConflict(), EnoughEvidence(), Visibility()
