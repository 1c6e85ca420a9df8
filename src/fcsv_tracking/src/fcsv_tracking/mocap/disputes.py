# SPDX-License-Identifier: Apache-2.0
"""Samples that the gates reject: which sensor may be wrong, and whether that can no longer be
decided."""

from enum import Enum, auto
from typing import Optional

import numpy as np

from fcsv_geometry.streams.flow import DropCounter
from fcsv_tracking.mocap.filter import Correction
from fcsv_tracking.mocap.rules import TrackerRules


class MocapVerdict(Enum):
    """What becomes of a pose of the mocap."""

    TAKE = auto()
    KEEP_OUT = auto()  # it is none of this body's
    CONTRADICTS = auto()  # poses have been kept out for so long that nobody knows who is right


class Disputes:
    """Weighs the disputes of one vehicle's mocap, odometry and attitude with the filter; times are
    moments (s) of samples."""

    def __init__(self, rules: TrackerRules, counts: DropCounter):
        self._rules, self._counts = rules, counts
        self.clear()

    def clear(self) -> None:
        """All agree, or all begin anew."""
        self.mocap_agrees()
        self._odometry_since_s: Optional[float] = None
        self._attitude_since_s: Optional[float] = None

    @property
    def about_attitude(self) -> bool:
        """Whether the vehicle's last attitude was kept out."""
        return self._attitude_since_s is not None

    def mocap_agrees(self) -> None:
        self._mocap_since_s: Optional[float] = None
        self._place_since_s: Optional[float] = None

    def mocap(
        self, moment_s: float, correction: Correction, coasting: bool, heading_confirmed: bool
    ) -> MocapVerdict:
        """Judges a pose of a pose of the mocap against the filter; while ``coasting`` no body turns
        as swapped markers do."""
        turned = coasting and float(np.linalg.norm(correction.residual[3:])) > np.radians(
            self._rules.coast_deg
        )
        if not (turned or correction.distance2 > self._rules.gate_6):
            return MocapVerdict.TAKE
        lasts = self._kept_out(moment_s, correction, turned, heading_confirmed)
        return MocapVerdict.CONTRADICTS if lasts else MocapVerdict.KEEP_OUT

    def _kept_out(
        self, moment_s: float, correction: Correction, turned: bool, heading_confirmed: bool
    ) -> bool:
        """A pose was kept out; True where that has lasted too long."""
        place_off = correction.part(slice(0, 3))[0] > self._rules.gate_3
        heading_off = turned or correction.part(slice(3, 6))[0] > self._rules.gate_3
        off = " and ".join(
            what for what, is_off in (("place", place_off), ("rotation", heading_off)) if is_off
        )
        self._counts.count(f"mocap: {off} off what was predicted")
        if heading_off and not place_off and heading_confirmed:
            return False  # markers taken for one another; odometry carries on
        if self._mocap_since_s is None:
            self._mocap_since_s = moment_s
        if heading_off and place_off:
            self._place_since_s = None
        elif self._place_since_s is None:
            self._place_since_s = moment_s
        alone_s = moment_s - (moment_s if self._place_since_s is None else self._place_since_s)
        return (
            alone_s > self._rules.dispute_s
            or moment_s - self._mocap_since_s > self._rules.dispute_all_s
        )

    def odometry(self, moment_s: float, off: bool) -> bool:
        """Whether place and speed were ``off``; True where they have been for too long."""
        self._odometry_since_s = self._since(
            moment_s, off, self._odometry_since_s, "odometry: off what was predicted"
        )
        return off and moment_s - self._odometry_since_s > self._rules.dispute_s

    def attitude(self, moment_s: float, off: bool) -> bool:
        """Judges the attitude likewise."""
        reason = "odometry: attitude off what was predicted"
        self._attitude_since_s = self._since(moment_s, off, self._attitude_since_s, reason)
        return off and moment_s - self._attitude_since_s > self._rules.dispute_s

    def _since(
        self, moment_s: float, off: bool, since_s: Optional[float], reason: str
    ) -> Optional[float]:
        if not off:
            return None
        self._counts.count(reason)
        return moment_s if since_s is None else since_s
