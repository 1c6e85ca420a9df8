# SPDX-License-Identifier: Apache-2.0
"""What the Tello does in the air by itself: takes off, holds, follows sticks, lands; time is given,
no I/O.

Sticks are lean angles, as in thesis 4.3. On a real one (flight of 2026-09-27 in tellopy's
tests/data) half a stick leans it by 6.5 degrees after 0.25 s and keeps the lean; so a full one is
13 degrees, 25 in fast mode. With its drag that ends at 4 and 8 m/s, the maker's speeds. An axis
that is let go is stopped and held by optical flow, which is a little off.
"""

import math
from dataclasses import dataclass
from typing import List, Optional, Tuple

import numpy as np

from fcsv_sim.tello.battery import TelloBattery
from fcsv_sim.tello.messages import FlyMode, TelloSticks

G_MPS2 = 9.81
LANDED, TAKING_OFF, FLYING, LANDING = "LANDED", "TAKE_OFF", "FLY", "LAND"
OFF = (0.0, 0.0, 0.0, 0.0)
_HOLD_PER_S, _TRIM_PER_S2 = 1.8, 0.6  # how an axis that is let go is stopped


@dataclass(frozen=True)
class FlightRules:
    """Angles in degrees. What is marked ? is not known of the real one."""

    lean_deg: float = 13.0  # at full stick
    fast_lean_deg: float = 25.0
    drag_per_s: float = 0.56  # with the airframe's own: full stick ends at 4 m/s, in fast mode at 8
    climb_mps: float = 1.0  # ? at full stick; twice that in fast mode
    turn_deg_per_s: float = 100.0  # ? at full stick
    dead_band: float = 0.02  # ? of a stick
    # until the lean begins: 165 ms of the way from stick to reading are measured
    stick_delay_s: float = 0.08
    let_go_s: float = 0.5  # ? sticks that do not come again are let go
    alone_s: float = 15.0  # without any command it lands
    hover_at_m: float = 0.9
    take_off_mps: float = 0.6
    sink_mps: float = 0.4
    height_limit_m: float = 10.0
    lean_limit_deg: float = 25.0  # what the protocol's attitude limit sets
    sees_ground_m: Tuple[float, float] = (0.2, 10.0)  # between them the flow sensor works


@dataclass
class Felt:
    """What its own sensors say: height (m), velocity in the world (m/s), heading (rad), whether
    flow is to be had."""

    height_m: float
    v_world_mps: np.ndarray
    yaw_rad: float
    sees_ground: bool


