# SPDX-License-Identifier: Apache-2.0
"""Whether the pictures contradict the focal length that they came with."""

from dataclasses import dataclass, replace
from typing import Optional

from fcsv_stereo.refinement.adjust import adjust
from fcsv_stereo.refinement.consensus import Consensus

ANY_FOCAL = 0.05  # share by which a focal length may well be wrong: from a data sheet, of a lens at another zoom
_LEAST = 0.015  # a smaller change moves depth by less than poses do
_SAID, _SURE = 3.0, 5.0  # standard deviations: for a warning, and to take it
_KNOWN = 0.01  # share to which several pictures tell it


@dataclass(frozen=True)
class FocalFit:
    """The focal length that fits far better than the given one: ``change`` of it and its standard deviation, shares."""

    change: float
    sigma: float

    @property
    def known(self) -> bool:
        """Well enough to take it."""
        return self.sigma <= _KNOWN and abs(self.change) >= _SURE * self.sigma

    @property
    def words(self) -> str:
        """What the pictures say."""
        which = "longer" if self.change > 0 else "shorter"
        return f"the pictures fit a focal length {abs(self.change):.1%} {which} than the given one (+-{self.sigma:.1%})"


def better_focal(consensus: Consensus) -> Optional[FocalFit]:
    """None where the given one fits, or it was refined.

    One more adjustment from the poses that were found, with the focal length free. Three pictures or more tell it well
    (0.2 % in a town), a single pair hardly (2 %).
    """
    found, problem = consensus.adjusted, consensus.problem
    if found is None or problem is None or problem.focal_sigma > 0.0:
        return None
    free = adjust(replace(problem, focal_sigma=ANY_FOCAL), found.poses, found.rho)
    fit = FocalFit(free.focal_scale - 1.0, free.focal_sigma)
    return fit if abs(fit.change) >= max(_LEAST, _SAID * fit.sigma) else None
