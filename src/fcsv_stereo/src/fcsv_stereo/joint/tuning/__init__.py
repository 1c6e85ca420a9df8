# SPDX-License-Identifier: Apache-2.0
"""Every number of ``joint`` that was tuned, by stage: unit, what it trades, on what it was chosen,
how far it matters.

``python -m fcsv_stereo.joint.tuning`` prints the table. Nothing below this package is imported by
it.

Scales: *full* is the reference picture's size, *this scale* that of the stage (0.3 of it at the
rough match, 0.6 in the volume, 0.77 between, 1 at last, at 640x480), *coarser* the scale before.
*Fastest* is the pair in which pixels move most with inverse depth. A *volume unit* is a tenth of a
bit of the census code's 32.
"""

from fcsv_stereo.joint.tuning.bars import BARS, Bars
from fcsv_stereo.joint.tuning.checks import (
    AXIS_CONFLICT,
    ENOUGH_EVIDENCE,
    MOVED,
    RELIABILITY,
    SIGMA,
    SKY,
    VISIBILITY,
)
from fcsv_stereo.joint.tuning.evidence import EVIDENCE
from fcsv_stereo.joint.tuning.matching import MATCH, PAIRS, VIEWS
from fcsv_stereo.joint.tuning.recorded import (
    REFERENCE_FOCAL_PX,
    REFERENCE_SIZE_PX,
    Tuned,
    beyond_reference,
    table,
)
from fcsv_stereo.joint.tuning.refine import PLANE_FIT, POSE_ALIGNMENT, RESIDUALS, SUBPIXEL
from fcsv_stereo.joint.tuning.shared import (
    FARTHEST_1_M,
    LEAST_INFORMATION,
    LEAST_LEVELS,
    LEAST_WEIGHT,
    NO_BASELINE_M,
    SCALE_HELD,
    SHARED,
    WRONG,
)
from fcsv_stereo.joint.tuning.surfaces import CANDIDATES, COLOUR, DATA_COST, SELECT, THIN_UPRIGHTS
from fcsv_stereo.joint.tuning.volume import CENSUS, FAR_REMATCH, SGM, VOLUME, WINNER

STAGES = (
    SHARED,
    VIEWS,
    MATCH,
    PAIRS,
    CENSUS,
    VOLUME,
    SGM,
    WINNER,
    FAR_REMATCH,
    CANDIDATES,
    COLOUR,
    DATA_COST,
    THIN_UPRIGHTS,
    SELECT,
    RESIDUALS,
    PLANE_FIT,
    SUBPIXEL,
    POSE_ALIGNMENT,
    RELIABILITY,
    SIGMA,
    SKY,
    MOVED,
    AXIS_CONFLICT,
    ENOUGH_EVIDENCE,
    VISIBILITY,
    EVIDENCE,
    BARS,
)

__all__ = [
    "AXIS_CONFLICT",
    "BARS",
    "Bars",
    "CANDIDATES",
    "CENSUS",
    "COLOUR",
    "DATA_COST",
    "ENOUGH_EVIDENCE",
    "EVIDENCE",
    "FARTHEST_1_M",
    "FAR_REMATCH",
    "LEAST_INFORMATION",
    "LEAST_LEVELS",
    "LEAST_WEIGHT",
    "MATCH",
    "MOVED",
    "NO_BASELINE_M",
    "PAIRS",
    "PLANE_FIT",
    "POSE_ALIGNMENT",
    "REFERENCE_FOCAL_PX",
    "REFERENCE_SIZE_PX",
    "RELIABILITY",
    "RESIDUALS",
    "SCALE_HELD",
    "SELECT",
    "SGM",
    "SHARED",
    "SIGMA",
    "SKY",
    "STAGES",
    "SUBPIXEL",
    "THIN_UPRIGHTS",
    "Tuned",
    "VIEWS",
    "VISIBILITY",
    "VOLUME",
    "WINNER",
    "WRONG",
    "beyond_reference",
    "table",
]