class TelloFlight:
    """Commands as they come; decide() every pass gives roll, pitch (rad), yaw rate (rad/s), thrust
    (share)."""

    def __init__(
        self, rules: FlightRules, battery: TelloBattery, hover_thrust: float, now_s: float
    ):
        self.rules, self.battery = rules, battery
        self._hover = hover_thrust
        self.state = LANDED
        self.height_limit_m, self.lean_limit_deg = rules.height_limit_m, rules.lean_limit_deg
        self._heard_s, self._flown_s = now_s, 0.0
        self._sticks: List[Tuple[float, TelloSticks]] = []
        self._hold_m: Optional[float] = None
        self._climb_integral = 0.0
        self._trim_mps2 = np.zeros(2)  # against wind, in the world
        self.why_landing, self._moved = "", False

    # -- commands
    # ---------------------------------------------------------------------------------------------------

    @property
    def flying(self) -> bool:
        return self.state != LANDED

    @property
    def flown_s(self) -> float:
        return self._flown_s

    @property
    def holds(self) -> bool:
        """Whether every axis is let go, and it stands."""
        return self._hold_m is not None and self.state == FLYING and not self._moved

    def mode(self, felt: Felt) -> FlyMode:
        """Names the mode as the flight data names it."""
        if self.state in (TAKING_OFF, LANDING):
            return FlyMode.TAKE_OFF if self.state == TAKING_OFF else FlyMode.LANDING
        return FlyMode.POSITION if felt.sees_ground or not self.flying else FlyMode.ATTITUDE

    def on_command(self, now_s: float) -> None:
        """A command of any kind: it is not alone."""
        self._heard_s = now_s

    def take_off(self) -> bool:
        """Whether it does: on the ground with a battery that is not low; in the air already is no
        reason to refuse."""
        if self.state == LANDED:
            if self.battery.low:
                return False
            self.state, self._hold_m, self._climb_integral = TAKING_OFF, None, 0.0
            self._trim_mps2, self.why_landing = np.zeros(2), ""
        return True

    def land(self, why: str = "") -> None:
        """``why``: "" where it is commanded, else why it does by itself."""
        if self.flying and self.state != LANDING:
            self.state, self.why_landing = LANDING, why

    def cancel_landing(self) -> None:
        """Stays where it is; what it does for its battery or alone cannot be cancelled."""
        if self.state == LANDING and not self.why_landing:
            self.state, self._hold_m = FLYING, None

    def stop_motors(self) -> None:
        """Stops the motors at once, also in the air."""
        self.state, self.why_landing = LANDED, "motors stopped"

    def sticks(self, now_s: float, sticks: TelloSticks) -> None:
        self._sticks = [*self._sticks[-20:], (now_s + self.rules.stick_delay_s, sticks)]

    # -- every pass
    # -------------------------------------------------------------------------------------------------

    def decide(
        self, now_s: float, dt_s: float, felt: Felt, on_ground: bool
    ) -> Tuple[float, float, float, float]:
        """What the airframe is told next; ``on_ground``: its legs bear its weight."""
        self._change_state(now_s, felt, on_ground)
        if not self.flying:
            return OFF
        self._flown_s += dt_s
        sticks = self._now(now_s) if self.state == FLYING else TelloSticks()
        self._moved = any(
            self._axis(s) for s in (sticks.roll, sticks.pitch, sticks.throttle, sticks.yaw)
        )
        lift = self._lift(self._climb(sticks, felt), dt_s, felt)
        forward, right = self._level(sticks, felt, dt_s)
        turn = -sticks.yaw * math.radians(self.rules.turn_deg_per_s)
        thrust = self._hover * (1.0 + lift / G_MPS2) / max(0.5, math.cos(right) * math.cos(forward))
        if self.state == LANDING and felt.height_m < 0.03:
            return right, forward, turn, 0.0
        return right, forward, turn, min(1.0, max(0.05, thrust))

    def _change_state(self, now_s: float, felt: Felt, on_ground: bool) -> None:
        if self.flying and self.battery.empty:
            self.stop_motors()
        elif self.flying and self.battery.critical:
            self.land("battery")
        elif self.flying and now_s - self._heard_s > self.rules.alone_s:
            self.land("alone")
        if self.state == TAKING_OFF and felt.height_m > self.rules.hover_at_m:
            self.state = FLYING
        if self.state == LANDING and on_ground:
            self.state = LANDED

    def _now(self, now_s: float) -> TelloSticks:
        """The sticks that count now; those that are not repeated are let go."""
        due = [(s, k) for s, k in self._sticks if s <= now_s]
        if not due or now_s - due[-1][0] > self.rules.let_go_s:
            return TelloSticks()
        return due[-1][1]

    def _axis(self, value: float) -> float:
        """A stick beyond its dead band."""
        band = self.rules.dead_band
        return (
            math.copysign((abs(value) - band) / (1.0 - band), value) if abs(value) > band else 0.0
        )

    # -- up and down
    # ------------------------------------------------------------------------------------------------

    def _climb(self, sticks: TelloSticks, felt: Felt) -> float:
        """Climb rate (m/s) that is wanted; a height is held where nobody asks for one."""
        if self.state == TAKING_OFF:
            return self.rules.take_off_mps
        if self.state == LANDING:
            return -self.rules.sink_mps
        asked = self._axis(sticks.throttle) * self.rules.climb_mps * (2.0 if sticks.fast else 1.0)
        if asked > 0.0 and felt.height_m > self.height_limit_m:
            asked = 0.0
        if asked:
            self._hold_m = None
            return asked
        if self._hold_m is None:
            self._hold_m = felt.height_m + 0.3 * float(felt.v_world_mps[2])
        return max(-0.5, min(0.5, 1.2 * (self._hold_m - felt.height_m)))

    def _lift(self, climb_mps: float, dt_s: float, felt: Felt) -> float:
        error = climb_mps - float(felt.v_world_mps[2])
        self._climb_integral = max(-3.0, min(3.0, self._climb_integral + 0.8 * error * dt_s))
        return max(-4.0, min(4.0, 2.5 * error + self._climb_integral))

    # -- level
    # ------------------------------------------------------------------------------------------------------

    def _level(self, sticks: TelloSticks, felt: Felt, dt_s: float) -> Tuple[float, float]:
        """Lean forward and to the right (rad)."""
        c, s = math.cos(felt.yaw_rad), math.sin(felt.yaw_rad)
        axes = np.array([[c, s], [s, -c]])  # forward and right in the world
        moving, trim = axes @ felt.v_world_mps[:2], axes @ self._trim_mps2
        limit = math.radians(min(self.lean_limit_deg, self.rules.fast_lean_deg))
        full = math.radians(self.rules.fast_lean_deg if sticks.fast else self.rules.lean_deg)
        learned, leans = np.zeros(2), []
        for k, stick in enumerate((self._axis(sticks.pitch), self._axis(sticks.roll))):
            if stick:
                acc = (
                    G_MPS2 * math.tan(stick * full)
                    + (trim[k] - self._own_drag * moving[k]) * felt.sees_ground
                )
            elif felt.sees_ground:
                acc = _HOLD_PER_S * -moving[k] + trim[k]
                learned[k] = -moving[k]
            else:
                acc = 0.0  # level: the wind carries it
            leans.append(max(-limit, min(limit, math.atan2(acc, G_MPS2))))
        self._trim_mps2 = np.clip(
            self._trim_mps2 + _TRIM_PER_S2 * dt_s * axes.T @ learned, -1.5, 1.5
        )
        return leans[0], leans[1]

    @property
    def _own_drag(self) -> float:
        """Per second, beyond the airframe's 0.4."""
        return max(0.0, self.rules.drag_per_s - 0.4)
