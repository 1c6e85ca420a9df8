# SPDX-License-Identifier: Apache-2.0
"""Whether the pictures contradict the focal length that they came with, and what a wrong one makes
of the poses.

A focal length is either right or off by some ANY_FOCAL. Which, is told by how likely both make the
pictures. What they leave open is in the poses' covariance: yaw follows a wrong focal length, and
moves all disparities of a pair.

Cameras that look the same way and stand beside each other do not tell it, however many they are: a
scale of the picture's plane is one of all depths. Two pictures do where their axes are neither
parallel nor meet as far from the one as from the other (Sturm, "On focal length calibration from
two views", 2001); where they do meet so, the prior of the rotation tells it. ``unseen`` says what
they leave open.
"""

from dataclasses import dataclass, replace
from typing import Dict, Optional, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.refinement.adjust import AdjustedPoses, adjust
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.systematic import systematic
from fcsv_stereo.refinement.types import ANY_FOCAL

_LEAST = 0.015  # a smaller change moves depth by less than poses do
# that it is wrong, before the pictures tell: data sheets and EXIF tags are off by per cents
_ODDS = 0.25
# the same, where the pictures contradict the poses of all of them at once
_ODDS_IF_CONTRADICTED = 1.0
# by how much wrong ones are off: shares of them, and standard deviations
Wrong = Tuple[Tuple[float, float], ...]
_BY_PER_CENTS: Wrong = ((1.0, ANY_FOCAL),)
# some are of another lens or size of picture
_OTHER_LENS: Wrong = ((0.85, ANY_FOCAL), (0.15, 0.15))
# probabilities, for a warning: a single pair shows 5 % by 2 to 3 standard deviations
_PERHAPS, _LIKELY = 0.35, 0.6
_SURE = 5.0  # standard deviations, to take it
_KNOWN = 0.01  # share to which several pictures tell it
# from this standard deviation on the pictures add nothing to what was known before
_NOTHING = 0.9 * ANY_FOCAL
# two pictures turned towards each other by so much show 5 % off in all draws
# (docs/lab/refinement.md)
_TURN_DEG = 20


@dataclass(frozen=True)
class FocalFit:
    """The focal length that fits best: ``change`` of the given one and its standard deviation,
    shares.

    ``probability`` is that the given one is wrong. ``if_left`` (6n, 6n) is what is to be added to
    the covariance of the adjusted poses where it is left, in their order and axes.
    """

    change: float
    sigma: float
    probability: float
    if_left: np.ndarray
    wrong: Wrong = _OTHER_LENS

    @property
    def known(self) -> bool:
        """Well enough to take it."""
        return self.sigma <= _KNOWN and self.evident

    @property
    def evident(self) -> bool:
        """Whether the given one is beyond doubt wrong, however well the right one is known."""
        return abs(self.change) >= max(_LEAST, _SURE * self.sigma)

    @property
    def unseen(self) -> str:
        """What the pictures would not show; empty where they would show a focal length that is
        wrong by ANY_FOCAL.

        They would where one that comes out a standard deviation too near to the given one is still
        said.
        """
        least = max(ANY_FOCAL - self.sigma, 0.0)
        if self.words or replace(self, change=least, probability=self._beforehand(least)).words:
            return ""
        known = f"is known from these pictures to +-{self.sigma:.1%} only"
        how = known if self.sigma < _NOTHING else "cannot be known from these pictures"
        return (
            f"Whether the focal length is right {how}: one that is {ANY_FOCAL:.0%} wrong makes depths wrong by as much "
            "and may show nowhere. A calibration tells it, or a picture whose view is turned by "
            f"{_TURN_DEG} degrees against the others'."
        )

    def _beforehand(self, change: float) -> float:
        """Probability that the given one is wrong, where the pictures would fit that change."""
        return _doubt(change, self.sigma, _ODDS, self.wrong)[0]

    @property
    def words(self) -> str:
        """What the pictures say; empty where they say nothing against the given one."""
        if abs(self.change) < max(_LEAST, self.sigma) or self.probability < _PERHAPS:
            return ""
        which = "longer" if self.change > 0 else "shorter"
        fit = "fit" if self.probability >= _LIKELY else "perhaps fit"
        length = f"{abs(self.change):.1%} {which} than the given one (+-{self.sigma:.1%})"
        return f"the pictures {fit} a focal length {length}"


