# SPDX-License-Identifier: Apache-2.0
"""Numbers of the cost volume, its aggregation, and what is taken from it."""

from dataclasses import dataclass

from fcsv_stereo.joint.tuning.recorded import FIVE, SEED_3_AND_PLAIN_1, SIX, Tuned, tuned


@dataclass(frozen=True)
class Census(Tuned):
    """``volume.census``."""

    radius_px: int = tuned(4, "px of this scale", "windows of 9x9: weak texture against edges")
    steps: int = tuned(
        32,
        "parts of a grey level",
        "precision in 16 bits against room for an exposure that is doubled",
    )
    noise_grey: float = tuned(
        0.75,
        "grey levels",
        "a smaller step is no texture: less lets noise in, more loses pale ground",
        SEED_3_AND_PLAIN_1,
        "0.5 and less are worse on some world; 1.5: 4 points fewer on plains",
    )
    cut_bits: float = tuned(
        16.0,
        "bits of 32, after weighing",
        "the most that a depth costs; half of them differ between unrelated places",
    )
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
    flip_grey: float = tuned(
        1.5,
        "grey levels",
        "by which a step differs from the noise that make its bit e times as sure",
        FIVE,
    )


@dataclass(frozen=True)
class Volume(Tuned):
    """``volume.cost_volume`` and ``volume.pair_costs``."""

    units_per_bit: float = tuned(
        10.0, "volume units", "precision of a cost against its room of 8 bits"
    )
    quarters: float = tuned(
        4.0, "parts of a bit", "precision of a pair's cost against its room of 8 bits"
    )
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
    no_sky: int = tuned(
        5,
        "volume units",
        "what a depth costs above the horizon: without it grey skies have depths",
        "the tests' boards under a grey sky",
        "0: 13 % of their answers wrong; as it is 0.1 %",
    )
    infinite_levels: int = tuned(2, "levels", "as good as infinite: they do not cost it")
    band_rows: int = tuned(40, "rows of this scale", "time alone")
    block_levels: int = tuned(32, "levels", "time alone")
    block_columns: int = tuned(32, "px of this scale", "time, against the drift within a block")
    most_drift_px: float = tuned(
        0.5,
        "px of the other picture",
        "beyond the two pixels that one is sampled from: time against precision",
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
    most_price: int = tuned(
        600, "volume units", "room of 16 bits for path costs; no larger price is allowed"
    )
    far_cost: int = tuned(
        1000,
        "volume units",
        "above every path cost: those of a cell (255) and of the largest price",
    )
    level_price: int = tuned(
        5,
        "volume units",
        "price of going on level: where nothing is known, an upright surface is likelier",
        SEED_3_AND_PLAIN_1,
    )
    edge_per_grey: float = tuned(
        0.1, "per grey level", "by which a step of grey lowers p2: one of 10 grey levels halves it"
    )
    least_p2: float = tuned(1.5, "times p1", "p2 on the largest step of grey")
    parts_bits: int = tuned(
        6, "bits of a level", "precision of a level surface's drift against room of 16 bits"
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
    beside_levels: int = tuned(2, "levels", "what is no further from the best is not the next best")
    confident_cost: int = tuned(
        60, "volume units", "a match of the rough volume that bounds the nearest depth"
    )
    texture: float = tuned(
        9.0, "grey levels squared, variance in 5x5", "and the texture that it needs"
    )
    least_bits: int = tuned(5, "bits of 32", "and the bits that are set in its census code")
    steady: float = tuned(
        0.05, "share of inverse depth", "and how near it must be to the median about it"
    )
    steady_px: int = tuned(
        5, "px of the rough scale", "size of that median and of the texture's window"
    )
    least_good: int = tuned(
        50, "px of the rough scale", "fewer bound nothing: every depth is tried"
    )
    least_levels: int = tuned(8, "levels of the rough volume", "never fewer are tried")
    nearest_percentile: float = tuned(
        99.8, "percentile of inverse depth", "what of the picture bounds every row"
    )
    nearest_picture: float = tuned(
        1.3, "times that inverse depth", "room for what is nearer and matched badly: time"
    )
    nearest_row: float = tuned(1.5, "times the largest of a row", "the same for each row: time")
    reach: float = tuned(
        0.08,
        "share of the picture's height",
        "things stand higher than where they are matched well",
    )
    clear_fall: float = tuned(
        0.05, "of a ray, per metre of depth", "rows whose rays fall more tell the ground's height"
    )
    low_percentile: float = tuned(
        25.0, "percentile of a row's inverse depths", "what lies low in it"
    )
    above_ground: float = tuned(
        1.5,
        "times the ground's inverse height",
        "level planes are tried up to half as high again: time",
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
    overlap_rows: int = tuned(
        16, "rows of the full picture", "of strips, for windows and paths: time alone"
    )
    margin: float = tuned(
        0.9,
        "share of the nearest inverse depth",
        "a match above it does not count: the volume's end draws what is beyond it",
        SIX,
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
    highest_1_m: float = tuned(
        0.0, "1/m", "inverse height of level planes: 0, windows in them change nothing here", SIX
    )
    finer: float = tuned(
        0.4,
        "of a level of the smaller volume",
        "what the match leaves uncertain: the sub-pixel step looks less far",
    )

    @property
    def levels(self) -> int:
        """Counts the levels of inverse depth."""
        return int(self.far_px / self.step_px) + 1


CENSUS, VOLUME, SGM, WINNER, FAR_REMATCH = Census(), Volume(), Sgm(), Winner(), FarRematch()
