# SPDX-License-Identifier: Apache-2.0
"""Whether the pictures contradict the focal length that they came with."""

from dataclasses import replace

from fcsv_stereo.refinement.adjust import adjust
from fcsv_stereo.refinement.consensus import Consensus

_ANY_FOCAL = 0.05  # share by which a focal length may well be wrong: from a data sheet, of a lens at another zoom
_LEAST = 0.015  # a smaller change moves depth by less than poses do
_SURE = 5.0  # standard deviations


def focal_warning(consensus: Consensus) -> str:
    """One sentence where another focal length fits the pictures far better; empty where not, or where it was refined.

    One more adjustment from the poses that were found, with the focal length free. Three pictures or more tell it well
    (0.2 % in a town), a single pair hardly (2 %).
    """
    found, problem = consensus.adjusted, consensus.problem
    if found is None or problem is None or problem.focal_sigma > 0.0:
        return ""
    free = adjust(replace(problem, focal_sigma=_ANY_FOCAL), found.poses, found.rho)
    change = free.focal_scale - 1.0
    if abs(change) < max(_LEAST, _SURE * free.focal_sigma):
        return ""
    return (
        f"the pictures fit a focal length {abs(change):.1%} {'longer' if change > 0 else 'shorter'} than the given one"
        f" (+-{free.focal_sigma:.1%}): calibrate the camera, or map with --refine-focal"
    )
