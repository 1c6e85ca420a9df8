# SPDX-License-Identifier: Apache-2.0
"""How well a picture's pose relative to the reference picture's is known, by cause of the error."""

from dataclasses import dataclass, field
from typing import Optional

import numpy as np


def _none() -> np.ndarray:
    return np.zeros((6, 6))


@dataclass(frozen=True)
class PoseUncertainty:
    """Covariances (6x6) of a pose's errors: rotation (rad, camera axes), position (m, home axes).

    ``noise`` shrinks as more pixels are compared. ``shared`` stays however many are compared: it is
    of the scale that all poses share, and of errors that all points of a picture share
    (``refinement.systematic``). ``focal`` stays as well: it is what a wrong focal length makes of
    the pose, already weighted by ``focal_probability``, the probability that the focal length is
    wrong (``refinement.focal``). ``pixel`` is of a picture whose prior is better than what pictures
    tell: the errors that a pose from its pixels would have; None of all others.
    """

    noise: np.ndarray
    shared: np.ndarray = field(default_factory=_none)
    focal: np.ndarray = field(default_factory=_none)
    focal_probability: float = 0.0
    pixel: Optional[np.ndarray] = None

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6), of all errors.

        >>> PoseUncertainty(np.eye(6), 2 * np.eye(6)).covariance.diagonal().tolist()
        [3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
        """
        return self.noise + self.shared + self.focal
