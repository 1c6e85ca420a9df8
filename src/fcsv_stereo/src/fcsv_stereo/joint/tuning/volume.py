# SPDX-License-Identifier: Apache-2.0
"""Numbers of the cost volume, its aggregation, and what is taken from it."""

from dataclasses import dataclass

from fcsv_stereo.joint.tuning.recorded import FIVE, SEED_3_AND_PLAIN_1, SIX, Tuned, tuned


@dataclass(frozen=True)
class Census(Tuned):
    """``volume.census``."""

    unseen_bits: float = tuned(
        9.0,
        "bits of 32",
        "the least that a pair counts which sees nothing: more than a match, less than none",
        FIVE,
    )
    beyond_match: float = tuned(
        0.3,
        "share of the way from a match to none",
        "the same where steps of grey are no larger than noise: less "
        "draws such pixels to depths that few pairs see",
        FIVE,
    )


@dataclass(frozen=True)
class Volume(Tuned):
    """``volume.cost_volume`` and ``volume.pair_costs``."""

    level_price: float = tuned(
        8.0,
        "volume units",
        "by which an upright window is preferred to a level one: the lesser of two costs is less "
        "often right",
        SEED_3_AND_PLAIN_1,
    )
    least_tilt: float = tuned(
        0.12,
        "px per row of this scale, fastest pair",
        "a level plane that shears less is not tried: time",
    )
    most_drift_px: float = tuned(
        0.5,
        "px of the other picture",
        "beyond the two pixels that one is sampled from: time against precision",
    )
    unlikely: int = tuned(
        5,
        "volume units",
        "price of what is unlikely where pictures say nothing: a depth above the horizon, and to go "
        "on level",
        f"{SEED_3_AND_PLAIN_1}, and the tests' boards under a grey sky",
        "0: 13 % of the boards' answers are wrong; as it is 0.1 %",
    )
    alike_levels: int = tuned(
        2, "levels", "no further apart two depths are as good as one, and as infinite"
    )


@dataclass(frozen=True)
class Sgm(Tuned):
    """``volume.sgm``."""

    p1: float = tuned(
        40.0,
        "volume units",
        "price of a step of one level: more flattens, less is noisy",
        FIVE,
        "30 to 45: within 0.3 points",
    )
    p2: float = tuned(
        330.0,
        "volume units",
        "price of a larger step: more closes gaps, less scatters",
        FIVE,
        "250 to 500: within 0.3 points",
    )


@dataclass(frozen=True)
class Winner(Tuned):
    """``volume.winner``: the best depth, whether it is a good match, and what the rough match
    bounds."""

    most_cost: int = tuned(
        110,
        "volume units",
        "a match that costs less is good: more known pixels against wrong ones",
        FIVE,
        "90, with p1 20, p2 500 and another price of the unseen: 1.2 points less",
    )
    least_margin: float = tuned(
        0.03,
        "share of the best sum",
        "by which the next best must be worse",
        FIVE,
        "0.07 and 0.12: 0.1 points more on streets, 1.5 fewer on plains",
    )
    least_bits: int = tuned(5, "bits of 32", "and the bits that are set in its census code")
    nearest_percentile: float = tuned(
        99.8, "percentile of inverse depth", "what of the picture bounds every row"
    )
    nearest_picture: float = tuned(
        1.3,
        "times that inverse depth",
        "room for what is nearer and matched badly: time",
        same="1.5: with other changes 5 % more time",
    )
    reach: float = tuned(
        0.08,
        "share of the picture's height",
        "things stand higher than where they are matched well",
    )
    low_percentile: float = tuned(
        25.0, "percentile of a row's inverse depths", "what lies low in it"
    )
    room: float = tuned(
        1.5,
        "times what was found",
        "room for what is nearer than what was matched well in a row, and above the ground: time",
    )


@dataclass(frozen=True)
class FarRematch(Tuned):
    """``volume.far_rematch``.

    Sizes do not grow with the focal length: the step is what the sub-pixel step can begin from, so
    that the levels, and the time of each pixel, would grow with it.
    """

    far_px: float = tuned(
        40.0,
        "px of the full picture, fastest pair",
        "what moves less is matched again: depth of far things against time",
        SIX,
        "100: worse near and far",
    )
    step_px: float = tuned(
        0.5, "px of the full picture, fastest pair", "depth of far things against time", SIX
    )
    same: float = tuned(
        0.25,
        "share of inverse depth",
        "by which a match may differ from the surface that was chosen",
        SIX,
        "0.5: far depth the same, 0.4 points fewer within 10 %",
    )
    least_share: float = tuned(
        0.01, "share of a row", "a row with less that is far is left as it is: time alone"
    )

    @property
    def levels(self) -> int:
        """Counts the levels of inverse depth."""
        return int(self.far_px / self.step_px) + 1


CENSUS, VOLUME, SGM, WINNER, FAR_REMATCH = Census(), Volume(), Sgm(), Winner(), FarRematch()
