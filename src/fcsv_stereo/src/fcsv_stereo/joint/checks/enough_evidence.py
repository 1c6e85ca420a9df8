# SPDX-License-Identifier: Apache-2.0
"""Whether a map rests on anything: pictures of another place give depths too, which look like a map."""

from fcsv_stereo.errors import MatchingError
from fcsv_stereo.model import MapResult


def require_evidence(result: MapResult) -> MapResult:
    """The result back. Raises MatchingError where no picture could be compared with the reference: refined, or found to
    agree with a pose that is known better already."""
    if any(i.refined or i.inliers for i in result.images):
        return result
    others = ", ".join(i.name for i in result.images if i.name != result.reference.name)
    raise MatchingError(
        f"no map: none of {others} could be compared with {result.reference.name}: "
        + ("; ".join(result.warnings) or "do they show the same place, sharp and well exposed?")
        + ". If their poses are known to be right, map with --no-refine"
    )
