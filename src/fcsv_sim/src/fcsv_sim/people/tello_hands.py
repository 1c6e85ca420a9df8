# SPDX-License-Identifier: Apache-2.0
"""Who flies a Tello by hand until the mission does, and the operator at the screen.

They know what their screens show: the vehicle's odometry, whether the tracker sees it, the
mission's state. Nothing here knows the simulation's truth.
"""

from dataclasses import dataclass, field
from typing import Dict, Optional, Sequence

import numpy as np

from fcsv_control.tello.pid import PidConfig, PositionPid, Sticks
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode

TAKE_OFF, LAND = "take off", "land"
_BY_HAND = ("TAKE_OFF", "COLUMN", "CALIBRATE", "MOVE_HOME", "SET_HOME")
_SWAYING = ("COLUMN", "CALIBRATE")
_ENDS = ("LAND", "DONE", "ABORTED")
# who flies by hand lands when told; a mission that lands gets so long to do it
_TOLD_S, _PATIENCE_S = 1.0, 15.0
_AGAIN_S = 3.0
_UP_M = 0.35  # below its height it climbs still
_SWAY_PERIOD_S = 8.0
_JUMP_M = 0.25  # between two poses: the frame changed, not the place
_STEP_S = 0.2
_SEEN_HZ = 4.0  # so many poses of the tracker a second: it sees the vehicle
_CALM_MPS, _CALM_S = 0.2, 2.0


@dataclass(frozen=True)
class Screen:
    """Shows the state of one vehicle: T_odom_body by its link (None: nothing yet), velocity in the
    body (m/s), the tracker's rate."""

    armed: bool = False
    mode: Mode = Mode.UNHEARD
    T_odom_body: Optional[np.ndarray] = None
    v_body_mps: np.ndarray = field(default_factory=lambda: np.zeros(3))
    feed_hz: float = 0.0

    @property
    def tracked(self) -> bool:
        """Whether the tracker sees it."""
        return self.feed_hz >= _SEEN_HZ


@dataclass(frozen=True)
class Act:
    """What the hands do now: sticks, and an order where there is one."""

    sticks: Sticks = Sticks()
    order: str = ""


class TelloHands:
    """``act`` at each look. ``sway_m``: how far all sway sideways until the tracker knows their
    headings. ``heading_rad``: to which they turn in the tracker's frame; before it sees them, as they
    took off."""

    def __init__(self, gains: PidConfig, height_m: float, sway_m: float, heading_rad: float = 0.0):
        self._pid, self._height_m, self._sway_m = PositionPid(gains), height_m, sway_m
        self._heading_rad, self._tracked = heading_rad, False
        self._hold_m: Optional[np.ndarray] = None
        self._seen: Optional[np.ndarray] = None
        self._phase, self._since_s, self._looked_s, self._ordered_s = "", 0.0, 0.0, float("-inf")

    def act(self, now_s: float, phase: str, screen: Screen) -> Act:
        """``now_s``: monotonic."""
        if phase != self._phase:
            self._phase, self._since_s = phase, now_s
        dt_s, self._looked_s = min(now_s - self._looked_s, _STEP_S), now_s
        self._follow_frame(screen.T_odom_body)
        if phase in _ENDS:
            return self._end(now_s, screen)
        if phase not in _BY_HAND or screen.mode != Mode.LOITER:
            return Act()
        if not screen.armed:
            return self._order(now_s, TAKE_OFF) if phase == "TAKE_OFF" else Act()
        return Act(self._sticks(now_s, dt_s, screen))

    def _end(self, now_s: float, screen: Screen) -> Act:
        patience_s = _TOLD_S if screen.mode == Mode.LOITER else _PATIENCE_S
        waits = not screen.armed or screen.mode == Mode.LAND or now_s - self._since_s < patience_s
        return Act() if waits else self._order(now_s, LAND)

    def _order(self, now_s: float, order: str) -> Act:
        if now_s - self._ordered_s < _AGAIN_S:
            return Act()
        self._ordered_s = now_s
        return Act(order=order)

    def _follow_frame(self, T_odom_body: Optional[np.ndarray]) -> None:
        """The tracker's frame takes the place of its own odometry's: what is held stays where it is
        in the air."""
        before, self._seen = self._seen, T_odom_body
        if before is None or T_odom_body is None or self._hold_m is None:
            return
        if np.linalg.norm(T_odom_body[:3, 3] - before[:3, 3]) > _JUMP_M:
            T_new_old = transforms.level(T_odom_body) @ transforms.invert(transforms.level(before))
            self._hold_m = transforms.apply(T_new_old, self._hold_m)

    def _sticks(self, now_s: float, dt_s: float, screen: Screen) -> Sticks:
        T = screen.T_odom_body
        if T is None:
            return Sticks()
        if self._hold_m is None:
            if T[2, 3] < self._height_m - _UP_M:
                return Sticks()  # its link climbs
            self._hold_m = np.array([*T[:2, 3], self._height_m])
        sways = self._phase != "TAKE_OFF" and (self._phase in _SWAYING or not screen.tracked)
        aside_m = self._sway_m * np.sin(2.0 * np.pi * now_s / _SWAY_PERIOD_S) if sways else 0.0
        self._tracked = self._tracked or screen.tracked
        yaw_rad = self._heading_rad if self._tracked else 0.0
        target = transforms.from_xyz_yaw(self._hold_m + [0.0, aside_m, 0.0], yaw_rad)
        return self._pid.sticks(dt_s, T, T[:3, :3] @ screen.v_body_mps, target)


class Finger:
    """Presses what is waited for, once it looks right for a while: everybody tracked, and calm
    unless they sway."""

    def __init__(self):
        self._right_since_s: Optional[float] = None

    def press(self, now_s: float, waits_for: str, screens: Dict[str, Screen]) -> bool:
        """Whether to press the button now."""
        if not (waits_for and self._looks_right(waits_for, list(screens.values()))):
            self._right_since_s = None
            return False
        self._right_since_s = now_s if self._right_since_s is None else self._right_since_s
        if now_s - self._right_since_s < _CALM_S:
            return False
        self._right_since_s = None
        return True

    @staticmethod
    def _looks_right(waits_for: str, screens: Sequence[Screen]) -> bool:
        if waits_for == "resume" and not all(s.armed for s in screens):
            return True
        calm = waits_for == "calibrate" or all(
            np.linalg.norm(s.v_body_mps) < _CALM_MPS for s in screens
        )
        return calm and all(s.tracked for s in screens)
