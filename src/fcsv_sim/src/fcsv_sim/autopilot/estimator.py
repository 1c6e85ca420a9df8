# SPDX-License-Identifier: Apache-2.0
"""What the autopilot believes: position, velocity and yaw in the frame of the external navigation.

Complementary filters with innovation gates, tuned to the behaviour measured on ArduCopter 4.3.8 and
4.6.2: a jump of half a metre is followed, one of five is refused for four and a half seconds and
then adopted over many messages, a yaw step of thirty degrees is not adopted, a reset of the tracker
is ignored for a second and then adopted in one step, and without a feed the position drifts slowly.
Frames: ``ext`` is the feed's frame, ENU (z up); yaw counter-clockwise from its x axis.
"""

import math
from typing import Iterator, Optional, Tuple

import numba
import numpy as np

from fcsv_geometry.rotations import wrap
from fcsv_sim.autopilot.ground import READY_S

HEALTHY_S = 0.3  # a feed older than this prevents arming
LOST_S = 8.0  # flags stay good this long without a feed
_GATE_M = 1.5
_REJECT_S = 4.5
_ADOPT_LAG_S = 0.27  # a rejected jump is then adopted as through a lag,
_ADOPT_STEP_M = 0.65  # in steps that are no larger than this
_ADOPTED_M = 0.3
_ADOPT_SPEED_PER_S = 1.5
RESET_IGNORED_S = 1.08  # with VISO_TYPE 2 the feed is ignored for so long after a reset
_YAW_GATE_RAD = np.radians(15.0)
_POSITION_GAIN, _VELOCITY_GAIN, _YAW_GAIN = 0.12, 0.25, 0.06  # per message at 30 Hz


