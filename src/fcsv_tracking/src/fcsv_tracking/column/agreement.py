# SPDX-License-Identifier: Apache-2.0
"""How far the vehicles of a column may have drifted apart since they were calibrated, and whether a
new calibration agrees with what their trackers said.

    T_Dp_Dc = inv(T_Op_Dp) T_Op_Oc T_Oc_Dc

The link T_Op_Oc brings its own covariance, the bodies' places those of their drift since then; all
frames are taken level, errors are of x, y, z and yaw (fcsv_geometry.home.Place).
"""

from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_geometry import chi_squared, rotations, transforms
from fcsv_geometry.home import OdomLink, Place
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_tracking.column.drift import Drift

#: Of so many sigmas (x, y, z and yaw together) one calibration in 10,000 differs by chance.
MOST_SIGMAS = float(np.sqrt(chi_squared.quantile(0.9999, 4)))
#: Beyond it (m) no sigma explains a difference: the column keeps its separation by trackers.
MOST_M = 1.0
_EXACT = np.zeros((4, 4))


@dataclass(frozen=True)
class Difference:
    """How far a new link is from what the trackers said: of the child's body, seen from the parent's (m,
    rad); ``sigmas``: as a multiple of what calibrations and drift explain."""

    parent: str
    child: str
    distance_m: float
    yaw_rad: float
    sigmas: float

    @property
    def drifted(self) -> bool:
        """Whether a tracker drifts beyond what is known of it."""
        return self.sigmas > MOST_SIGMAS or self.distance_m > MOST_M

    def __str__(self) -> str:
        """
        >>> str(Difference("uav1", "uav2", 0.123, 0.0, 1.04))
        'uav2 is 0.12 m and 0.0 deg off uav1 (1.0 sigma)'
        """
        turned_deg = abs(np.degrees(self.yaw_rad))
        off = f"{self.distance_m:.2f} m and {turned_deg:.1f} deg off {self.parent}"
        return f"{self.child} is {off} ({self.sigmas:.1f} sigma)"


class ColumnDrift:
    """The drift of vehicles against each other since ``calibrate``."""

    def __init__(self, vehicles: Sequence[str], tracker: TrackerProfile = T265_PROFILE):
        self._drifts = {n: Drift(tracker) for n in vehicles}
        self._bodies: Dict[str, np.ndarray] = {}  # T_odom_body, level
        self._links: Dict[Tuple[str, str], OdomLink] = {}

    @property
    def begun(self) -> bool:
        """Whether there was a calibration."""
        return bool(self._links)

    def calibrate(self, stamp_s: float, links: Sequence[OdomLink]) -> None:
        """A calibration for the moment ``stamp_s``."""
        self._links = {(link.parent, link.child): link for link in links}
        for drift in self._drifts.values():
            drift.begin(stamp_s)

    def odometry(self, vehicle: str, stamp_s: float, T_odom_body: np.ndarray) -> None:
        """A pose of a vehicle's tracker."""
        self._drifts[vehicle].add(stamp_s, T_odom_body[:3, 3])
        self._bodies[vehicle] = T_odom_body

    def sigma_m(self, parent: str, child: str) -> float:
        """Standard deviation (m) of the child's body seen from the parent's, along the worst axis;
        0 where no link of the two is known."""
        link = self._links.get((parent, child))
        if link is None or not {parent, child} <= set(self._bodies):
            return 0.0
        covariance = self._child_seen(link, drifting=True).covariance
        return float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))

    def most_apart_m(self, parent: str, child: str) -> float:
        """How far (m) the child may be from where the trackers say, seen from the parent."""
        return min(MOST_SIGMAS * self.sigma_m(parent, child), MOST_M)

    def differences(self, links: Sequence[OdomLink]) -> List[Difference]:
        """New links held against the last ones, of those pairs that both know."""
        known = [k for k in links if (k.parent, k.child) in self._links]
        return [self._difference(k) for k in known if {k.parent, k.child} <= set(self._bodies)]

    def _difference(self, link: OdomLink) -> Difference:
        told = self._child_seen(self._links[link.parent, link.child], drifting=True)
        seen = self._child_seen(link, drifting=False)
        off = np.zeros(4)
        off[:3] = seen.T_a_b[:3, 3] - told.T_a_b[:3, 3]
        off[3] = rotations.wrap(transforms.yaw(seen.T_a_b) - transforms.yaw(told.T_a_b))
        covariance = seen.covariance + told.covariance
        sigmas = float(np.sqrt(off @ np.linalg.solve(covariance, off)))
        return Difference(
            link.parent, link.child, float(np.linalg.norm(off[:3])), float(off[3]), sigmas
        )

    def _child_seen(self, link: OdomLink, drifting: bool) -> Place:
        """T_parentbody_childbody by a link."""
        parent, child = (self._body(n, drifting) for n in (link.parent, link.child))
        return parent.inverse() @ Place(link.T_parent_child, link.covariance) @ child

    def _body(self, name: str, drifting: bool) -> Place:
        covariance = self._drifts[name].covariance if drifting else _EXACT
        return Place(transforms.level(self._bodies[name]), covariance)
