# SPDX-License-Identifier: Apache-2.0
"""A pilot who flies a vehicle himself, in a mode that he chose: hovers, flies about a little, or
lets it sink first."""

import math
from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.people import feel
from fcsv_sim.people.operator import PilotSight, TransmitterSticks, in_body

_LEAN_RAD = math.radians(30.0)
_G = 9.81
_HOVER = 0.375  # share of the thrust that carries the simulated airframe
_ROAM_M, _ROAM_PERIOD_S = 0.8, 9.0
_FLICK_S = 0.3
_DROP_S = 1.5  # so long the throttle stick is down: LOITER and ALT_HOLD sink by 1.6 m


class HandFlight:
    """Sticks by the time (s) since the pilot took over at a place (world, m)."""

    def __init__(
        self,
        mode: Mode,
        p_world_m: np.ndarray,
        random: np.random.Generator,
        roams: bool,
        drops: bool,
    ):
        self._mode, self._here_m = mode, np.array(p_world_m, float)
        self._roams, self._drops = roams, drops
        self._feel = feel.Feel()
        self._phase_rad = float(random.uniform(0.0, 2.0 * math.pi))

    def sticks(self, since_s: float, sight: PilotSight) -> TransmitterSticks:
        """Gives the sticks of this moment."""
        if self._mode == Mode.LOITER and since_s < _FLICK_S and sight.mode != Mode.LOITER:
            return TransmitterSticks(
                mode=Mode.ALT_HOLD
            )  # its switch may be at LOITER already: away and back
        if self._mode in (Mode.LAND, Mode.BRAKE):
            return TransmitterSticks(mode=self._mode)
        if self._drops and since_s < _DROP_S:
            self._here_m[2] = max(1.0, float(sight.T_world_body[2, 3]))
            return TransmitterSticks(throttle=-1.0, mode=self._mode)
        error_m = self._goal_m(since_s) - sight.T_world_body[:3, 3]
        up_mps, seen_mps = float(np.clip(0.7 * error_m[2], -1.0, 1.0)), float(sight.v_world_mps[2])
        if self._mode == Mode.LOITER:
            v = np.clip(0.7 * error_m[:2], -1.0, 1.0)
            roll, pitch = feel.level(in_body(v, sight), in_body(sight.v_world_mps[:2], sight))
        else:
            roll, pitch = _leaning(error_m, sight)
        if self._mode == Mode.STABILIZE:
            throttle = _thrust(up_mps, seen_mps)
        else:
            throttle = self._feel.throttle(since_s, up_mps, seen_mps)
        yaw_rad = transforms.yaw(sight.T_world_body)
        return TransmitterSticks(
            roll, pitch, throttle, float(np.clip(0.4 * yaw_rad, -0.3, 0.3)), self._mode
        )

    def _goal_m(self, since_s: float) -> np.ndarray:
        if not self._roams:
            return self._here_m
        angle_rad = 2.0 * math.pi * since_s / _ROAM_PERIOD_S
        way = math.sin(angle_rad) * np.array(
            [math.cos(self._phase_rad), math.sin(self._phase_rad), 0.3]
        )
        return self._here_m + _ROAM_M * way


def _leaning(error_m: np.ndarray, sight: PilotSight) -> Tuple[float, float]:
    """Roll and pitch in ALT_HOLD and STABILIZE, where a stick is a lean."""
    acc = np.clip(1.0 * error_m[:2] - 1.8 * sight.v_world_mps[:2], -2.0, 2.0)
    forward, left = in_body(acc, sight)
    roll, pitch = (float(np.clip(a / _G / _LEAN_RAD, -1.0, 1.0)) for a in (-left, forward))
    return roll, pitch


def _thrust(wanted_mps: float, seen_mps: float) -> float:
    """The throttle in STABILIZE, where it is a thrust."""
    up_mps2 = float(np.clip(1.5 * (wanted_mps - seen_mps), -3.0, 3.0))
    return float(np.clip(2.0 * _HOVER * (1.0 + up_mps2 / _G) - 1.0, -1.0, 1.0))
