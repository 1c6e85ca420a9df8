# SPDX-License-Identifier: Apache-2.0
"""What a Tello's messages mean, as tellopy 0.7 decodes them: flight data, and the IMU record of its
log.

The log's world has z down and x where the vehicle looked when it was switched on; its body is
forward, right, down. Here both are z up, y left. The log's positions (MVO) are not used: they are
0.2 to 0.9 s late and begin anew where the ground is not seen. Its velocities are added up instead,
and the height of the flight data bounds that drift.
"""

import math
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from fcsv_control.tello.messages import FlightReport, LogReport
from fcsv_control.tello.ticks import TickClock
from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError

_G_MPS2 = 9.81
# forward, right, down to forward, left, up; the same for the worlds
_UP = np.array([1.0, -1.0, -1.0])
_DECIMETRE_M = 0.1
# time constant with which the height of the flight data is believed: it has steps of 0.1 m
_HEIGHT_S = 1.0
_LONGEST_S = 0.5  # without a record: what it flew meanwhile is not known
_FASTEST_MPS = 20.0  # above what a Tello can fly: a record that was damaged


def flight_report(data: Any) -> Optional[FlightReport]:
    """Makes a report from a ``tellopy`` FlightData; None where it could not be read.

    tellopy makes all fields 0 of a message of another length, as other firmware sends it: neither
    on the ground nor in the air, and no battery.
    """
    if not (data.em_sky or data.em_ground) and data.battery_percentage == 0:
        return None
    share = data.battery_percentage / 100.0
    return FlightReport(
        bool(data.em_sky), _DECIMETRE_M * data.height, share if 0.0 <= share <= 1.0 else math.nan
    )


@dataclass(frozen=True)
class OwnMotion:
    """T_own_body, velocity and turning in the body's axes (m/s, rad/s), and what the accelerometer
    feels (m/s2).

    ``stamp_s``: monotonic, by the record's tick (``ticks.py``).
    """

    stamp_s: float
    T_own_body: np.ndarray
    v_body_mps: np.ndarray
    gyro_radps: np.ndarray
    accel_mps2: np.ndarray

    @property
    def report(self) -> LogReport:
        """What the core needs of it."""
        return LogReport(self.T_own_body, self.v_body_mps)


class OwnOdometry:
    """``height`` of each flight data, ``imu`` of each IMU record; frame ``own`` begins where the
    first one found it."""

    def __init__(self):
        self._p_m = np.zeros(3)
        self._height_m: Optional[float] = None
        self._clock, self._imu_s = TickClock(), -math.inf

    def height(self, height_m: float) -> None:
        """Above take-off, by the flight data."""
        self._height_m = height_m

    def imu(self, now_s: float, imu: Any) -> Optional[OwnMotion]:
        """Makes a motion from a ``tellopy`` LogImuAtti that came at ``now_s``, monotonic; None
        where it cannot be."""
        v_own = _UP * np.array([imu.vg_x, imu.vg_y, imu.vg_z], float)
        numbers = [imu.acc_x, imu.acc_y, imu.acc_z, imu.gyro_x, imu.gyro_y, imu.gyro_z]
        felt = np.array(numbers, float)
        if not (
            np.isfinite(v_own).all()
            and np.isfinite(felt).all()
            and np.abs(v_own).max() < _FASTEST_MPS
        ):
            return None
        stamp_s = self._clock.stamp_s(now_s, imu.tick)
        dt_s = max(stamp_s - self._imu_s, 0.0)
        step_m = v_own * dt_s if dt_s <= _LONGEST_S else np.zeros(3)
        try:
            T = transforms.from_xyz_quaternion(
                self._p_m + step_m, (imu.q1, -imu.q2, -imu.q3, imu.q0)
            )
        except GeometryError:
            return None
        if self._height_m is not None:
            T[2, 3] += (self._height_m - T[2, 3]) * (
                1.0 - math.exp(-min(dt_s, _LONGEST_S) / _HEIGHT_S)
            )
        self._p_m, self._imu_s = T[:3, 3].copy(), stamp_s
        return OwnMotion(stamp_s, T, T[:3, :3].T @ v_own, _UP * felt[3:], _G_MPS2 * _UP * felt[:3])
