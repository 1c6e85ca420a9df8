# SPDX-License-Identifier: Apache-2.0
"""What a guardian watches for, and when it acts."""

import math
from dataclasses import dataclass, field
from typing import List

import numpy as np

from fcsv_geometry.config import require_positive
from fcsv_geometry.separation import SeparationRules

NEVER = "never"
LINK_LOSS = ("land", NEVER)


@dataclass(frozen=True)
class Fence:
    """Where a vehicle may be. Heights are above the take-off place. ``radius_m`` counts from the take-off place;
    ``polygon_m`` (x, y, x, y, ... in home; empty: none) counts once home is known."""

    floor_m: float = -5.0
    ceiling_m: float = 45.0
    radius_m: float = 100.0
    polygon_m: List[float] = field(default_factory=list)

    def __post_init__(self):
        if not self.floor_m < self.ceiling_m:
            raise ValueError(f"floor_m: {self.floor_m} is not under ceiling_m {self.ceiling_m}")
        if not self.radius_m > 0:
            raise ValueError(f"radius_m: {self.radius_m} must be positive")
        if len(self.polygon_m) % 2 or 0 < len(self.polygon_m) < 6:
            raise ValueError("polygon_m: give x, y of three corners or more, or nothing")
        if not all(map(math.isfinite, self.polygon_m)):
            raise ValueError("polygon_m: holds NaN or infinity")

    def outside_m(self, from_take_off_m: np.ndarray, p_home_m=None) -> float:
        """How far (m) a place is outside, 0 inside; (3,) from the take-off place, and (3,) in home where known.

        >>> Fence(0.0, 40.0, 100.0).outside_m(np.array([0.0, 103.0, 10.0]))
        3.0
        >>> Fence(polygon_m=[0.0, 0.0, 9.0, 0.0, 0.0, 9.0]).outside_m(np.zeros(3), np.array([-2.0, 4.0, 0.0]))
        2.0
        """
        x, y, z = (float(v) for v in from_take_off_m)
        out_m = max(self.floor_m - z, z - self.ceiling_m, math.hypot(x, y) - self.radius_m, 0.0)
        if self.polygon_m and p_home_m is not None:
            out_m = max(out_m, _outside_polygon_m(np.reshape(self.polygon_m, (-1, 2)), np.asarray(p_home_m[:2], float)))
        return out_m


@dataclass(frozen=True)
class GuardianRules:
    """Times in s, shares of the battery, angles in degrees. ``link_loss`` "never" must be written: then a vehicle
    without
    its control PC holds until the battery is low."""

    feed_warn_s: float = 0.5
    feed_land_s: float = 0.8
    feed_warn_hz: float = 8.0
    feed_land_hz: float = 4.0
    apart_m: float = 0.5  # between estimate and feed, on the ground
    ekf_variance: float = 0.8  # ArduCopter's own bound, FS_EKF_THRESH
    ekf_s: float = 0.5
    confidence: float = 1.0  # T265: 0 failed, 1 low, 2 medium, 3 high; up to here is low
    confidence_hold_s: float = 1.0
    confidence_land_s: float = 4.0
    tilt_warn_deg: float = 30.0
    tilt_land_deg: float = 50.0
    tilt_s: float = 0.3
    low_battery: float = 0.2
    low_battery_s: float = 60.0  # so long the mission has to bring it down
    empty_battery: float = 0.1
    battery_s: float = 2.0  # a voltage that sags for a moment is no empty battery
    link_warn_s: float = 2.0
    link_hold_s: float = 30.0  # without the control PC: then aside and LAND
    link_loss: str = "land"
    agent_silent_s: float = 1.0
    agent_land_s: float = 15.0
    link_silent_s: float = 2.0
    throttle_middle: float = 0.25  # of the stick's way either side
    fence: Fence = field(default_factory=Fence)
    fence_land_m: float = 5.0  # further out than this: LAND
    separation: SeparationRules = field(default_factory=SeparationRules)
    clear_m: float = 2.5  # horizontally, for one to come down beside another
    uncontrolled_clear_m: float = 6.0  # likewise, of one that comes down without a position
    silent_above_s: float = 4.0  # who was above and is silent for so long may come down
    aside_s: float = 15.0  # longest way aside
    obey_s: float = 1.0  # a mode that does not show by then: the next one

    def __post_init__(self):
        require_positive(self)
        if self.link_loss not in LINK_LOSS:
            raise ValueError(f"link_loss: '{self.link_loss}' is not one of {', '.join(LINK_LOSS)}")
        for low, high in (("feed_warn_s", "feed_land_s"), ("feed_land_hz", "feed_warn_hz"),
                          ("empty_battery", "low_battery"), ("tilt_warn_deg", "tilt_land_deg")):  # fmt: skip
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low}: {getattr(self, low)} is over {high} {getattr(self, high)}")


def _outside_polygon_m(corners: np.ndarray, p: np.ndarray) -> float:
    """Distance (m) from a polygon (N, 2), 0 inside it (even-odd rule)."""
    a, b = corners, np.roll(corners, -1, axis=0)
    crosses = (a[:, 1] > p[1]) != (b[:, 1] > p[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a[:, 0] + (p[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    if int((crosses & (p[0] < x)).sum()) % 2:
        return 0.0
    ab = b - a
    s = np.clip(((p - a) * ab).sum(1) / np.maximum((ab * ab).sum(1), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(a + s[:, None] * ab - p, axis=1).min())
