# SPDX-License-Identifier: Apache-2.0
"""Messages that the control PC sent to everybody: calibration, home and the times of the
recordings.

Its own bag holds them, and those of the vehicles hold what they heard of it by radio: a session can
lose control.bag.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Collection, Dict, List, Optional, Tuple

from fcsv_geometry.errors import GeometryError
from fcsv_geometry.messages import pose_to_transform, seconds
from fcsv_geometry.vehicles import home_messages

CAPTURE, CALIBRATION, HOME = "/mission/capture", "/calibration", "/home"
TYPES = {CAPTURE: "fcsv_msgs/Capture", CALIBRATION: "fcsv_msgs/Calibration", HOME: "fcsv_msgs/Home"}


@dataclass
class BroadcastRecords:
    """Messages by their topic and by the machine that recorded them, of which the newest of a
    machine counts."""

    _once: Dict[Tuple[str, str], object] = field(default_factory=dict)  # by topic and machine
    _calibrations: Dict[float, object] = field(default_factory=dict)  # all, by stamp
    _captures: Dict[str, Dict[int, object]] = field(default_factory=dict)  # by machine and index
    _refused_s: Dict[str, float] = field(default_factory=dict)  # stamp of the newest by topic

    def add(self, bag: Path, topic: str, message) -> None:
        """A message of ``TYPES`` from a bag; bags of one machine come in order. Raises
        GeometryError if it is none."""
        try:
            _CHECKS[topic](message)
        except GeometryError:
            self._refused_s[topic] = max(_stamp_s(message), self._refused_s.get(topic, -math.inf))
            raise
        if topic == CAPTURE:
            self._captures.setdefault(_machine(bag), {})[message.index] = message
        else:
            self._once[topic, _machine(bag)] = message
        if topic == CALIBRATION:
            self._calibrations[_stamp_s(message)] = message

    def newest(self, topic: str) -> Optional[object]:
        """The calibration or home that counts; None where nobody recorded any."""
        return max(
            (m for (t, _), m in self._once.items() if t == topic), key=_stamp_s, default=None
        )

    def calibrations(self) -> List:
        """The calibration by which home was set, and those in flight after it, in their order."""
        home = self.newest(HOME)
        home_s = float("inf") if home is None else _stamp_s(home)
        stamps = sorted(self._calibrations)
        before, after = [s for s in stamps if s <= home_s], [s for s in stamps if s > home_s]
        return [self._calibrations[s] for s in before[-1:] + after]

    def newest_is_refused(self, topic: str) -> bool:
        """Whether the calibration or home that would count is none: an earlier one is of other
        frames."""
        newest = self.newest(topic)
        return topic in self._refused_s and (
            newest is None or _stamp_s(newest) < self._refused_s[topic]
        )

    def captures(self, vehicles: Collection[str]) -> List:
        """One of each index, by index. Of what only ``vehicles`` heard, none of a flight before
        home was set."""
        home = self.newest(HOME)
        since_s = float("-inf") if home is None else _stamp_s(home)
        found: Dict[int, object] = {}
        for machine, captures in self._captures.items():
            for index, message in captures.items():
                earlier = machine in vehicles and _stamp_s(message) < since_s
                if not earlier and (
                    index not in found or _stamp_s(message) > _stamp_s(found[index])
                ):
                    found[index] = message
        return [found[index] for index in sorted(found)]

    def from_vehicles(self, vehicles: Collection[str]) -> str:
        """What of the session only ``vehicles`` recorded, as a warning; empty where the control PC
        recorded it all."""
        own = {t for t, machine in self._once if machine not in vehicles}
        by_control = {
            i
            for machine, captures in self._captures.items()
            if machine not in vehicles
            for i in captures
        }
        windows = [c.index for c in self.captures(vehicles) if c.index not in by_control]
        lost = [t for t in (CALIBRATION, HOME) if t not in own and self.newest(t) is not None]
        lost += (
            [f"{CAPTURE} of {len(windows)} configuration{'s' if len(windows) > 1 else ''}"]
            if windows
            else []
        )
        if not lost:
            return ""
        return (
            f"control.bag is missing or lacks {', '.join(lost)}: taken from what the vehicles heard by radio; a "
            "recording that ended while the radio was cut is not in the map"
        )


def _check_capture(message) -> None:
    start_s, stop_s = seconds(message.start), seconds(message.stop)
    if not stop_s > start_s:
        raise GeometryError(f"its window ends at {stop_s:.3f}, before it begins at {start_s:.3f}")
    c = message.configuration
    if not (math.isfinite(c.baseline_m) and math.isfinite(c.tilt_rad) and c.baseline_m >= 0.0):
        raise GeometryError(
            f"its configuration has a baseline of {c.baseline_m} m and a tilt of {c.tilt_rad} rad"
        )


_CHECKS = {
    CAPTURE: _check_capture,
    CALIBRATION: home_messages.links_from_message,
    HOME: lambda message: pose_to_transform(message.home_in_odom),
}


def _machine(bag: Path) -> str:
    """
    >>> _machine(Path("session/uav1.2.bag"))
    'uav1'
    """
    return bag.name.partition(".")[0]


def _stamp_s(message) -> float:
    return seconds(message.header.stamp)
