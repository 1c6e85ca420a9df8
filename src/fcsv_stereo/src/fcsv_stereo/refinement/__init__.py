# SPDX-License-Identifier: Apache-2.0
"""Refinement of the poses of all pictures of a session against their priors, in one adjustment."""

from fcsv_stereo.model import PosePrior
from fcsv_stereo.refinement.features import KnownFeatures
from fcsv_stereo.refinement.refine import refine
from fcsv_stereo.refinement.types import METRIC, RefinedPicture, Refinement, RefineOptions

__all__ = [
    "KnownFeatures",
    "METRIC",
    "PosePrior",
    "RefineOptions",
    "RefinedPicture",
    "Refinement",
    "refine",
]
