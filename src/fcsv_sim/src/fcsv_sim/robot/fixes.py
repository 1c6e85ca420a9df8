# SPDX-License-Identifier: Apache-2.0
"""Fixes of a robot as vehicles that follow it read its tag: noise along and across the line of
sight, gaps, delay."""

from typing import Optional

import numpy as np

from fcsv_guidance.place.tracker import PlaceFix

EVERY_S, DELAY_S = 0.5, 0.3
# docs/lab/guidance.md#by-its-tags, 12 m
_ACROSS_M, _ALONG_M, _YAW_RAD = 0.06, 0.16, np.radians(2.3)
_COMMON = 0.7  # of the variance that lasts: where the vehicle itself is taken to be
# each axis, of where the vehicle is: as it begins, and what a reading adds; two flights were 0.16 and
# 0.25 m off from end to end, and stated 0.25 m in all
_OWN_M, _WALK_M = 0.12, 0.004
_YAW_READ = 0.45  # of the pictures that tell the yaw
_MISSED, _HIDDEN = 0.15, 0.02  # chances: a picture without the tag; a wall hides it for a while
_HIDDEN_S = (1.0, 5.0)


class TagReader:
    """Reads the robot's tag from a bearing that changes slowly. The same seed gives the same
    errors."""

    def __init__(self, seed: int):
        self._random = np.random.default_rng([seed, 22])
        self._bearing_rad = self._random.uniform(0, 2 * np.pi)
        self._common = self._random.standard_normal(3) * np.sqrt(_COMMON)
        self._own_m = self._random.normal(0.0, _OWN_M, 2)
        self._hidden_until_s = 0.0

    def read(self, stamp_s: float, x_m: float, y_m: float, yaw_rad: float) -> Optional[PlaceFix]:
        """The fix of a picture; None where the tag is not read."""
        random = self._random
        self._bearing_rad += random.normal(0.0, 0.05)
        if random.random() < _HIDDEN:
            self._hidden_until_s = stamp_s + random.uniform(*_HIDDEN_S)
        if stamp_s < self._hidden_until_s or random.random() < _MISSED:
            return None
        c, s = np.cos(self._bearing_rad), np.sin(self._bearing_rad)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self._own_m += random.normal(0.0, _WALK_M, 2)
        sigma = np.array([_ALONG_M, _ACROSS_M, _YAW_RAD])
        off = R @ (sigma * (self._common + np.sqrt(1.0 - _COMMON) * random.standard_normal(3)))
        covariance = R @ np.diag(sigma**2) @ R.T + np.diag([_OWN_M**2, _OWN_M**2, 0.0])
        off[:2] += self._own_m
        if random.random() > _YAW_READ:
            covariance[2, :2] = covariance[:2, 2] = 0.0
            covariance[2, 2] = np.inf
        return PlaceFix(stamp_s, x_m + off[0], y_m + off[1], yaw_rad + off[2], covariance)