@numba.njit(cache=True)
def _fly_on(p_m, v_mps, bias_mps2, acc_mps2, turn_rad, dt_s):
    """Position and velocity (3,), changed in place, a step later; the acceleration's frame is
    turned against theirs."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    turned = (c * acc_mps2[0] - s * acc_mps2[1], s * acc_mps2[0] + c * acc_mps2[1], acc_mps2[2])
    for k in range(3):
        step_mps = (turned[k] + bias_mps2[k]) * dt_s
        p_m[k] += (v_mps[k] + 0.5 * step_mps) * dt_s
        v_mps[k] += step_mps


def _drawn(random: np.random.Generator, sigma: float) -> Iterator[float]:
    """Errors of one standard deviation, drawn a second ahead: a hundred take as long as one."""
    while True:
        yield from random.normal(0.0, sigma, 100).tolist()


class Estimator:
    """Fed with the inertial truth (as an IMU would sense it) and external navigation."""

    def __init__(
        self, seed: int, ready_s: float = READY_S, reset_ignored_s: float = RESET_IGNORED_S
    ):
        random = np.random.default_rng([seed, 2])
        self._acc_bias = random.normal(0.0, 0.005, 3)
        self._noises = _drawn(random, 0.01)
        self.ready_s, self._reset_ignored_s = ready_s, reset_ignored_s
        self.baro_m = 0.0
        self.resets = 0  # position adopted with a step; the GUIDED target does not follow
        self.begin()

    def begin(self) -> None:
        """Begins as after power-on: nothing is known."""
        self._boot_s: Optional[float] = None
        self.runs = False  # whether the filter has begun, as of the last prediction
        self._vision_s: Optional[float] = None
        self._first_vision_s: Optional[float] = None
        self._reset_counter: Optional[int] = None
        self._rejecting_since_s: Optional[float] = None
        self._adopting = False  # a jump that was rejected
        self._ignored_until_s = float("-inf")  # the tracker was reset
        self._adopted, self._adopt_next = False, True
        self._datum_m = 0.0  # what resets of the height datum added to the height that is told
        self.innovation_ratio = 0.0  # position innovation over its gate: the filter's test ratio
        self.p_ext_m = np.zeros(3)
        self.v_ext_mps = np.zeros(3)
        self.yaw_ext_rad = 0.0
        self._yaw_known = False

    def predict(
        self,
        now_s: float,
        dt_s: float,
        acc_world_mps2: Tuple[float, float, float],
        yaw_world_rad: float,
        yaw_rate_rps: float,
        z_m: float,
    ):
        """One step of inertial sensing (m/s2 without gravity, rad, m)."""
        if self._boot_s is None:
            self._boot_s = now_s
        self.runs = self.started(now_s)
        self.yaw_ext_rad = wrap(self.yaw_ext_rad + yaw_rate_rps * dt_s)
        turn_rad = self.yaw_ext_rad - yaw_world_rad
        _fly_on(self.p_ext_m, self.v_ext_mps, self._acc_bias, acc_world_mps2, turn_rad, dt_s)
        self.baro_m = z_m + next(self._noises)

    def vision(self, now_s: float, p_ext_m, yaw_ext_rad: float, reset_counter: int) -> None:
        """A message of the external navigation; one that holds NaN is dropped."""
        if not all(map(math.isfinite, (*p_ext_m, yaw_ext_rad))):
            return
        first = self._vision_s is None
        gap_s = 0.0 if first else now_s - self._vision_s
        self._vision_s = now_s
        if first:
            self._first_vision_s = now_s
        if not self.started(now_s) or self._reset(now_s, reset_counter):
            return
        self._fuse_yaw(yaw_ext_rad)
        p = np.array(p_ext_m, float)
        p[2] += self._datum_m
        if self._adopt_next:
            self._adopt(p)
        else:
            self._fuse_position(now_s, gap_s, p)

    def _reset(self, now_s: float, counter: int) -> bool:
        """Whether the feed is ignored, because the tracker was begun anew a moment ago. What comes
        after is adopted."""
        if self._reset_counter is not None and counter != self._reset_counter:
            self._ignored_until_s = now_s + self._reset_ignored_s
            self._adopt_next = True
        self._reset_counter = counter
        return now_s < self._ignored_until_s

    def _fuse_position(self, now_s: float, gap_s: float, p: np.ndarray) -> None:
        innovation = p - self.p_ext_m
        apart_m = math.hypot(*innovation.tolist())
        self.innovation_ratio = apart_m / _GATE_M
        if self._adopting:
            self._creep(gap_s, innovation, apart_m)
        elif apart_m > _GATE_M:
            self._rejecting_since_s = (
                now_s if self._rejecting_since_s is None else self._rejecting_since_s
            )
            if now_s - self._rejecting_since_s > _REJECT_S:
                self._rejecting_since_s, self._adopting = None, True
                self.resets += 1
        else:
            self._rejecting_since_s = None
            weight = min(6.0, max(0.2, gap_s * 30.0))  # slower feeds weigh more per message
            self.p_ext_m += min(1.0, _POSITION_GAIN * weight) * innovation
            self.v_ext_mps += _VELOCITY_GAIN * weight * innovation

    def _creep(self, gap_s: float, innovation: np.ndarray, apart_m: float) -> None:
        """Moves on the way to a jump that was rejected: over many messages, in steps that no agent
        takes for a jump."""
        share = 1.0 - math.exp(-gap_s / _ADOPT_LAG_S)
        step = innovation * min(share, _ADOPT_STEP_M / max(apart_m, 1e-9))
        self.p_ext_m += step
        # taken for flight, which is braked: it swings by 3 m
        self.v_ext_mps += _ADOPT_SPEED_PER_S * step
        self._adopting = apart_m > _ADOPTED_M

    def reset_height_datum(self) -> None:
        """The height of the filter becomes zero and what it was is added to what is told: once a
        second while disarmed with an origin at altitude 0. The height told creeps up by the height
        that the feed tells."""
        self._datum_m = float(self.p_ext_m[2])

    def _adopt(self, p: np.ndarray) -> None:
        self.resets += self._adopted
        self.p_ext_m = p
        self._adopted, self._adopt_next = True, False
        self._rejecting_since_s, self._adopting = None, False

    def _fuse_yaw(self, yaw_ext_rad: float) -> None:
        if not self._yaw_known:
            self.yaw_ext_rad, self._yaw_known = yaw_ext_rad, True
            return
        innovation = wrap(yaw_ext_rad - self.yaw_ext_rad)
        if abs(innovation) < _YAW_GATE_RAD:
            self.yaw_ext_rad = wrap(self.yaw_ext_rad + _YAW_GAIN * innovation)

    def started(self, now_s: float) -> bool:
        """Whether the filter runs (an origin that was set before is lost)."""
        return self._boot_s is not None and now_s - self._boot_s > self.ready_s

    def booting(self, now_s: float) -> bool:
        """Whether the firmware itself is still starting."""
        return self._boot_s is None or now_s - self._boot_s < min(1.0, 0.5 * self.ready_s)

    def vision_healthy(self, now_s: float) -> bool:
        """A message within 300 ms."""
        return self._vision_s is not None and now_s - self._vision_s < HEALTHY_S

    def position_ok(self, now_s: float) -> bool:
        """Whether the flags say 0x33f: true for eight seconds after the feed's loss."""
        return self._adopted and self._vision_s is not None and now_s - self._vision_s < LOST_S
