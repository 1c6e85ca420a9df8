# SPDX-License-Identifier: Apache-2.0
"""The Tello's Wi-Fi: packets are late, lost and cut off; how strong it is goes with the distance.

Delay and loss as measured on a real one (notes of tellopy on sensor times, 2026-09: round trips of
5 ms at least, 44 ms in the median, 124 ms at 95 %, 200 ms at 99 %, 2 % never answered): 2.5 ms and
an exponential of 24 ms each way give that.
"""

from collections import deque
from dataclasses import dataclass
from typing import Deque, List, Tuple

import numpy as np

_FULL_AT_M = 3.0
_STRONGEST = 90  # the most that the real one says


@dataclass(frozen=True)
class WifiParameters:
    """Describes the radio of both ways. ``cuts``: pairs of start and length (s) after the start, in
    which nothing passes."""

    least_delay_s: float = 0.0025
    mean_delay_s: float = 0.024  # beyond the least
    loss: float = 0.01
    strength_per_decade: float = 40.0  # lost for ten times the distance
    weak: float = 40.0  # below, losses rise to all at 0
    cuts: Tuple[Tuple[float, float], ...] = ()

    def __post_init__(self):
        if min(self.least_delay_s, self.mean_delay_s) < 0.0 or not 0.0 <= self.loss <= 1.0:
            raise ValueError("radio: delays must not be negative, loss must be 0 to 1")


class SimulatedWifi:
    """Two queues: send() puts a packet on its way, arrived() gives those whose time has come, in
    order."""

    def __init__(self, parameters: WifiParameters, seed: int, now_s: float):
        self._p = parameters
        self._random = np.random.default_rng([seed, 43])
        self._cuts = [(now_s + start, now_s + start + length) for start, length in parameters.cuts]
        self._ways: Tuple[Deque[tuple], Deque[tuple]] = (deque(), deque())
        self.strength = _STRONGEST

    def cut(self, now_s: float, length_s: float) -> None:
        """Nothing passes from now on for so long."""
        self._cuts.append((now_s, now_s + length_s))

    def move(self, distance_m: float) -> None:
        """How far the vehicle is from who flies it."""
        lost = self._p.strength_per_decade * np.log10(max(distance_m, _FULL_AT_M) / _FULL_AT_M)
        self.strength = int(max(0.0, _STRONGEST - lost))

    def send(self, now_s: float, up: bool, what) -> None:
        """``up``: to the vehicle."""
        p = self._p
        loss = min(1.0, p.loss + max(0.0, 1.0 - self.strength / p.weak))
        if any(start <= now_s < end for start, end in self._cuts) or self._random.uniform() < loss:
            return
        due_s = (
            now_s
            + p.least_delay_s
            + (self._random.exponential(p.mean_delay_s) if p.mean_delay_s else 0.0)
        )
        way = self._ways[up]
        # packets do not overtake each other
        way.append((max(due_s, way[-1][0]) if way else due_s, what))

    def arrived(self, now_s: float, up: bool) -> List:
        """What has come through by now."""
        way, come = self._ways[up], []
        while way and way[0][0] <= now_s:
            come.append(way.popleft()[1])
        return come
