# SPDX-License-Identifier: Apache-2.0
"""How the ground robot moves under its gimbals, by its wheels: where a vehicle that was seen is by
now, as the robot has it.

Only what a gimbal looks at depends on it, no pose that is given out. O: the wheels' odometry frame,
G: the robot.
"""

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.gimbal.follow import Target

_BRIDGED_S, _AHEAD_S, _KEPT_S = 0.5, 0.3, 3.0
_STEP_S = 0.1  # over which velocities in G are taken


class BaseMotion:
    """Wheel odometry of the last seconds. Where none came the robot stands."""

    def __init__(self):
        self._track = Trajectory(_BRIDGED_S, _AHEAD_S, _KEPT_S)

    @property
    def moves(self) -> bool:
        """Whether odometry has come."""
        return len(self._track) > 0

    def add(self, stamp_s: float, T_O_G: np.ndarray) -> None:
        """What the wheels say. After the clock was set back the way begins anew; where they were
        silent for long, too."""
        if not self._track.add(stamp_s, T_O_G) and stamp_s < self._track.span_s[1] - _KEPT_S:
            self._track = Trajectory(_BRIDGED_S, _AHEAD_S, _KEPT_S)
            self._track.add(stamp_s, T_O_G)

    def at(self, stamp_s: float) -> np.ndarray:
        """T_O_G; before the first reading as then, more than 0.3 s after the last as if it
        stood."""
        if not self.moves:
            return np.eye(4)
        first_s, last_s = self._track.span_s
        ahead_s = _AHEAD_S if len(self._track) > 1 else 0.0
        if stamp_s > last_s + ahead_s:
            return self._track.latest()[1]
        try:
            return self._track.at(max(stamp_s, first_s))
        except PoseUnavailable:
            return self._track.latest()[1]

    def in_ground(self, target: Target, now_s: float, known_s: float) -> Target:
        """A target whose place is in O, as it is in G now. ``known_s``: so long after its last
        sight its velocity is believed; later it stands."""
        if not self.moves:
            return target
        known_s += target.stamp_s
        ends = [
            transforms.apply(transforms.invert(self.at(t)), target.at(min(t, known_s)))
            for t in (now_s, now_s + _STEP_S)
        ]
        velocity = (ends[1] - ends[0]) / _STEP_S if now_s <= known_s else np.zeros(3)
        return Target(now_s, ends[0], velocity, target.stamp_s)
