# SPDX-License-Identifier: Apache-2.0
"""A list of way-points as positions over time, under limits of speed and acceleration."""

from dataclasses import dataclass
from typing import Sequence, Tuple

import numpy as np

from fcsv_geometry.missions.flight_limits import FlightBounds

STEP_S = 0.1
#: A vehicle is so much before and behind its time at most, else it is not on its timed way: orders
#: that come late over the radio, wind, the last half metre, on which an autopilot slows down more
#: than the ramp.
EARLY_S, LATE_S = 1.0, 2.5


@dataclass(frozen=True)
class TimedWay:
    """Leads from standing to standing at every way-point. ``begins_s``: when each leg begins;
    ``places`` (N, 3), m, one every ``STEP_S`` from time 0 on; after the last it stands at the
    goal."""

    begins_s: Tuple[float, ...]
    ends_s: float
    places: np.ndarray

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Places (N, 3) at times (N,), before the first and after the last as there."""
        steps = np.clip(np.rint(np.asarray(times_s) / STEP_S).astype(int), 0, len(self.places) - 1)
        return self.places[steps]

    def off_m(self, place: np.ndarray, now_s: float) -> float:
        """How far (m) a place (3,) is from where the vehicle may be at a time."""
        where = self.at(np.arange(now_s - LATE_S, now_s + EARLY_S + STEP_S / 2, STEP_S))
        return float(np.linalg.norm(where - place, axis=1).min())


def timed_way(
    start: np.ndarray, way: Sequence[np.ndarray], bounds: FlightBounds, delay_s: float = 0.0
) -> TimedWay:
    """The way over its points (3,), begun ``delay_s`` late.

    >>> way = timed_way(np.zeros(3), [np.array([8.0, 0.0, 0.0])], FlightBounds(acceleration_mps2=1.0), delay_s=1.0)
    >>> way.ends_s, way.at(np.array([1.0, 4.0, 9.0]))[:, 0].tolist()
    (7.0, [0.0, 4.0, 8.0])
    """
    begins, places, at_s = [], [np.tile(start, (int(round(delay_s / STEP_S)) + 1, 1))], delay_s
    for a, b in zip([start, *way], way):
        begins.append(at_s)
        shares, takes_s = _shares(b - a, bounds)
        places.append(a + shares[:, None] * (b - a))
        at_s += takes_s
    return TimedWay(tuple(begins), at_s, np.concatenate(places))


def _shares(leg: np.ndarray, bounds: FlightBounds) -> Tuple[np.ndarray, float]:
    """Gives, of a leg (3,): how much is behind after each step, and its time (s), a whole number of
    steps."""
    level_m, length_m = float(np.hypot(leg[0], leg[1])), float(np.linalg.norm(leg))
    steps = max(1, int(np.ceil(bounds.leg_s(level_m, float(leg[2])) / STEP_S)))
    if length_m < 1e-6:
        return np.ones(1), STEP_S
    speed_mps, acceleration_mps2 = bounds.along(level_m, float(leg[2]))
    t_s = np.arange(1, steps + 1) * STEP_S
    ends_s = bounds.leg_s(level_m, float(leg[2]))
    ramp_s = min(speed_mps / acceleration_mps2, ends_s / 2.0)
    top_mps = acceleration_mps2 * ramp_s
    left_s = np.maximum(ends_s - t_s, 0.0)
    rising, falling = (
        0.5 * acceleration_mps2 * t_s**2,
        length_m - 0.5 * acceleration_mps2 * left_s**2,
    )
    level = top_mps * (t_s - ramp_s / 2.0)
    flown = np.where(t_s < ramp_s, rising, np.where(left_s < ramp_s, falling, level))
    return np.clip(flown / length_m, 0.0, 1.0), steps * STEP_S
