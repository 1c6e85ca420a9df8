# SPDX-License-Identifier: Apache-2.0
"""Whether a map rests on anything: a picture of another place gives depths too, only none that is known well."""

import numpy as np

from fcsv_stereo.errors import MatchingError
from fcsv_stereo.joint.tuning import ENOUGH_EVIDENCE
from fcsv_stereo.model import MapResult


def require_evidence(result: MapResult) -> MapResult:
    """The result back. Raises MatchingError where no pose could be refined and next to nothing is known besides."""
    known = np.isfinite(result.depth) & (result.sigma < ENOUGH_EVIDENCE.known * result.depth)
    if known.mean() >= ENOUGH_EVIDENCE.least_share or any(i.refined for i in result.images):
        return result
    raise MatchingError(
        f"{result.reference.name}: no map, since no other picture could be compared with it: "
        + ("; ".join(result.warnings) or "do they show the same place, sharp and well exposed?")
    )
