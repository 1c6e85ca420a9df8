# SPDX-License-Identifier: Apache-2.0
"""The radio between the vehicles and the control PC: delay, loss, cuts, and buffers that hold
messages up."""

import heapq
import itertools
import math
from dataclasses import dataclass
from typing import Any, Callable, List, Tuple

import numpy as np

# ages at which the relay drops a message: classes of config/links/default.yaml
STATE_S, CRITICAL_S = 1.0, 5.0


@dataclass(frozen=True)
class RadioQuality:
    """Delay (s) and its jitter; share of messages that get lost, each way."""

    delay_s: float = 0.02
    jitter_s: float = 0.01
    loss: float = 0.01


class Radio:
    """Messages of one vehicle, both ways, each delivered by a call. ``cut`` until it is False again
    loses all.

    ``held_until_s``: what is sent before then waits in a buffer on the way, and comes in a burst at
    that time.
    """

    def __init__(self, quality: RadioQuality, seed: int):
        self.quality, self.cut = quality, False
        self.held_until_s = -math.inf
        self._random = np.random.default_rng([seed, 21])
        self._numbers = itertools.count()
        self._flying: List[Tuple[float, int, Callable[[Any], None], Any]] = []

    def send(
        self, now_s: float, deliver: Callable[[Any], None], message: Any, lives_s: float = STATE_S
    ) -> None:
        """``deliver(message)`` after the delay, unless it gets lost. The relay at the other end
        drops what is older than ``lives_s`` then."""
        if self.cut or self._random.random() < self.quality.loss:
            return
        arrives_s = now_s + self.quality.delay_s + self.quality.jitter_s * self._random.random()
        arrives_s = max(arrives_s, self.held_until_s)
        if arrives_s - now_s <= lives_s:
            heapq.heappush(self._flying, (arrives_s, next(self._numbers), deliver, message))

    def step(self, now_s: float) -> None:
        """Deliver what has arrived."""
        while self._flying and self._flying[0][0] <= now_s:
            _, _, deliver, message = heapq.heappop(self._flying)
            deliver(message)
