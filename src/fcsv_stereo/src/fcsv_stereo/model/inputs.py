# SPDX-License-Identifier: Apache-2.0
"""What a mapping method starts from, whatever it was read from."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, List, Mapping, Optional

import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.model.configuration import Configuration
from fcsv_stereo.model.pictures import Picture
from fcsv_stereo.model.words import InputKind

#: Of what is in home's own coordinates.
NO_SHIFT = np.zeros(3)


@dataclass(frozen=True)
class PosePrior:
    """Standard deviations, per axis, of a picture's prior pose relative to the reference's.

    The position's is ``position_m`` plus, in quadrature, ``position_share`` of the distance from the reference; these
    errors count as independent. ``scale_sigma`` is of one scale (a share) that all positions have in common besides:
    no picture tells it, so that it stays in every depth however many pictures there are.
    """

    rotation_rad: float = float(np.radians(0.3))
    position_m: float = 0.02
    position_share: float = 0.01
    scale_sigma: float = 0.0

    def __post_init__(self):
        if not 0.0 < self.rotation_rad <= np.pi or not np.isfinite(self.rotation_rad):
            raise InputError(f"prior of rotation is {self.rotation_rad} rad; it must lie in 0 to pi")
        shares = (self.position_m, self.position_share)
        if not np.isfinite(shares).all() or min(shares) < 0.0 or max(shares) <= 0.0:
            raise InputError(f"prior of position is {self.position_m} m and {self.position_share} of the distance")
        if not 0.0 <= self.scale_sigma < 1.0:
            raise InputError(f"scale_sigma is {self.scale_sigma}; it is a share of the scale, 0 to below 1")

    def position_sigma_m(self, distance_m: float) -> float:
        """Per axis, at a distance from the reference.

        >>> PosePrior(position_m=0.03, position_share=0.01).position_sigma_m(4.0)
        0.05
        """
        return float(np.hypot(self.position_m, self.position_share * distance_m))


@dataclass(frozen=True)
class ConfigurationInput:
    """Pictures of one configuration, in order of time: of the reference camera and of the other one."""

    configuration: Configuration
    references: List[Picture]
    others: List[Picture]


#: Of a flight whose session does not say how good its poses are: the calibration's few centimetres, and one per cent
#: of the way flown since by both.
FLOWN = PosePrior(position_m=0.15)


@dataclass(frozen=True)
class MapInput:
    """``kind`` (or its word) says what poses there can be.

    ``prior`` says how good the poses of pictures without a covariance are, where that is known better than the method
    assumes. Its ``scale_sigma`` is of all positions, also of those whose pictures have a covariance.
    """

    kind: InputKind
    configurations: List[ConfigurationInput]
    truth_folder: Optional[Path] = None
    warnings: List[str] = field(default_factory=list)
    prior: Optional[PosePrior] = None
    clocks: Mapping[str, Any] = field(default_factory=dict)  # of sweeps, by vehicle (sweeps.ClockOffset)
    near: Optional[Any] = None  # frames of depth cameras (sessions.RecordedDepth); None: none were recorded
    origin_m: np.ndarray = field(default_factory=NO_SHIFT.copy)  # (3,): poses plus this are in home (local_origin)

    def __post_init__(self):
        object.__setattr__(self, "kind", InputKind(self.kind))
