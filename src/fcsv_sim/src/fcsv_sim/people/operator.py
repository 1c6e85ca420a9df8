# SPDX-License-Identifier: Apache-2.0
"""People with transmitters: one pilot per vehicle who sees it from the ground, and one who presses
the buttons.

They are not perfect: they react late, hands shake, decisions take time.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Deque, Dict, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.frozen import frozen
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.thresholds import BATTERY
from fcsv_sim.people import feel
from fcsv_sim.people.around import beside, kept_clear

_YAW_STICK_RPS = np.radians(100.0)
_LEAN_RAD = np.radians(30.0)
_REACTION_S = 0.3
_AHEAD_S = 0.9  # he pushes so long before a movement that he plans: his reaction, and the vehicle's
_BY_HAND = ("TAKE_OFF", "COLUMN", "CALIBRATE", "MOVE_HOME", "SET_HOME")
_LAND_BY_HAND_S = 15.0  # a mission that lands gets so long to do it; then the pilot does
_TOLD_S = 1.0  # who flies by hand lands when the mission says so, after a moment
_DARK_S = 30.0  # with the control PC dead, who flies by hand lands after this
_LOW_S = 10.0  # and with a low battery after this
_NO_MISSION_S = 60.0  # and where no mission begins
# so long and so well he flies aside of who is beneath, before he lands
_BESIDE_S, _BESIDE_M = 15.0, 0.6
_FLICK_S = 0.3
_REFUSED_S = 1.0  # a mode that does not show by then was refused
# who is in LAND for so long and still flies runs after a lost position: down in ALT_HOLD
_NO_LANDING_S = 60.0
_RUNS_OFF_M = 30.0  # from where he wants it, in LOITER: likewise
_LOW_M = 0.5
_CALM_MPS = 0.25
_AGAINST = 0.7  # of the sway of those who sway against the one in front: its tag stays in view


@frozen
class TransmitterSticks:
    """-1..1: roll right, pitch forward, throttle up, yaw right; and the mode switch."""

    roll: float = 0.0
    pitch: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0
    mode: Mode = Mode.LOITER


@frozen
class PilotSight:
    """What a pilot sees: T_world_body, velocity (m/s, world), and on the screen armed, mode and the
    battery's share (NaN: not known); ``others`` are (3,) places of the other vehicles (world,
    m)."""

    T_world_body: np.ndarray
    v_world_mps: np.ndarray
    armed: bool
    mode: Mode
    battery_share: float = float("nan")
    others: Tuple[np.ndarray, ...] = ()


@dataclass(frozen=True)
class Field:
    """Where things are to happen (world frame): take-off, the column, then the starting point.

    The column is formed at the starting point's height and near it (thesis 6.4): what odometry
    drifts on the way from calibration to home is error in every baseline.
    """

    column_xy_m: Tuple[float, float] = (0.0, 0.0)
    take_off_height_m: float = 4.0
    start_xy_m: Tuple[float, float] = (1.0, 0.0)
    home_height_m: float = 8.0
    spacing_m: float = 3.5
    sway_m: float = 0.8
    sway_period_s: float = 8.0
    # in the column, of which all but the last sway as they are calibrated; 0: every second one does
    vehicles: int = 0


class Pilot:
    """One pilot: from what is to be done and seen to sticks. Takes time (s) as an argument; it must
    rise."""

    def __init__(self, index: int, field: Field, seed: int):
        self._index = index
        self._field = field
        self._random = np.random.default_rng([seed, 4, index])
        self._seen: Deque[Tuple[float, PilotSight]] = deque()
        self._phase, self._phase_since_s = "", 0.0
        self._arming_since_s: Optional[float] = None
        self._switched_s = float("-inf")
        self._airborne = False
        self._switch = Mode.ALT_HOLD
        self._shake = np.zeros(3)
        self._feel = feel.Feel()
        # when the screen told a phase, and a battery that is not low
        self._screen_s = self._full_s = float("-inf")
        self._landing_s: Optional[float] = None  # since when he lands by hand
        self._beside: Optional[np.ndarray] = None  # where, if not here
        self._in_land_s: Optional[float] = None  # since when it has been in LAND
        self._by_thrust_s: Optional[float] = None  # since when in STABILIZE with his hands off

    def sticks(self, now_s: float, phase: str, sight: PilotSight) -> TransmitterSticks:
        """Sticks for the mission's phase, which is empty while the control PC is dead; what is seen
        is acted upon 0.3 s later."""
        sight = self._reacted_to(now_s, sight)
        if phase not in ("", self._phase):
            self._phase, self._phase_since_s = phase, now_s
        self._screen_s = now_s if phase else self._screen_s
        self._full_s = self._full_s if sight.battery_share < BATTERY.pilot.red else now_s
        sticks = self._decide(now_s, self._phase, sight)
        self._switch = sticks.mode
        return sticks

    def land_by_hand(self, now_s: float, sight: PilotSight) -> TransmitterSticks:
        """LAND, to the end; beside who is beneath, if that can be flown to in time."""
        if self._landing_s is None:
            self._landing_s, self._beside = now_s, beside(sight.T_world_body[:3, 3], sight.others)
            if sight.mode == Mode.LAND or self._runs_off(now_s, sight):
                self._landing_s -= _BESIDE_S + _NO_LANDING_S
        since_s = now_s - self._landing_s
        if self._beside is None or since_s > _BESIDE_S:
            return (
                TransmitterSticks(mode=Mode.LAND)
                if since_s < _BESIDE_S + _NO_LANDING_S
                else self._bring_down(sight)
            )
        if since_s < _FLICK_S and sight.mode != Mode.LOITER:
            return TransmitterSticks(
                mode=Mode.ALT_HOLD
            )  # the switch may be at LOITER already: away and back
        if np.linalg.norm((self._beside - sight.T_world_body[:3, 3])[:2]) < _BESIDE_M:
            self._beside = None
        return (
            TransmitterSticks(mode=Mode.LAND)
            if self._beside is None
            else self._fly_to(now_s, self._beside, np.zeros(3), sight)
        )

    def goal(self, now_s: float, phase: str) -> Tuple[np.ndarray, np.ndarray]:
        """Position (m) and velocity (m/s), world, that the pilot aims at."""
        f = self._field
        x, y = f.start_xy_m if phase in ("MOVE_HOME", "SET_HOME") else f.column_xy_m
        goal, v = np.array([x - f.spacing_m * self._index, y, f.home_height_m]), np.zeros(3)
        # every second one sways, or all but the last, each against the one in front
        against = self._index % 2
        if phase == "CALIBRATE" and (
            self._index < f.vehicles - 1 or (not f.vehicles and not against)
        ):
            w, t_s = 2 * np.pi / f.sway_period_s, now_s - self._phase_since_s
            sway_m = -_AGAINST * f.sway_m if against else f.sway_m
            goal[1] += sway_m * np.sin(w * t_s)
            v[1] = sway_m * w * np.cos(w * t_s)
            goal[2] += 0.15 * np.sin(1.7 * w * t_s)
        return goal, v

    def _reacted_to(self, now_s: float, sight: PilotSight) -> PilotSight:
        self._seen.append((now_s, sight))
        while len(self._seen) > 1 and self._seen[1][0] <= now_s - _REACTION_S:
            self._seen.popleft()
        return self._seen[0][1]

    @staticmethod
    def _bring_down(sight: PilotSight) -> TransmitterSticks:
        """Moves the sticks, in ALT_HOLD, which needs no position: against the way that it flies,
        and down."""
        forward, left = in_body(np.clip(-0.8 * sight.v_world_mps[:2], -2.0, 2.0), sight)
        lean = [_clip(a / 9.81 / _LEAN_RAD) for a in (-left, forward)]
        return TransmitterSticks(
            *lean, -0.6 if sight.T_world_body[2, 3] > _LOW_M else -1.0, 0.0, Mode.ALT_HOLD
        )

    def _runs_off(self, now_s: float, sight: PilotSight) -> bool:
        if sight.mode != Mode.LOITER or self._phase not in _BY_HAND:
            return False
        off_m = np.hypot(*(self.goal(now_s, self._phase)[0] - sight.T_world_body[:3, 3])[:2])
        return bool(off_m > _RUNS_OFF_M)

    def _must_land(self, now_s: float, phase: str, sight: PilotSight) -> bool:
        """Whether he lands what he flies by hand, whatever is to be done: a person would."""
        self._in_land_s = (self._in_land_s or now_s) if sight.mode == Mode.LAND else None
        if sight.mode == Mode.LAND:
            return now_s - self._in_land_s > _BESIDE_S + _NO_LANDING_S
        if sight.mode == Mode.GUIDED:
            return False
        waits_s = now_s - self._phase_since_s if phase == "WAIT_VEHICLES" else 0.0
        late = (
            now_s - self._screen_s > _DARK_S
            or now_s - self._full_s > _LOW_S
            or waits_s > _NO_MISSION_S
        )
        return late or self._runs_off(now_s, sight)

    def _decide(self, now_s: float, phase: str, sight: PilotSight) -> TransmitterSticks:
        if self._landing_s is not None and not sight.armed:
            return TransmitterSticks(throttle=-1.0, mode=Mode.ALT_HOLD)  # down for good
        if self._landing_s is not None or (sight.armed and self._must_land(now_s, phase, sight)):
            return self.land_by_hand(now_s, sight)
        if phase == "WAIT_VEHICLES" and sight.armed:
            # a mission that was started again in flight: hands off
            return self._hands_off(now_s, sight)
        if (phase == "WAIT_VEHICLES" and not self._airborne) or (
            phase in ("DONE", "ABORTED") and not sight.armed
        ):
            return TransmitterSticks(throttle=-1.0, mode=Mode.ALT_HOLD)
        if phase == "TAKE_OFF" and not (self._airborne and sight.mode == Mode.LOITER):
            return self._take_off(now_s, sight)
        if phase in _BY_HAND:
            goal, _ = self.goal(now_s - _REACTION_S, phase)  # as he sees it
            _, v_goal = self.goal(now_s - _REACTION_S + _AHEAD_S, phase)
            return self._fly_to(now_s, goal, v_goal, sight)
        if phase in ("LAND", "DONE", "ABORTED") and sight.mode != Mode.LAND:
            patience_s = _LAND_BY_HAND_S if sight.mode == Mode.GUIDED else _TOLD_S
            if now_s - self._phase_since_s > patience_s:
                return self.land_by_hand(now_s, sight)
        return self._hands_off(now_s, sight)  # the mission flies, or the autopilot lands

    def _hands_off(self, now_s: float, sight: PilotSight) -> TransmitterSticks:
        """Not in STABILIZE, where a stick in the middle climbs for ever: where his switch is
        refused, ALT_HOLD."""
        by_thrust = sight.armed and sight.mode == Mode.STABILIZE
        self._by_thrust_s = (self._by_thrust_s or now_s) if by_thrust else None
        return TransmitterSticks(
            mode=Mode.ALT_HOLD
            if by_thrust and now_s - self._by_thrust_s > _REFUSED_S
            else self._switch
        )

    def _take_off(self, now_s: float, sight: PilotSight) -> TransmitterSticks:
        if not sight.armed:
            return self._arm(now_s)
        z = sight.T_world_body[2, 3]
        target_z = self._field.take_off_height_m
        if z > target_z - 0.4:
            self._airborne = True
        if not self._airborne:
            roll, pitch = self._lean_back_to_column(sight)
            return TransmitterSticks(
                roll, pitch, 0.75 if z < target_z - 1.0 else 0.4, 0.0, Mode.ALT_HOLD
            )
        if now_s - self._switched_s > 2.5:  # refused (no position yet)? switch back and forth again
            self._switched_s = now_s
        roll, pitch = self._lean_back_to_column(sight)
        mode = Mode.ALT_HOLD if now_s - self._switched_s < 0.3 else Mode.LOITER
        return TransmitterSticks(roll, pitch, 0.0, 0.0, mode)

    def _arm(self, now_s: float) -> TransmitterSticks:
        """Throttle low, rudder right for three seconds; let go for one and try again."""
        if self._arming_since_s is None or now_s - self._arming_since_s > 4.0:
            self._arming_since_s = now_s + 0.3 * self._index
        rudder = 1.0 if 0.0 <= now_s - self._arming_since_s < 3.0 else 0.0
        return TransmitterSticks(throttle=-1.0, yaw=rudder, mode=Mode.ALT_HOLD)

    def _lean_back_to_column(self, sight: PilotSight) -> Tuple[float, float]:
        """Roll and pitch sticks in ALT_HOLD, where a stick is a lean."""
        goal, _ = self.goal(0.0, "COLUMN")
        error = goal[:2] - sight.T_world_body[:2, 3]
        acc = np.clip(0.5 * error - 1.2 * sight.v_world_mps[:2], -1.5, 1.5)
        forward, left = in_body(acc, sight)
        return _clip(-left / 9.81 / _LEAN_RAD), _clip(forward / 9.81 / _LEAN_RAD)

    def _fly_to(
        self, now_s: float, goal: np.ndarray, v_goal: np.ndarray, sight: PilotSight
    ) -> TransmitterSticks:
        """Sticks in LOITER, where a stick is a velocity, sooner or later."""
        error = goal - sight.T_world_body[:3, 3]
        v = v_goal + np.minimum(1.2, np.maximum(-1.2, 0.7 * error))
        if not v_goal.any():
            v[np.abs(error) < 0.08] = 0.0  # good enough: hands off
        v = kept_clear(v, sight.T_world_body[:3, 3], goal, sight.others)
        throttle = self._feel.throttle(now_s, float(v[2]), float(sight.v_world_mps[2]))
        # LOITER is refused without a position: there a stick is a lean
        if sight.mode in (Mode.STABILIZE, Mode.ALT_HOLD):
            forward, left = in_body(
                np.clip(1.5 * (v[:2] - sight.v_world_mps[:2]), -2.0, 2.0), sight
            )
            lean = [_clip(a / 9.81 / _LEAN_RAD) for a in (-left, forward)]
            mode = Mode.ALT_HOLD if sight.mode == Mode.STABILIZE else Mode.LOITER
            return TransmitterSticks(*lean, throttle, 0.0, mode)
        roll, pitch = feel.level(in_body(v[:2], sight), in_body(sight.v_world_mps[:2], sight))
        self._shake = 0.95 * self._shake + 0.004 * self._random.standard_normal(3)
        heading_rad = transforms.yaw(sight.T_world_body)
        return TransmitterSticks(
            roll=_clip(roll + self._shake[0]),
            pitch=_clip(pitch + self._shake[1]),
            throttle=throttle,
            yaw=feel.deflection(0.8 * heading_rad / _YAW_STICK_RPS, 0.05)
            if abs(heading_rad) > np.radians(1.5)
            else 0.0,
        )


def in_body(xy: np.ndarray, sight: PilotSight) -> Tuple[float, float]:
    """A horizontal world vector as forward and left of the vehicle."""
    yaw = transforms.yaw(sight.T_world_body)
    c, s = math.cos(yaw), math.sin(yaw)
    return c * xy[0] + s * xy[1], -s * xy[0] + c * xy[1]


def _clip(value: float) -> float:
    return min(1.0, max(-1.0, float(value)))


class ButtonPresser:
    """The operator at the screen: confirms what is waited for once it looks right, after a
    moment."""

    def __init__(self, delay_s: float = 1.5):
        self._delay_s = delay_s
        self._right_since_s: Optional[float] = None

    def press(
        self,
        now_s: float,
        waits_for: str,
        phase: str,
        sights: Dict[str, PilotSight],
        pilots: Sequence[Pilot],
    ) -> bool:
        """Whether to press the button now."""
        if waits_for == "resume":  # wherever they are: the mission brings them back; or one is down
            right = self._all_calm(sights) or not all(sight.armed for sight in sights.values())
        else:
            right = bool(waits_for) and (
                waits_for == "execute" or self._in_place(now_s, phase, sights, pilots)
            )
        if not right:
            self._right_since_s = None
            return False
        self._right_since_s = now_s if self._right_since_s is None else self._right_since_s
        if now_s - self._right_since_s < self._delay_s:
            return False
        self._right_since_s = None
        return True

    @staticmethod
    def _all_calm(sights: Dict[str, PilotSight]) -> bool:
        return all(math.hypot(*sight.v_world_mps.tolist()) < _CALM_MPS for sight in sights.values())

    @staticmethod
    def _in_place(
        now_s: float, phase: str, sights: Dict[str, PilotSight], pilots: Sequence[Pilot]
    ) -> bool:
        for sight, pilot in zip(sights.values(), pilots):
            goal, _ = pilot.goal(now_s, phase)
            far = math.dist(goal.tolist(), sight.T_world_body[:3, 3].tolist()) > 0.3
            if far or math.hypot(*sight.v_world_mps.tolist()) > _CALM_MPS:
                return False
        return True
