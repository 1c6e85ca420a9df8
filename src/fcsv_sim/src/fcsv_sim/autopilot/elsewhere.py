# SPDX-License-Identifier: Apache-2.0
"""The true motion of a vehicle that ArduCopter's own simulation flies, from its SIM_STATE messages.

They have no stamp, and the position in them is in whole 1e-7 degrees (11 mm). So the moment comes
from the steady rate at which they are sent, and the place from their velocity, held within what the
rounded position allows.
"""

import math
from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import FcsvError

TRUTH_HZ = 100.0
_DEGREES, _METRES_PER_DEGREE = 1e-7, 111319.49  # ArduPilot's own figure of a degree of latitude
_LEVEL_RAD = math.radians(10.0)
_GAIN = 0.05  # of what is left outside of the rounding, a message
# of a simulation that restarts; what stands moves by less, m and m/s
_SILENT_S, _STANDS_M = 0.5, 0.05
_LATE_S = 0.03  # a message that is further off its moment begins a new count


class ElsewhereError(FcsvError):
    """The autopilot elsewhere is none, or tells no true pose; the message says what to do."""


@dataclass(frozen=True)
class TrueState:
    """``T_world_body`` (4, 4) and ``v_world_mps`` (3,) at ``stamp_s`` (wall clock)."""

    stamp_s: float
    T_world_body: np.ndarray
    v_world_mps: np.ndarray


class Moments:
    """When messages left, that are sent at a steady rate and come at uneven times.

    >>> moments = Moments(100.0)
    >>> [round(moments.of(came_s), 3) for came_s in (5.000, 5.018, 5.021, 5.030)]
    [5.0, 5.01, 5.021, 5.031]
    """

    def __init__(self, rate_hz: float):
        self._period_s, self._last_s = 1.0 / rate_hz, float("-inf")

    def of(self, came_s: float) -> float:
        """The moment (s) of the message that came at ``came_s``; moments rise."""
        expected_s = self._last_s + self._period_s
        off_s = came_s - expected_s
        stamp_s = expected_s + _GAIN * off_s if abs(off_s) < _LATE_S else came_s
        self._last_s = max(stamp_s, self._last_s + 1e-4)
        return self._last_s


def units_m(first) -> np.ndarray:
    """(2,) how far east and north one unit of the position in SIM_STATE is, at the place of such a
    message."""
    north_m = _METRES_PER_DEGREE * _DEGREES
    return np.array([north_m * math.cos(math.radians(first.lat_int * _DEGREES)), north_m])


def rounded_pose(message, first) -> np.ndarray:
    """T_enu_body (4, 4) that a SIM_STATE tells, from the place of the ``first`` one: east and north
    are rounded."""
    east_m, north_m = units_m(first) * (
        message.lon_int - first.lon_int,
        message.lat_int - first.lat_int,
    )
    rpy_rad = [message.roll, -message.pitch, math.pi / 2 - message.yaw]
    return transforms.from_xyz_rpy([east_m, north_m, message.alt - first.alt], rpy_rad)


class TrueMotion:
    """Turns SIM_STATE into poses in the simulated world.

    The vehicle stands at ``start_xyz_yaw`` (m, rad; world) when the first message comes, whatever
    its latitude and heading are: the worlds of fcsv have none. A simulation that restarts puts its
    vehicle back to where it began; here the vehicle stays where it stood, as one whose autopilot
    restarts.
    """

    def __init__(self, start_xyz_yaw: Sequence[float]):
        x, y, z, yaw = start_xyz_yaw
        self._T_world_start = transforms.from_xyz_yaw([x, y, z], yaw)
        self._moments = Moments(TRUTH_HZ)
        self._first = None
        self._T_start_enu = np.eye(4)
        self._p_enu_m = np.zeros(3)
        self._stamp_s: Optional[float] = None
        self._came_s = float("-inf")
        self._T_world_body = self._T_world_start

    def on_sim_state(self, came_s: float, message) -> TrueState:
        """The state that a SIM_STATE tells; ``came_s`` by the wall clock. Raises ElsewhereError
        where it lies."""
        if not all(
            map(math.isfinite, (message.roll, message.pitch, message.yaw, message.alt, message.vn))
        ):
            raise ElsewhereError(
                "the simulation tells a true pose that is not finite: start it anew"
            )
        if self._first is None:
            self._begin(message)
        elif self._restarted(came_s, message):
            self._begin_again(message)
        self._came_s = came_s
        stamp_s = self._moments.of(came_s)
        v_enu_mps = np.array([message.ve, message.vn, -message.vd], dtype=float)
        T_enu_body = rounded_pose(message, self._first)
        T_enu_body[:3, 3] = self._moved(stamp_s, v_enu_mps, T_enu_body[:3, 3])
        T_world_enu = self._T_world_start @ self._T_start_enu
        self._T_world_body = T_world_enu @ T_enu_body
        return TrueState(stamp_s, self._T_world_body, T_world_enu[:3, :3] @ v_enu_mps)

    def _begin(self, message) -> None:
        if max(abs(message.roll), abs(message.pitch)) > _LEVEL_RAD:
            raise ElsewhereError(
                "the simulated vehicle lies on its side: start ArduCopter's simulation anew"
            )
        self._first = message
        yaw_rad = math.pi / 2 - message.yaw
        self._T_start_enu = transforms.invert(transforms.from_xyz_yaw([0.0] * 3, yaw_rad))

    def _restarted(self, came_s: float, message) -> bool:
        """Whether it was silent, and stands where it began."""
        cells = max(
            abs(message.lat_int - self._first.lat_int), abs(message.lon_int - self._first.lon_int)
        )
        speed_mps = math.hypot(message.vn, message.ve, message.vd)
        lifted_m = abs(message.alt - self._first.alt)
        return (
            came_s > self._came_s + _SILENT_S
            and cells <= 1
            and lifted_m < _STANDS_M
            and speed_mps < _STANDS_M
        )

    def _begin_again(self, message) -> None:
        """Where it stands now is where it stood."""
        self._begin(message)
        p_world_m = [*self._T_world_body[:2, 3], self._T_world_start[2, 3]]
        self._T_world_start = transforms.from_xyz_yaw(p_world_m, transforms.yaw(self._T_world_body))
        self._stamp_s = None

    def _moved(self, stamp_s: float, v_enu_mps: np.ndarray, told_m: np.ndarray) -> np.ndarray:
        """(3,) on by the velocity, and back to where the rounded position allows it."""
        if self._stamp_s is None or stamp_s - self._stamp_s > _SILENT_S:
            self._p_enu_m = told_m.copy()
        else:
            cell_m = np.array([*units_m(self._first), 0.0])
            self._p_enu_m = self._p_enu_m + v_enu_mps * (stamp_s - self._stamp_s)
            outside = self._p_enu_m - np.clip(self._p_enu_m, told_m - cell_m, told_m + cell_m)
            self._p_enu_m = self._p_enu_m - [_GAIN * outside[0], _GAIN * outside[1], outside[2]]
        self._stamp_s = stamp_s
        return self._p_enu_m
