# SPDX-License-Identifier: Apache-2.0
"""What was dropped: counted for the diagnostics, told once in five seconds per reason."""

import threading
import time
from typing import Callable, Dict

import rospy

from fcsv_geometry.ros.health import Health

_QUIET_S = 5.0


class Drops:
    """Callable as ``drop(reason, detail)`` from any thread. ``clock`` gives seconds."""

    def __init__(self, health: Health, clock: Callable[[], float] = time.monotonic):
        self._health, self._clock = health, clock
        self._lock = threading.Lock()
        self._counts: Dict[str, int] = {}
        self._told_s: Dict[str, float] = {}

    def __call__(self, reason: str, detail: str) -> None:
        now_s = self._clock()
        with self._lock:
            count = self._counts[reason] = self._counts.get(reason, 0) + 1
            quiet = now_s - self._told_s.get(reason, float("-inf")) < _QUIET_S
            if not quiet:
                self._told_s[reason] = now_s
        self._health.value(f"dropped: {reason}", count)
        if not quiet:
            rospy.logwarn("dropped: %s: %s (%d so far)", reason, detail, count)