def focal_fit(
    consensus: Consensus,
    cameras: Dict[int, PinholeCamera],
    contradicted: bool = False,
    other_lens: bool = True,
) -> Optional[FocalFit]:
    """None where nothing was adjusted, or the focal length was refined; ``cameras`` (by picture)
    are the features', ``contradicted``: the pictures contradict the poses of all of them.
    ``other_lens``: as RefineOptions has it.

    One more adjustment from the poses that were found, with the focal length free. Three pictures
    or more tell it well (0.2 % in a town), a single pair hardly (2 %). The probability is by the
    ratio of densities at no change, beforehand and by the pictures (Savage and Dickey's ratio).
    """
    found, problem = consensus.adjusted, consensus.problem
    if found is None or problem is None or problem.focal_sigma > 0.0:
        return None
    loose = replace(problem, focal_sigma=ANY_FOCAL)
    free = adjust(loose, found.poses, found.rho)
    change, sigma = fitted(replace(consensus, adjusted=free, problem=loose), cameras)
    wrong = _OTHER_LENS if other_lens or contradicted else _BY_PER_CENTS
    probability, square = _doubt(
        change, sigma, _ODDS_IF_CONTRADICTED if contradicted else _ODDS, wrong
    )
    step = _looks_like(free)
    return FocalFit(change, sigma, probability, probability * square * np.outer(step, step), wrong)


def fitted(consensus: Consensus, cameras: Dict[int, PinholeCamera]) -> Tuple[float, float]:
    """Change of the focal length that was adjusted, and its standard deviation, shares."""
    free = consensus.adjusted
    fields = systematic(consensus, cameras)
    return free.focal_scale - 1.0, min(
        float(np.hypot(free.focal_sigma, fields.focal_sigma)), ANY_FOCAL
    )


def _doubt(change: float, sigma: float, odds: float, wrong: Wrong) -> Tuple[float, float]:
    """Probability that the given one is wrong, and the mean square of the change if it is, where
    the pictures fit ``change +- sigma`` with ANY_FOCAL beforehand.

    With one standard deviation of wrong ones it is Savage and Dickey's ratio:

    >>> [round(x, 4) for x in _doubt(0.0, ANY_FOCAL, 0.25, _BY_PER_CENTS)]
    [0.2, 0.0025]
    """
    told = max(sigma**-2 - ANY_FOCAL**-2, 0.0)
    favours, squares = [], []
    for share, usual in wrong:
        variance = 1.0 / (told + usual**-2)
        mean = change / sigma**2 * variance
        favours.append(share * variance**0.5 / usual * np.exp(min(0.5 * mean**2 / variance, 500.0)))
        squares.append(mean**2 + variance)
    favour = odds * float(np.sum(favours))
    return favour / (1.0 + favour), float(np.average(squares, weights=favours))


def _looks_like(free: AdjustedPoses) -> np.ndarray:
    """(6n,) by how much wrong poses look as the given focal length does, per share that it is off.

    The poses follow it (``by_focal``). A turn about x or y by an angle a shifts a picture by f a: a
    focal length that is off does to a picture that is turned what another turn does, and to one
    that is moved across what a scale does.
    """
    direct = [
        [*Rotation.from_matrix(T[:3, :3]).as_rotvec()[:2], 0.0, *(T[:3, :3].T @ T[:3, 3])[:2], 0.0]
        for T in (free.poses[k] for k in free.order)
    ]
    return free.by_focal + np.ravel(direct)
