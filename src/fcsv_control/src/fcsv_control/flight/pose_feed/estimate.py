# SPDX-License-Identifier: Apache-2.0
"""The autopilot's estimate held against the external navigation that it is fed.

A jump of the feed that the autopilot first rejects it adopts later, over seconds and in steps that
look like flight. So successive estimates do not show it; estimate and feed together do: the feed
with its jumps taken out goes on as the vehicle flew, and what the estimate moves against that is
the frame's, not the vehicle's.
"""

import math
from typing import Optional, Sequence

import numpy as np

from fcsv_geometry.rotations import Vector

# of the feed against its own speed, between two poses; noise and gusts make a quarter of that
JUMP_M = 0.2
_ACC_MPS2 = 8.0  # no vehicle here changes its speed faster
_GAP_S = 0.5  # a feed that was silent for longer begins anew
_AHEAD_S = 0.2  # as far as the newest pose may be carried on by its speed
_ZERO: Vector = (0.0, 0.0, 0.0)
MOVED_M = 0.3  # of the estimate against the feed without its jumps; lag and noise make half of that


def apart_m(p_fed: Optional[Sequence[float]], p_estimate: Optional[Sequence[float]]) -> float:
    """Distance of a pose of the feed and the autopilot's estimate (m), positions (3,) in the
    odometry frame; NaN where one of them is not known, so that no bound is passed by it.

    >>> apart_m((0.0, 0.0, 0.0), (3.0, 0.0, 4.0)), apart_m(None, (0.0, 0.0, 0.0)) > 0.5
    (5.0, False)
    """
    return math.nan if p_fed is None or p_estimate is None else math.dist(p_fed, p_estimate)


class EstimateWatch:
    """Told the feed's poses and the estimates, it says when the estimate moved (m, odometry
    frame)."""

    def __init__(self):
        self.begin()

    def begin(self) -> None:
        """Nothing of before counts."""
        self._p: Optional[Vector] = None  # the feed's newest
        self._stamp_s = self._heard_s = 0.0
        self._v = _ZERO
        self._jumped = _ZERO  # what the feed jumped in all
        # what the estimate moved against the feed without jumps, as far as it was told
        self._moved = _ZERO
        self._estimate: Optional[Vector] = None

    def pose_sent(self, now_s: float, stamp_s: float, p: np.ndarray, begun_anew: bool) -> None:
        """A pose that went to the autopilot. ``begun_anew``: its frame is another than before."""
        dt_s = stamp_s - self._stamp_s
        before, self._p = self._p, tuple(p.tolist())
        self._stamp_s, self._heard_s = stamp_s, now_s
        if before is None or not 0.0 < dt_s <= _GAP_S:
            # the estimate is the better witness of what was flown meanwhile
            if self._estimate is not None:
                self._jumped = _minus(_plus(self._p, self._moved), self._estimate)
            self._v = _ZERO
            return
        step, v = _minus(self._p, before), self._v
        off = _minus(step, (v[0] * dt_s, v[1] * dt_s, v[2] * dt_s))
        if begun_anew or math.hypot(*off) > JUMP_M + 0.5 * _ACC_MPS2 * dt_s**2:
            self._jumped = _plus(self._jumped, off)
        else:
            share = 0.5 / dt_s
            self._v = (
                0.5 * v[0] + share * step[0],
                0.5 * v[1] + share * step[1],
                0.5 * v[2] + share * step[2],
            )

    def estimate(self, now_s: float, p: np.ndarray, armed: bool) -> Optional[np.ndarray]:
        """The autopilot's estimate; by what it moved (3,) since that was told last, None where it
        did not."""
        self._estimate = tuple(p.tolist())
        here = self._here(now_s)
        if here is None:
            return None
        moved = _minus(_minus(self._estimate, _minus(here, self._jumped)), self._moved)
        if armed and math.hypot(*moved) <= MOVED_M:
            return None
        self._moved = _plus(self._moved, moved)
        return np.array(moved) if armed else None  # disarmed nobody holds a target

    def apart_m(self, now_s: float) -> float:
        """Measures the distance of the feed as it goes on until now, and the newest estimate."""
        return apart_m(self._here(now_s), self._estimate)

    def _here(self, now_s: float) -> Optional[Vector]:
        if self._p is None or now_s - self._heard_s > _GAP_S:
            return None
        ahead_s, v = min(max(now_s - self._heard_s, 0.0), _AHEAD_S), self._v
        return _plus(self._p, (v[0] * ahead_s, v[1] * ahead_s, v[2] * ahead_s))


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
