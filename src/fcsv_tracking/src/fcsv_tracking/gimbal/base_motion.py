# SPDX-License-Identifier: Apache-2.0
"""How the ground robot moves under its gimbals: by its wheels, where a vehicle that was seen is by
now, as the robot has it; by its place in home, where a vehicle is in a frame that stands.

O: the wheels' odometry frame, G: the robot, S: where the robot stood when home was set.
"""

from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.gimbal.follow import Target
from fcsv_tracking.mocap.equations import moved_covariance

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


class BasePlace:
    """Where the robot is in S, by its place in home; it stands there until the first such place
    comes, and moves on by its wheels (``motion``) after the last."""

    def __init__(self, motion: BaseMotion):
        self._motion = motion
        self._T_home_S: Optional[np.ndarray] = None
        self._begin()

    def _begin(self) -> None:
        self._track = Trajectory(_BRIDGED_S, 0.0, _KEPT_S)
        self._covariance = np.zeros((6, 6))

    def set_home(self, T_home_ground: np.ndarray) -> None:
        """Home was set while the robot stood there: from now on it is S."""
        self._T_home_S = transforms.level(T_home_ground)
        self._begin()

    def add(self, stamp_s: float, T_home_ground: np.ndarray, covariance: np.ndarray) -> None:
        """The robot's place in home, of which x, y and yaw count, and its covariance (6,6): position
        (m), rotation (rad), about home's axes. One from before home was set is passed over."""
        if self._T_home_S is None:
            return
        x, y, _ = T_home_ground[:3, 3]
        yaw = transforms.yaw(T_home_ground)
        place = transforms.from_xyz_yaw([x, y, self._T_home_S[2, 3]], yaw)
        T_S_home = transforms.invert(self._T_home_S)
        if self._track.add(stamp_s, T_S_home @ place):
            turn = np.kron(np.eye(2), T_S_home[:3, :3])
            self._covariance = turn @ covariance @ turn.T

    def at(self, stamp_s: float) -> np.ndarray:
        """T_S_G; from the last place on as the wheels say. Raises PoseUnavailable for a moment that
        lies before what is remembered, or where places were silent."""
        if not len(self._track):
            return np.eye(4)
        last_s, T_S_last = self._track.latest()
        if stamp_s <= last_s:
            return self._track.at(stamp_s)
        since = transforms.invert(self._motion.at(last_s)) @ self._motion.at(stamp_s)
        return T_S_last @ since

    def standing(
        self, stamp_s: float, T_G_D: np.ndarray, covariance: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray]:
        """T_S_D of a vehicle that was seen at T_G_D, and its covariance (6,6) about S's axes, that of
        the robot's place included. Raises PoseUnavailable as at()."""
        T_S_G = self.at(stamp_s)
        turn = np.kron(np.eye(2), T_S_G[:3, :3])
        away_m = T_S_G[:3, :3] @ T_G_D[:3, 3]
        of_robot = moved_covariance(self._covariance, np.eye(3), away_m)
        return T_S_G @ T_G_D, turn @ covariance @ turn.T + of_robot
