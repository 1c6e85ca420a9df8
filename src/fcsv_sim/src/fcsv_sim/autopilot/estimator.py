# SPDX-License-Identifier: Apache-2.0
"""What the autopilot believes: position, velocity and yaw in the frame of the external navigation.

Complementary filters with innovation gates, tuned to the behaviour measured on ArduCopter 4.3.8
(docs/results.md): a jump of half a metre is followed, one of five is refused for five seconds and then
adopted, a yaw step of thirty degrees is not adopted, and without a feed the position drifts slowly.
Frames: ``ext`` is the feed's frame, ENU (z up); yaw counter-clockwise from its x axis.
"""

import math
from typing import Optional

import numpy as np

from fcsv_geometry.rotations import wrap

START_S = 2.0  # the filter initialises this long after power-on
HEALTHY_S = 0.3  # a feed older than this prevents arming
LOST_S = 8.0  # flags stay good this long without a feed
_GATE_M = 1.5
_REJECT_S = 5.0
_YAW_GATE_RAD = np.radians(15.0)
_POSITION_GAIN, _VELOCITY_GAIN, _YAW_GAIN = 0.12, 0.25, 0.06  # per message at 30 Hz


class Estimator:
    """Fed with the inertial truth (as an IMU would sense it) and external navigation."""

    def __init__(self, seed: int):
        random = np.random.default_rng([seed, 2])
        self._acc_bias = random.normal(0.0, 0.005, 3).tolist()
        self._random = random
        self._boot_s: Optional[float] = None
        self._vision_s: Optional[float] = None
        self._first_vision_s: Optional[float] = None
        self._reset_counter: Optional[int] = None
        self._rejecting_since_s: Optional[float] = None
        self.yaw_offset_rad = 0.0  # of the ext frame's yaw against the world's, as believed
        self.p_ext_m = np.zeros(3)
        self.v_ext_mps = np.zeros(3)
        self.yaw_ext_rad = 0.0
        self.baro_m = 0.0
        self._yaw_known = False
        self.resets = 0  # position adopted with a step; the GUIDED target does not follow

    def predict(self, now_s: float, dt_s: float, acc_world_mps2, yaw_world_rad: float, yaw_rate_rps: float, z_m: float):
        """One step of inertial sensing (m/s2 without gravity, rad, m)."""
        if self._boot_s is None:
            self._boot_s = now_s
        self.yaw_ext_rad = wrap(self.yaw_ext_rad + yaw_rate_rps * dt_s)
        turn = self.yaw_ext_rad - yaw_world_rad
        c, s = math.cos(turn), math.sin(turn)
        x, y, z = acc_world_mps2
        p, v = self.p_ext_m, self.v_ext_mps
        for k, acc in enumerate((c * x - s * y, s * x + c * y, z)):  # plain numbers: numpy is slow for three
            step_mps, before_mps = (acc + self._acc_bias[k]) * dt_s, float(v[k])
            p[k] += (before_mps + 0.5 * step_mps) * dt_s
            v[k] = before_mps + step_mps
        self.baro_m = z_m + self._random.normal(0.0, 0.01)

    def vision(self, now_s: float, p_ext_m, yaw_ext_rad: float, reset_counter: int) -> None:
        """A message of the external navigation; one that holds NaN is dropped."""
        if not np.isfinite([*p_ext_m, yaw_ext_rad]).all():
            return
        first = self._vision_s is None
        gap_s = 0.0 if first else now_s - self._vision_s
        self._vision_s = now_s
        if first:
            self._first_vision_s = now_s
        if not self.started(now_s):
            return
        self._fuse_yaw(yaw_ext_rad)
        innovation = np.asarray(p_ext_m, float) - self.p_ext_m
        reset = self._reset_counter is not None and reset_counter != self._reset_counter
        self._reset_counter = reset_counter
        if reset or not self._adopted:
            self._adopt(p_ext_m)
        elif np.linalg.norm(innovation) > _GATE_M:
            self._rejecting_since_s = self._rejecting_since_s or now_s
            if now_s - self._rejecting_since_s > _REJECT_S:
                self._adopt(p_ext_m)
        else:
            self._rejecting_since_s = None
            weight = float(np.clip(gap_s * 30.0, 0.2, 6.0))  # slower feeds weigh more per message
            self.p_ext_m += min(1.0, _POSITION_GAIN * weight) * innovation
            self.v_ext_mps += _VELOCITY_GAIN * weight * innovation

    _adopted = False

    def _adopt(self, p_ext_m) -> None:
        if self._adopted:
            self.resets += 1
        self.p_ext_m = np.array(p_ext_m, float)
        self._adopted, self._rejecting_since_s = True, None

    def _fuse_yaw(self, yaw_ext_rad: float) -> None:
        if not self._yaw_known:
            self.yaw_ext_rad, self._yaw_known = yaw_ext_rad, True
            return
        innovation = wrap(yaw_ext_rad - self.yaw_ext_rad)
        if abs(innovation) < _YAW_GATE_RAD:
            self.yaw_ext_rad = wrap(self.yaw_ext_rad + _YAW_GAIN * innovation)

    def started(self, now_s: float) -> bool:
        """Whether the filter runs (an origin sent before is dropped)."""
        return self._boot_s is not None and now_s - self._boot_s > START_S

    def feed_healthy(self, now_s: float) -> bool:
        """A message within 300 ms."""
        return self._vision_s is not None and now_s - self._vision_s < HEALTHY_S

    def position_ok(self, now_s: float) -> bool:
        """Whether the flags say 0x33f: true for eight seconds after the feed's loss."""
        return self._adopted and self._vision_s is not None and now_s - self._vision_s < LOST_S
