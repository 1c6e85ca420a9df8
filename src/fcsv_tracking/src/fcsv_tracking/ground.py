# SPDX-License-Identifier: Apache-2.0
"""What a tracker on the ground gives mission, agent and guardian: poses in one level frame that
stands still.

``NAME/odom`` is the same frame for all vehicles, so their odometry frames coincide and a
calibration finds nothing. It is fixed once the tracker knows what is level; where it is found to
lean later, another epoch begins.
"""

import math
from dataclasses import dataclass
from typing import Optional

import numpy as np

from fcsv_geometry import transforms

# time constant of the velocity: poses of gimbals have 6 mm of noise, 8 times a second
_SPEED_S = 0.3
_GAP_S = 1.0  # after so long without a pose the velocity is found anew


@dataclass(frozen=True)
class LevelRules:
    """``sigma_deg``: how well level must be known before the frame is fixed. ``leans_deg``: then it
    is wrong."""

    sigma_deg: float = 0.2
    leans_deg: float = 2.5

    def __post_init__(self):
        if not 0.0 < self.sigma_deg < self.leans_deg < 90.0:
            raise ValueError(
                f"leans_deg: {self.leans_deg} must be over sigma_deg {self.sigma_deg}, and that over 0"
            )


class LevelFrame:
    """Its axes in the tracker's frame, and which beginning of it this is; ``offer`` whatever the
    tracker holds for level."""

    def __init__(self, rules: Optional[LevelRules] = None):
        self._rules = rules or LevelRules()
        self.T_tracker_level: Optional[np.ndarray] = None
        self.why = ""

    def offer(self, R_tracker_level: np.ndarray, sigma_rad: float) -> bool:
        """Whether a frame began with it."""
        if not (
            np.isfinite(R_tracker_level).all() and sigma_rad <= math.radians(self._rules.sigma_deg)
        ):
            return False
        if self.T_tracker_level is not None:
            cosine = float(R_tracker_level[:, 2] @ self.T_tracker_level[:3, 2])
            leans_deg = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
            if leans_deg <= self._rules.leans_deg:
                return False
            self.why = f"the tracker on the ground leans by {leans_deg:.1f} degrees: it was moved"
        else:
            self.why = "the tracker on the ground found what is level"
        self.T_tracker_level = transforms.transform(R_tracker_level, np.zeros(3))
        return True


@dataclass(frozen=True)
class GroundOdometry:
    """T_odom_body at a stamp, velocity in the body's axes (m/s); covariance (6,6) about odom's
    axes."""

    stamp_s: float
    T_odom_body: np.ndarray
    v_body_mps: np.ndarray
    covariance: np.ndarray


class GroundTrack:
    """One vehicle; ``add`` each new pose of the tracker."""

    def __init__(self):
        self._stamp_s, self._p_m = -math.inf, np.zeros(3)
        self._v_mps = np.zeros(3)

    def add(
        self,
        stamp_s: float,
        T_tracker_body: np.ndarray,
        covariance: np.ndarray,
        T_tracker_level: np.ndarray,
    ) -> Optional[GroundOdometry]:
        """None where the stamp is not after the one before."""
        gap_s = stamp_s - self._stamp_s
        if not gap_s > 0.0:
            if gap_s < -_GAP_S:  # the clock was set back
                self._stamp_s = -math.inf
            return None
        T_level_tracker = transforms.invert(T_tracker_level)
        T = T_level_tracker @ T_tracker_body
        if gap_s > _GAP_S:
            self._v_mps = np.zeros(3)
        else:
            share = 1.0 - math.exp(-gap_s / _SPEED_S)
            self._v_mps = self._v_mps + share * ((T[:3, 3] - self._p_m) / gap_s - self._v_mps)
        self._stamp_s, self._p_m = stamp_s, T[:3, 3].copy()
        turn = np.kron(np.eye(2), T_level_tracker[:3, :3])
        return GroundOdometry(stamp_s, T, T[:3, :3].T @ self._v_mps, turn @ covariance @ turn.T)

    def begin_again(self) -> None:
        """Another frame: what was is not comparable."""
        self._stamp_s, self._v_mps = -math.inf, np.zeros(3)
