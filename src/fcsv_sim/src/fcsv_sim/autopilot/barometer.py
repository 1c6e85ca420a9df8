# SPDX-License-Identifier: Apache-2.0
"""The autopilot's barometer: pressure, with what is wrong with it as a height on a multirotor
outdoors."""

import math
from typing import Sequence

import numpy as np

_SEA_HPA, _SCALE_M, _EXPONENT = 1013.25, 44330.0, 5.255  # of the standard atmosphere
_NOISE_M = 0.1  # of a sample
_WALK_M = 0.02  # in a root of a second: 0.35 m in five minutes
_GUST_M, _GUST_S = 0.2, 3.0  # what wind does to the pressure under the hood, and for how long
_PER_SPEED2 = 0.025  # m per (m/s)^2 of air that it flies through: half of the dynamic pressure
_WASH_M, _WASH_HEIGHT_M = 0.6, 0.7  # the rotors' own wash near the ground, which reads lower


class Barometer:
    """``feel`` is told the truth with each pass, ``pressure_hpa`` reads it at a time (s)."""

    def __init__(self, seed: int):
        self._random = np.random.default_rng([seed, 7])
        self._read_s = math.nan
        self._walk_m = self._gust_m = self._z_m = 0.0
        self._v_mps = self._wind_mps = (0.0, 0.0, 0.0)

    def feel(self, z_m: float, v_mps: Sequence[float], wind_mps: Sequence[float]) -> None:
        """Height over the ground; velocities of vehicle and wind (3,)."""
        self._z_m, self._v_mps, self._wind_mps = z_m, v_mps, wind_mps

    def pressure_hpa(self, now_s: float, motors: bool) -> float:
        """A sample."""
        passed_s = 0.0 if math.isnan(self._read_s) else now_s - self._read_s
        self._read_s = now_s
        air_mps = math.dist(self._v_mps, self._wind_mps)
        noise, walk, gust = self._random.standard_normal(3)
        keep = math.exp(-passed_s / _GUST_S)
        self._walk_m += _WALK_M * math.sqrt(passed_s) * walk
        self._gust_m = keep * self._gust_m + math.sqrt(1.0 - keep**2) * _GUST_M * gust
        wash_m = _WASH_M * math.exp(-max(0.0, self._z_m) / _WASH_HEIGHT_M) if motors else 0.0
        wrong_m = _NOISE_M * noise + self._walk_m + self._gust_m + _PER_SPEED2 * air_mps**2 - wash_m
        return _SEA_HPA * (1.0 - (self._z_m + wrong_m) / _SCALE_M) ** _EXPONENT
