# SPDX-License-Identifier: Apache-2.0
"""Whether each vehicle of the column sees the one in front where both trackers say that it is.

A tracker that drifts slowly takes its vehicle along: nothing on board may tell. As long as the next
one's tag is in view, as it is from the calibration until a vehicle leaves the column, its camera
tells, whichever tracker it is.
"""

from dataclasses import dataclass, replace
from typing import Dict, Mapping, Optional, Tuple

import numpy as np

from fcsv_control.mission.snapshot import VehicleView
from fcsv_control.mission.watches.drift_warning import LatchedDriftWarning
from fcsv_geometry.config import require_positive


@dataclass(frozen=True)
class TagInFrontRules:
    """Bounds. A calibration and what trackers drift after it are 0.1 m (docs/lab/tracking.md), a
    tag's place 2 % of its distance; a picture is up to half a second older than the pose."""

    off_m: float = 0.5
    lasts_s: float = 0.6
    gap_s: float = 1.0  # after which what was seen counts no more
    still_mps: float = 0.3  # both: who flies is elsewhere than as the picture was taken

    def __post_init__(self):
        require_positive(self)


class TagInFront:
    """``judge`` gives the views on, with what is wrong in ``sighted_off``."""

    def __init__(self, rules: Optional[TagInFrontRules] = None):
        self._rules = rules or TagInFrontRules()
        self._off_since_s: Dict[str, Tuple[float, float]] = {}  # by the rear one: first and last
        self._said = LatchedDriftWarning()

    def check_views(
        self, now_s: float, views: Mapping[str, VehicleView], T_home_odom: Mapping[str, np.ndarray]
    ) -> Dict[str, VehicleView]:
        """``views`` in the order of the column, the front one first; ``now_s`` monotonic."""
        names, out = list(views), dict(views)
        for front, rear in zip(names, names[1:]):
            if rear not in T_home_odom:
                self._said.forget(rear)
                continue
            said = self._said.of(rear, T_home_odom[rear])
            if not said and self._lasts(now_s, rear, self._off_m(views[front], views[rear])):
                said = f"it does not see {front} where their trackers say: one of them drifts"
                self._said.say(rear, T_home_odom[rear], said)
            if said:
                out[rear] = replace(views[rear], sighted_off=said)
        return out

    def _off_m(self, front: VehicleView, rear: VehicleView) -> Optional[float]:
        """None where nothing is seen, one of them flies, or is known not to know where it is."""
        if front.frame_problem or rear.frame_problem:
            return None
        seen, there = rear.p_home_front_tag, front.p_home_tag
        if (
            seen is None
            or there is None
            or not max(front.speed_mps, rear.speed_mps) < self._rules.still_mps
        ):
            return None
        return float(np.linalg.norm(seen - there))

    def _lasts(self, now_s: float, rear: str, off_m: Optional[float]) -> bool:
        r, (first_s, last_s) = self._rules, self._off_since_s.get(rear, (now_s, now_s))
        if off_m is None and now_s - last_s < r.gap_s:
            return False
        if off_m is None or off_m <= r.off_m:
            self._off_since_s.pop(rear, None)
            return False
        first_s = first_s if now_s - last_s < r.gap_s else now_s
        self._off_since_s[rear] = (first_s, now_s)
        return now_s - first_s >= r.lasts_s
