# SPDX-License-Identifier: Apache-2.0
"""A stereo configuration: how two cameras stand to each other."""

from dataclasses import dataclass

import numpy as np

from fcsv_stereo.model.words import Axis


@dataclass(frozen=True)
class Configuration:
    """One stereo configuration: ``axis`` of the baseline (or its word), its length (m) and the
    inward tilt (rad)."""

    axis: Axis
    baseline_m: float
    tilt_rad: float = 0.0
    name: str = ""

    def __post_init__(self):
        object.__setattr__(self, "axis", Axis(self.axis))

    @classmethod
    def between(cls, T_home_reference: np.ndarray, T_home_other: np.ndarray) -> "Configuration":
        """That of two cameras as they stand (4x4 optical poses), without tilt and name.

        The axis is the larger component of the baseline in the reference's image plane.

        >>> T_home_other = np.eye(4)
        >>> T_home_other[:3, 3] = [0.3, -4.0, 0.0]
        >>> Configuration.between(np.eye(4), T_home_other).axis.value
        'vertical'
        """
        p_reference_other = T_home_reference[:3, :3].T @ (
            T_home_other[:3, 3] - T_home_reference[:3, 3]
        )
        axis = (
            Axis.HORIZONTAL
            if abs(p_reference_other[0]) >= abs(p_reference_other[1])
            else Axis.VERTICAL
        )
        return cls(axis, float(np.linalg.norm(p_reference_other)))
