# SPDX-License-Identifier: Apache-2.0
"""Whether a map rests on anything: pictures of another place give depths too, which look like a
map."""

from typing import Sequence

import numpy as np

from fcsv_stereo.errors import MatchingError
from fcsv_stereo.joint.tuning import ENOUGH_EVIDENCE
from fcsv_stereo.model import MapResult, Picture


def require_evidence(result: MapResult) -> MapResult:
    """The result back. Raises MatchingError where no picture could be compared with the reference:
    refined, or found to agree with a pose that is known better already."""
    if any(i.refined or i.inliers for i in result.images):
        return result
    others = ", ".join(i.name for i in result.images if i.name != result.reference.name)
    raise MatchingError(
        f"no map: none of {others} could be compared with {result.reference.name}: "
        + ("; ".join(result.warnings) or "do they show the same place, sharp and well exposed?")
        + ". If their poses are known to be right, map with --no-refine"
    )


def why_no_depth(reference: Picture, others: Sequence[Picture], unit_m: float = 1.0) -> str:
    """What keeps every pixel from a depth: pictures along the line of sight show too little
    parallax, else it is texture. Positions are in units of ``unit_m``."""
    view = reference.T_home_cam[:3, 2]
    ways = []
    for other in others:
        way_m = other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]
        length_m = float(np.linalg.norm(way_m))
        across_m = float(np.linalg.norm(way_m - view * (way_m @ view)))
        if across_m >= ENOUGH_EVIDENCE.least_across * length_m:
            return "too little texture"
        ways.append(
            f"{other.name} {length_m * unit_m:.3g} m, of these {across_m * unit_m:.3g} m across it"
        )
    if not ways:
        return "no other picture"
    return f"the pictures lie along the line of sight ({'; '.join(ways)}): move the camera sideways or up"
