# SPDX-License-Identifier: Apache-2.0
"""What goes wrong while a robot is guided; each begins when a share of the way is driven, and most
end."""

from dataclasses import dataclass
from typing import Dict, List, Optional

import numpy as np

from fcsv_guidance.place.tracker import PlaceFix
from fcsv_sim.errors import SimulationError

ALL, NONE = "all", "none"
_JUMP_SHARE = 0.3


@dataclass(frozen=True)
class RobotFault:
    """A name, what it does in a sentence, how long it lasts at most (s), whether the place is
    watched, and whether it befalls a robot with gimbals, too."""

    name: str
    does: str
    lasts_s: float = 0.0
    watched: bool = False
    of_gimbals: bool = False


FAULTS: Dict[str, RobotFault] = {
    fault.name: fault
    for fault in (
        RobotFault(NONE, "nothing but errors of fixes and wheels", of_gimbals=True),
        RobotFault("pose lost", "no fix comes", 25.0),
        RobotFault("pose lost for good", "no fix comes any more", np.inf),
        RobotFault("pose jumps", "some fixes lie metres beside, then all by one offset", 6.0),
        RobotFault("pose not finite", "fixes are NaN, or have a covariance that is none", 10.0),
        RobotFault("wheels slip", "the wheels turn on the spot", 4.0, of_gimbals=True),
        RobotFault("map stale", "no view of the place comes", 20.0, True),
        RobotFault(
            "radio cut", "neither commands nor wheel odometry come through", 10.0, of_gimbals=True
        ),
        RobotFault(
            "stop all", "the operator stops all, and gives the goal again", 8.0, of_gimbals=True
        ),
        RobotFault(
            "way closes", "something wide comes into the way and stays, or leaves", 40.0, True
        ),
        RobotFault("runs at it", "a walker runs along the way at the robot", 40.0, True),
    )
}


def faults_of(names: str) -> List[RobotFault]:
    """Finds faults as --faults takes them. Raises SimulationError naming the one that there is
    not."""
    if names == ALL:
        return list(FAULTS.values())
    found = [name.strip() for name in names.split(",")]
    wrong = [name for name in found if name not in FAULTS]
    if wrong:
        raise SimulationError(f"--faults: '{wrong[0]}' is none of {ALL}, {', '.join(FAULTS)}")
    return [FAULTS[name] for name in found]


class FixFault:
    """What becomes of fixes from ``begins_s`` on, for ``lasts_s``."""

    def __init__(
        self, fault: RobotFault, begins_s: float, lasts_s: float, random: np.random.Generator
    ):
        self._name, self._begins_s, self._ends_s = fault.name, begins_s, begins_s + lasts_s
        self._random = random
        angle = random.uniform(0, 2 * np.pi)
        self._offset_m = random.uniform(1.0, 6.0) * np.array([np.cos(angle), np.sin(angle)])

    def passed(self, fix: PlaceFix) -> Optional[PlaceFix]:
        """The fix as it comes; None where none does."""
        if not self._begins_s <= fix.stamp_s < self._ends_s:
            return fix
        if self._name.startswith("pose lost"):
            return None
        if self._name == "pose not finite":
            if self._random.random() < 0.5:
                return PlaceFix(fix.stamp_s, np.nan, fix.y_m, fix.yaw_rad, fix.covariance)
            return PlaceFix(fix.stamp_s, fix.x_m, fix.y_m, fix.yaw_rad, -fix.covariance)
        if self._name == "pose jumps":
            if fix.stamp_s > 0.5 * (self._begins_s + self._ends_s):
                off = self._offset_m
            elif self._random.random() < _JUMP_SHARE:
                off = self._random.normal(0.0, 3.0, 2)
            else:
                off = np.zeros(2)
            return PlaceFix(
                fix.stamp_s, fix.x_m + off[0], fix.y_m + off[1], fix.yaw_rad, fix.covariance
            )
        return fix
