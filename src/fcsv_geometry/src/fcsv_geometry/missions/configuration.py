# SPDX-License-Identifier: Apache-2.0
"""One configuration of a mission's list: axis, baseline and tilt of the pictures, or a sweep."""

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence

import numpy as np

from fcsv_geometry.missions.sweep import AXES, MOST_BASELINE_M, Sweep

_RECORD_S = (0.5, 600.0)
_MOST_PICTURES = 1000
_MOST_FOLLOW_S = 3600.0
_MOST_TILT_DEG = 30.0


@dataclass(frozen=True)
class StereoConfiguration:
    """One place of the moving camera: right of the reference (horizontal) or above it (vertical).

    ``tilt_deg`` turns it inward: for a horizontal baseline by yaw to the left. A vertical baseline
    would need pitch down, which a fixed camera on a hovering multirotor cannot have; so there it
    must be 0.

    With ``sweep`` it is no place but a way, along which pictures are taken without a stop; ``axis``
    and ``baseline_m`` (the longest) are then the sweep's.
    """

    # must be given but for a sweep; horizontal: to the right of the reference, vertical: above it
    axis: str = ""
    baseline_m: float = math.nan  # must be given but for a sweep; between both cameras
    tilt_deg: float = 0.0  # inwards, of horizontal baselines
    record_s: float = 5.0  # so long pictures are taken
    # of each vehicle; a slow camera is waited for, up to four times ``record_s``
    least_pictures: int = 6
    name: Optional[str] = None  # in reports and messages; default: axis and baseline
    vehicle: Optional[str] = None  # who moves; default: the first that is not the reference
    # flown and recorded at the same time as the one before, by another vehicle
    at_once: bool = False
    sweep: Optional[Sweep] = None  # a way in place of a place
    # vehicles hold there and go where `/mission/follow` asks, for so long at most (s); nothing is
    # recorded, and all land where they are: only of the last one that is flown
    follow_s: Optional[float] = None
    # beside ``follow_s``: afterwards all go back to the column, and land there
    returns: bool = False
    # of the mission's viewpoints; 0: home. Left out: ``stations`` say it
    view: int = 0

    def __post_init__(self):
        self._check_following()
        if self.sweep is not None:
            self._apply_sweep(self.sweep)
        for name, missing in (
            ("axis", self.axis == ""),
            ("baseline_m", math.isnan(self.baseline_m)),
        ):
            if missing:
                raise ValueError(f"{name}: is missing")
        if self.axis not in AXES:
            raise ValueError(f"axis: '{self.axis}' is not one of {', '.join(AXES)}")
        if not self.baseline_m > 0:
            raise ValueError(
                f"baseline_m: {self.baseline_m} must be positive; the axis says the direction"
            )
        if self.baseline_m > MOST_BASELINE_M:
            raise ValueError(
                f"baseline_m: {self.baseline_m} is over {MOST_BASELINE_M:g} m; give metres"
            )
        if not _RECORD_S[0] <= self.record_s <= _RECORD_S[1]:
            raise ValueError(
                f"record_s: {self.record_s} is not in {_RECORD_S[0]:g}..{_RECORD_S[1]:g} s"
            )
        if not 1 <= self.least_pictures <= _MOST_PICTURES:
            raise ValueError(f"least_pictures: {self.least_pictures} is not in 1..{_MOST_PICTURES}")
        if abs(self.tilt_deg) > _MOST_TILT_DEG:
            raise ValueError(
                f"tilt_deg: {self.tilt_deg} is beyond {_MOST_TILT_DEG:g} degrees; the pictures would hardly overlap"
            )
        if self.axis == "vertical" and self.tilt_deg:
            raise ValueError(
                "tilt_deg: a hovering multirotor cannot pitch a fixed camera; set it to 0 for vertical"
            )

    def _check_following(self) -> None:
        if self.follow_s is None:
            if self.returns:
                raise ValueError(
                    "returns: is for vehicles that follow; give follow_s, or leave it out"
                )
            return
        if not 0.0 < self.follow_s <= _MOST_FOLLOW_S:
            raise ValueError(
                f"follow_s: {self.follow_s} must be positive and at most {_MOST_FOLLOW_S:g} s"
            )
        for name in ("sweep", "record_s", "least_pictures", "at_once"):
            if getattr(self, name) != getattr(StereoConfiguration, name):
                raise ValueError(
                    f"{name}: beside follow_s, where all hold and nothing is recorded; leave it out"
                )

    def _apply_sweep(self, sweep: Sweep) -> None:
        if self.axis not in ("", sweep.axis):
            raise ValueError(f"axis: '{self.axis}' is not that of the sweep; leave it out")
        if not (
            math.isnan(self.baseline_m)
            or math.isclose(self.baseline_m, sweep.longest_m, abs_tol=1e-6)
        ):
            raise ValueError(
                f"baseline_m: {self.baseline_m} is beside a sweep, which has no single one; leave it out"
            )
        if self.record_s != StereoConfiguration.record_s:
            raise ValueError("record_s: a sweep is recorded for as long as it flies; leave it out")
        object.__setattr__(self, "axis", sweep.axis)
        object.__setattr__(self, "baseline_m", sweep.longest_m)

    @property
    def title(self) -> str:
        """Its name, or what it is in words."""
        if self.sweep is not None:
            return self.name or self.sweep.title
        tilt = f" tilt {self.tilt_deg:g} deg" if self.tilt_deg else ""
        return self.name or f"{self.axis} {self.baseline_m:g} m{tilt}"

    @property
    def stands_s(self) -> float:
        """How long (s) vehicles stay once they are there: to be recorded, or to follow at most."""
        return self.record_s if self.follow_s is None else self.follow_s

    @property
    def tilt_rad(self) -> float:
        """Inward tilt (rad)."""
        return float(np.radians(self.tilt_deg))


def moment_of(configurations: Sequence[StereoConfiguration], index: int) -> List[int]:
    """Indices of the configurations that are flown at the same time as ``index``, with it."""
    first, last = index, index + 1
    while configurations[first].at_once:
        first -= 1
    while last < len(configurations) and configurations[last].at_once:
        last += 1
    return list(range(first, last))
