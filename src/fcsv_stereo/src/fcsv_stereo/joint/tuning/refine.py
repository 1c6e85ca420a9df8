# SPDX-License-Identifier: Apache-2.0
"""Numbers of the residuals, the sub-pixel step, exposures and poses."""

from dataclasses import dataclass

from fcsv_stereo.joint.tuning.recorded import BENCH, Tuned, tuned


@dataclass(frozen=True)
class ResidualTuning(Tuned):
    """``refine.residuals``, and what counts as agreement with a picture."""

    mean_sigma_px: float = tuned(
        5.0,
        "px of this scale",
        "brightness over wider distances is no contrast, nor do poses follow it",
    )
    mean_px: int = tuned(
        17,
        "px of this scale",
        "differences over wider distances do not count: exposures differ; as wide as the above",
    )
    exposure_grey: float = tuned(
        10.0,
        "grey levels",
        "a difference that halves its part in that mean: another surface",
        BENCH,
    )
    window_px: int = tuned(5, "px of this scale", "what likeness is told by: noise against edges")
    noise_grey: float = tuned(
        1.5, "grey levels", "contrast below it tells nothing: more of it trusts plain places"
    )
    unlike: float = tuned(
        0.6, "of the contrast", "a difference that halves the trust: occluded, or a mismatch"
    )
    least_trust: float = tuned(0.4, "trust, 0 to 1", "from it on a pair agrees")
    band_rows: int = tuned(64, "rows of this scale", "time alone")


@dataclass(frozen=True)
class ExposureTuning(Tuned):
    """``refine.exposure``."""

    least_pixels: int = tuned(
        200, "px of the volume's scale", "with fewer that agree an exposure stays as it is"
    )
    most_gain: float = tuned(2.0, "times", "the census has room for no more")


@dataclass(frozen=True)
class PlaneFit(Tuned):
    """``refine.plane_fit``."""

    radius_px: int = tuned(3, "px of this scale", "planes of 7x7: noise against small things")
    stiffness: float = tuned(
        0.05,
        "px squared, times the information",
        "windows of one row or a few pixels have no slope of their own",
    )


@dataclass(frozen=True)
class Subpixel(Tuned):
    """``refine.subpixel``."""

    huber_grey: float = tuned(
        4.0, "grey levels", "beyond it differences count less: outliers against precision"
    )
    same_steps: float = tuned(
        0.7, "levels of the volume", "still one surface: noise against small steps"
    )
    same: float = tuned(0.02, "share of inverse depth", "and by this besides")
    prior_share: float = tuned(
        0.02, "of the information about it", "by which a pixel without texture stays where it is"
    )
    prior_px: int = tuned(7, "px of this scale", "window of that information")
    prior_least: float = tuned(
        1e-6, "grey levels squared times metres squared", "keeps plain pictures finite"
    )


@dataclass(frozen=True)
class PoseAlignment(Tuned):
    """``refine.pose_alignment``."""

    cell_px: int = tuned(
        4, "px of this scale", "one correction of inverse depth each: detail against time", BENCH
    )
    huber_grey: float = tuned(3.0, "grey levels", "beyond it differences count less", BENCH)
    contrast_px: int = tuned(5, "px of this scale", "what likeness is told by", BENCH)
    unlike: float = tuned(
        0.6,
        "of the contrast",
        "a difference that halves the weight: occluded, or a mismatch",
        BENCH,
    )
    noise_grey: float = tuned(1.5, "grey levels", "contrast below it tells nothing", BENCH)
    correlated: float = tuned(
        8.0, "px", "that count as one: interpolation, blur, cells that straddle surfaces", BENCH
    )
    least_cells: int = tuned(200, "cells", "with fewer that are known poses stay as they are")
    most_cells: int = tuned(
        20000, "cells", "of a large picture, evenly spread: precision against time"
    )
    loose: float = tuned(
        3.0, "share of inverse depth", "prior sigma of a cell: one without texture keeps its own"
    )
    farthest_1_m: float = tuned(1e-3, "1/m", "as good as infinite, for that prior")
    scale_held: float = tuned(
        1e-5, "share of the scale", "by which it may change: noise in the slopes pulls it"
    )
    loosened_turns: float = tuned(
        3.0,
        "times the sigma given",
        "features err alike in every picture, which covariances of each cannot say; nor "
        "are they other evidence than the pixels",
        BENCH,
    )
    outlier: float = tuned(
        3.0, "medians", "a cell that changes by more has no part in the smooth change"
    )
    energy_least: float = tuned(0.1, "grey levels squared", "variance of pictures without noise")
    weight_least: float = tuned(1e-3, "of the mean weight", "keeps cells without texture finite")


RESIDUALS, EXPOSURE, PLANE_FIT, SUBPIXEL, POSE_ALIGNMENT = (
    ResidualTuning(),
    ExposureTuning(),
    PlaneFit(),
    Subpixel(),
    PoseAlignment(),
)
