# SPDX-License-Identifier: Apache-2.0
"""Whether the pictures of two vehicles that record show them where both trackers say
(in_flight/pair_check.py).

A tracker that drifts slowly takes its vehicle along: nothing on board may tell. What is recorded
then is no recording of its configuration, and the next way leads somewhere else.
"""

from dataclasses import dataclass, replace
from typing import Dict, Mapping, Optional

import numpy as np

from fcsv_control.mission.snapshot import VehicleView
from fcsv_control.mission.watches.drift_warning import LatchedDriftWarning
from fcsv_geometry.config import require_positive


@dataclass(frozen=True)
class PairsSeenRules:
    """So many looks in a row must say so, each at most ``gap_s`` after the one before."""

    looks: int = 2
    gap_s: float = 10.0

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class _Off:
    looks: int
    last_s: float
    reference: str


class PairsSeen:
    """``looked`` is told every look, ``judge`` gives views on, with what is wrong in
    ``sighted_off``."""

    def __init__(self, rules: Optional[PairsSeenRules] = None):
        self._rules = rules or PairsSeenRules()
        self._off: Dict[str, _Off] = {}  # by the vehicle that was looked at beside the reference
        self._said = LatchedDriftWarning()

    def looked(self, now_s: float, reference: str, vehicle: str, off: bool) -> None:
        """A look at two pictures came; ``now_s`` monotonic."""
        before = self._off.pop(vehicle, None)
        if off:
            goes_on = before is not None and now_s - before.last_s <= self._rules.gap_s
            self._off[vehicle] = _Off(before.looks + 1 if goes_on else 1, now_s, reference)

    def check_views(
        self, views: Mapping[str, VehicleView], T_home_odom: Mapping[str, np.ndarray]
    ) -> Dict[str, VehicleView]:
        """One whose odometry began anew, or that is lost, is known not to be where its tracker
        says."""
        out = dict(views)
        for name in [n for n in views if n in T_home_odom]:
            said, off = self._said.of(name, T_home_odom[name]), self._off.get(name)
            if off is not None and off.looks >= self._rules.looks:
                del self._off[name]
                both = [views[n] for n in (name, off.reference) if n in views]
                if not any(v.frame_problem or v.lost for v in both):
                    said = f"pictures of it and {off.reference} show another place than their trackers: one drifts"
                    self._said.say(name, T_home_odom[name], said)
            if said and not views[name].sighted_off:
                out[name] = replace(views[name], sighted_off=said)
        return out
