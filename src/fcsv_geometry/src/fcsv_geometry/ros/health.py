# SPDX-License-Identifier: Apache-2.0
"""A node's health as diagnostics: rates of what flows, counts of what was dropped, and what is
wrong now."""

import re
import threading
import time
from typing import Dict, Optional

import diagnostic_updater
import rospy
from diagnostic_msgs.msg import DiagnosticStatus

from fcsv_geometry.ros import node
from fcsv_geometry.streams.flow import DropCounter
from fcsv_geometry.vehicles.telemetry import Diagnosis

_COUNTS_UP = re.compile(r"-?\d+(\.\d+)?(?= (s|m)\b)")


def without_numbers(text: str) -> str:
    """What stays the same of a text while its seconds and metres count up.

    >>> without_numbers("uav2: no fix for 16.5 s")
    'uav2: no fix for # s'
    """
    return _COUNTS_UP.sub("#", text)


class Health:
    """Published once a second. ``flows`` maps a flow's name to the rate (Hz) below which it is a
    warning."""

    def __init__(self, hardware_id: str, flows: Optional[Dict[str, float]] = None):
        self._lock = threading.Lock()
        self._flows = dict(flows or {})
        self._ticks = dict.fromkeys(self._flows, 0)
        self._drops = DropCounter()
        self._values: Dict[str, str] = {}
        self._problems: Dict[str, str] = {}
        self._since_s = time.monotonic()
        self._updater = diagnostic_updater.Updater()
        self._updater.setHardwareID(hardware_id)
        self._updater.add("health", self._report)
        # update() would wait for a time of its own, which may lie ahead
        self._timer = node.every(1.0, lambda _event: self._updater.force_update())

    def tick(self, flow: str) -> None:
        """One message of a flow went through."""
        with self._lock:
            self._ticks[flow] = self._ticks.get(flow, 0) + 1

    def drop(self, reason: str, detail: str = "") -> None:
        """Something was dropped, from any thread: counted for the diagnostics, told now and then
        per reason."""
        count = self._drops.count(reason)
        if self._drops.tells(reason, time.monotonic()):
            rospy.logwarn(
                "dropped: %s%s (%d so far)", reason, f": {detail}" if detail else "", count
            )

    def value(self, name: str, value) -> None:
        with self._lock:
            self._values[name] = str(value)

    def problem(self, name: str, text: str) -> None:
        """An error that stands until it is cleared with an empty text. It is logged anew where more
        of it changes than seconds and metres, which count up."""
        with self._lock:
            if text and without_numbers(self._problems.get(name, "")) != without_numbers(text):
                rospy.logerr("%s", text)
            if text:
                self._problems[name] = text
            else:
                self._problems.pop(name, None)

    def diagnose(self, m: Diagnosis) -> None:
        """Takes what a port says of itself."""
        for name, text in m.problems.items():
            self.problem(name, text)
        for name, value in m.values.items():
            self.value(name, value)

    def _report(self, status):
        with self._lock:
            elapsed_s = max(time.monotonic() - self._since_s, 1e-3)
            self._since_s = time.monotonic()
            rates = {name: ticks / elapsed_s for name, ticks in self._ticks.items()}
            self._ticks = dict.fromkeys(self._ticks, 0)
            slow = [name for name, least in self._flows.items() if rates.get(name, 0.0) < least]
            status.summary(DiagnosticStatus.OK, "well")
            if slow:
                status.summary(DiagnosticStatus.WARN, "slow or silent: " + ", ".join(slow))
            if self._problems:
                status.summary(DiagnosticStatus.ERROR, "; ".join(self._problems.values()))
            for name, rate in rates.items():
                status.add(f"{name} [Hz]", f"{rate:.1f}")
            for name, count in self._drops.items():
                status.add(f"dropped: {name}", str(count))
            for name, value in self._values.items():
                status.add(name, value)
        return status
