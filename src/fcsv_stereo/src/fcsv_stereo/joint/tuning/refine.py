# SPDX-License-Identifier: Apache-2.0
"""Numbers of the residuals, the sub-pixel step and poses."""

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
    unlike: float = tuned(
        0.6, "of the contrast", "a difference that halves the trust: occluded, or a mismatch"
    )
    least_trust: float = tuned(0.4, "trust, 0 to 1", "from it on a pair agrees")


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
        3.0, "grey levels", "beyond it differences count less: outliers against precision", BENCH
    )
    same_steps: float = tuned(
        0.7, "levels of the volume", "still one surface: noise against small steps"
    )
    prior_share: float = tuned(
        0.02, "of the information about it", "by which a pixel without texture stays where it is"
    )


@dataclass(frozen=True)
class PoseAlignment(Tuned):
    """``refine.pose_alignment``."""

    cell_px: int = tuned(
        4, "px of this scale", "one correction of inverse depth each: detail against time", BENCH
    )
    correlated: float = tuned(
        8.0, "px", "that count as one: interpolation, blur, cells that straddle surfaces", BENCH
    )
    loose: float = tuned(
        3.0, "share of inverse depth", "prior sigma of a cell: one without texture keeps its own"
    )
    farthest_1_m: float = tuned(1e-3, "1/m", "as good as infinite, for that prior")
    loosened_turns: float = tuned(
        3.0,
        "times the sigma given",
        "features err alike in every picture, which covariances of each cannot say; nor "
        "are they other evidence than the pixels",
        BENCH,
    )


RESIDUALS, PLANE_FIT = ResidualTuning(), PlaneFit()
SUBPIXEL, POSE_ALIGNMENT = Subpixel(), PoseAlignment()
