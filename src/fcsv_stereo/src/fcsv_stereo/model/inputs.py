# SPDX-License-Identifier: Apache-2.0
"""What a mapping method starts from, whatever it was read from."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, List, Mapping, Optional, Sequence

import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.model.configuration import Configuration
from fcsv_stereo.model.pictures import Picture
from fcsv_stereo.model.words import InputKind

#: Of what is in home's own coordinates.
NO_SHIFT = np.zeros(3)
#: Of the cameras' median distance from the reference: what a position errs by whose metres nobody
#: stated.
_ASSUMED_SHARE = 0.005


@dataclass(frozen=True)
class PosePrior:
    """Standard deviations, per axis, of a picture's prior pose relative to the reference's.

    The position's is ``position_m`` plus, in quadrature, ``position_share`` of the distance from
    the reference; these errors count as independent. ``position_m`` None: nobody stated metres, and
    half a per cent of the median distance of all cameras from the reference takes its place
    (``in_scene``), whatever the unit of length. ``scale_sigma`` is of one scale (a share) that all
    positions have in common besides: no picture tells it, so that it stays in every depth however
    many pictures there are.
    """

    rotation_rad: float = float(np.radians(0.3))
    position_m: Optional[float] = None
    position_share: float = 0.01
    scale_sigma: float = 0.0

    def __post_init__(self):
        if not 0.0 < self.rotation_rad <= np.pi or not np.isfinite(self.rotation_rad):
            raise InputError(
                f"prior of rotation is {self.rotation_rad} rad; it must lie in 0 to pi"
            )
        shares = (
            _ASSUMED_SHARE if self.position_m is None else self.position_m,
            self.position_share,
        )
        if not np.isfinite(shares).all() or min(shares) < 0.0 or max(shares) <= 0.0:
            raise InputError(
                f"prior of position is {self.position_m} m and {self.position_share} of the distance"
            )
        if not 0.0 <= self.scale_sigma < 1.0:
            raise InputError(
                f"scale_sigma is {self.scale_sigma}; it is a share of the scale, 0 to below 1"
            )

    def position_sigma_m(self, distance_m: float) -> float:
        """Per axis, at a distance from the reference.

        >>> PosePrior(position_m=0.03, position_share=0.01).position_sigma_m(4.0)
        0.05
        """
        position_m = _ASSUMED_SHARE * distance_m if self.position_m is None else self.position_m
        return float(np.hypot(position_m, self.position_share * distance_m))

    def in_scene(self, distances_m: Sequence[float]) -> "PosePrior":
        """Gives the prior with ``position_m`` for cameras at these distances (m) from the
        reference, where nobody stated it.

        >>> PosePrior().in_scene([0.2, 0.4, 2.0]).position_m, PosePrior(position_m=0.15).in_scene([0.2]).position_m
        (0.002, 0.15)
        """
        if self.position_m is not None:
            return self
        return replace(self, position_m=_ASSUMED_SHARE * float(np.median(distances_m)))

    def in_unit(self, unit_m: float) -> "PosePrior":
        """The same with lengths in units of ``unit_m``."""
        return (
            self if self.position_m is None else replace(self, position_m=self.position_m / unit_m)
        )


@dataclass(frozen=True)
class ConfigurationInput:
    """Pictures of one configuration, in order of time: of the reference camera and of the other
    one."""

    configuration: Configuration
    references: List[Picture]
    others: List[Picture]


#: Of a flight whose session does not say how good its poses are: the calibration's few centimetres,
#: and one per cent of the way flown since by both.
FLOWN = PosePrior(position_m=0.15)

#: Of two cameras that are mounted on one bar and were calibrated as a stereo rig.
RIG = PosePrior(float(np.radians(0.01)), 0.0, 0.001)


@dataclass(frozen=True)
class MapInput:
    """``kind`` (or its word) says what poses there can be. ``rig`` says why the pictures are of a
    calibrated rig, where something states it; empty: nothing does.

    ``prior`` says how good the poses of pictures without a covariance are, where that is known
    better than the method assumes. Its ``scale_sigma`` is of all positions, also of those whose
    pictures have a covariance.
    """

    kind: InputKind
    configurations: List[ConfigurationInput]
    truth_folder: Optional[Path] = None
    warnings: List[str] = field(default_factory=list)
    prior: Optional[PosePrior] = None
    # of sweeps, by vehicle (sweeps.ClockOffset)
    clocks: Mapping[str, Any] = field(default_factory=dict)
    # frames of depth cameras (sessions.RecordedDepth); None: none were recorded
    near: Optional[Any] = None
    # (3,): poses plus this are in home (local_origin)
    origin_m: np.ndarray = field(default_factory=NO_SHIFT.copy)
    rig: str = ""
    # where on the earth (sessions.SessionGps); None: nothing says it
    gps: Optional[Any] = None

    def __post_init__(self):
        object.__setattr__(self, "kind", InputKind(self.kind))
