# SPDX-License-Identifier: Apache-2.0
"""How a pilot gets the velocity that he wants out of a vehicle whose sticks he does not know: he
pushes more where it is too slow, and learns where the dead band of the throttle ends."""

import math
from typing import Sequence, Tuple

import numpy as np

_CLIMB_MPS = 2.5  # what he expects of the whole throttle stick, upwards and downwards
# of the throttle: what he expects at first, and may learn
_DEAD, _LEAST_DEAD, _MOST_DEAD = 0.1, 0.05, 0.3
_LEARNS_PER_S, _LEARNS_MOST = 0.3, 0.08  # per m/s that it is too slow, and per second
_AFTER_S = 0.7  # it answers a stick so late
_LOITER_MPS = 3.5  # of the whole stick: ArduCopter's default is twice, what is advised half of it
_PER_MPS = 0.4  # stick for each m/s that it is slower than wanted
_LEVEL_DEAD = 0.05  # what he pushes over where he wants it to move at all
_LEAST = 0.013


class Feel:
    """One pilot's hands on one vehicle."""

    def __init__(self):
        self._dead = _DEAD
        self._looked_s = self._since_s = -math.inf
        self._way = 0.0  # up or down

    def throttle(self, now_s: float, wanted_mps: float, seen_mps: float) -> float:
        """-1..1, for a climb in LOITER and ALT_HOLD."""
        way = math.copysign(1.0, wanted_mps) if abs(wanted_mps) > 0.03 else 0.0
        passed_s, self._looked_s = min(0.1, now_s - self._looked_s), now_s
        if way != self._way:
            self._way, self._since_s = way, now_s
        if not way:
            return 0.0
        if now_s - self._since_s > _AFTER_S:
            slow_mps = way * (wanted_mps - seen_mps)
            learnt = max(-_LEARNS_MOST, min(_LEARNS_MOST, _LEARNS_PER_S * slow_mps)) * passed_s
            self._dead = max(_LEAST_DEAD, min(_MOST_DEAD, self._dead + learnt))
        return _clip(way * (self._dead + (1.0 - self._dead) * abs(wanted_mps) / _CLIMB_MPS))


def level(wanted_mps: Sequence[float], seen_mps: Sequence[float]) -> Tuple[float, float]:
    """Roll and pitch (-1..1) in LOITER, for a velocity forward and left; where he wants none he
    lets go."""
    forward, left = (_push(w, v) if any(wanted_mps) else 0.0 for w, v in zip(wanted_mps, seen_mps))
    return _clip(-left), _clip(forward)


def _push(wanted_mps: float, seen_mps: float) -> float:
    stick = wanted_mps / _LOITER_MPS + _PER_MPS * (wanted_mps - seen_mps)
    return (
        0.0
        if abs(stick) < _LEAST
        else math.copysign(_LEVEL_DEAD + (1.0 - _LEVEL_DEAD) * abs(stick), stick)
    )


def deflection(value: float, dead: float) -> float:
    """A deflection that gets over the dead band, or none."""
    if abs(value) < dead / 3:
        return 0.0
    return _clip(math.copysign(max(abs(value), dead + 0.01), value))


def _clip(value: float) -> float:
    return float(np.clip(value, -1.0, 1.0))
