# SPDX-License-Identifier: Apache-2.0
"""The target that a vehicle holds: what was last accepted, until something newer comes."""

import math
from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np

from fcsv_control.errors import CommandRefused
from fcsv_control.recent_way import RecentWay
from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.vehicles.modes import Mode


@dataclass(frozen=True)
class Limits:
    """Limits of what an agent lets a vehicle do, and the step at which the odometry frame counts as
    begun anew."""

    furthest_target_m: float = 60.0  # from where it is
    highest_takeoff_m: float = 30.0  # above the zero of its odometry frame
    # of the autopilot's estimate between two messages, beyond what it can fly
    reset_step_m: float = 1.0
    takeoff_done_m: float = 0.3  # below the altitude asked for
    takeoff_timeout_s: float = 30.0
    # of a target above where the vehicle stood when it was last disarmed
    lowest_target_m: float = 0.5
    highest_target_m: float = 40.0  # likewise

    def __post_init__(self):
        require_positive(self)


class Holder:
    """The target that is streamed: set by commands, else where the vehicle was when GUIDED began.

    During a take-off nothing is streamed, because any set-point would replace it; the place above
    is held thereafter. Where the autopilot's estimate jumps, its odometry frame was begun anew: the
    target moves along, or the vehicle would fly the difference.
    """

    _FASTEST_MPS = 10.0
    _GAP_S = 0.5  # longest gap over which a jump can be told from a flight

    def __init__(self, frame: str, limits: Limits):
        self._frame, self._limits = frame, limits
        self._mode = Mode.UNHEARD
        self._armed: Optional[bool] = None  # until it was heard
        self._here: Optional[np.ndarray] = None
        self._here_s = -math.inf
        self._way = RecentWay()
        self._target: Optional[np.ndarray] = None
        self._above: Optional[np.ndarray] = None  # end of the take-off under way
        self._ground_m: Optional[float] = None  # height at which it stood, disarmed
        self._above_since_s = 0.0
        self._moved_s = -math.inf

    @property
    def target(self) -> Optional[np.ndarray]:
        """T_odom_body to stream now; None: nothing is to be streamed."""
        return (
            self._target.copy() if self._mode == Mode.GUIDED and self._target is not None else None
        )

    @property
    def mode(self) -> Mode:
        return self._mode

    @property
    def armed(self) -> bool:
        return bool(self._armed)

    def state(self, mode: Mode, armed: bool) -> None:
        """The flight controller's mode. Entering GUIDED means holding here; leaving it forgets the
        target."""
        entered = mode == Mode.GUIDED and self._mode != Mode.GUIDED
        self._mode, self._armed = mode, armed
        if mode != Mode.GUIDED or entered:
            self._above = self._target = None
        if entered and self._here is not None:
            self._target = transforms.level(self._here)

    def pose(self, now_s: float, T_odom_body: np.ndarray) -> float:
        """The autopilot's estimate came. Returns by how far (m) the frame was found to have moved,
        mostly 0."""
        before, before_s = self._here, self._here_s
        self._here, self._here_s = T_odom_body, now_s
        self._way.add(now_s, T_odom_body[:3, 3])
        if self._armed is False:
            self._ground_m = float(T_odom_body[2, 3])
        self._watch_take_off(now_s)
        if before is None:
            if self._mode == Mode.GUIDED and self._above is None and self._target is None:
                # started in flight: the mode was known first
                self._target = transforms.level(T_odom_body)
            return 0.0
        gap_s = now_s - before_s
        step = T_odom_body[:3, 3] - before[:3, 3]
        step_m = math.hypot(*step.tolist())
        if (
            not 0.0 <= gap_s <= self._GAP_S
            or step_m <= self._limits.reset_step_m + self._FASTEST_MPS * gap_s
        ):
            return 0.0
        self._move(now_s, step)
        return step_m

    def moved(self, now_s: float, step_m: Sequence[float]) -> bool:
        """The estimate moved by ``step_m`` (3,) in steps that looked like flight. Whether it was
        not known already."""
        if now_s - self._moved_s < self._GAP_S:
            return False
        self._move(now_s, np.asarray(step_m, float))
        return True

    def _move(self, now_s: float, step: np.ndarray) -> None:
        self._moved_s = now_s
        self._way.forget()
        for held in (self._target, self._above):
            if held is not None:
                held[:3, 3] += step
        if self._ground_m is not None and self._armed:
            self._ground_m += float(step[2])

    def go_to(self, T_odom_body: np.ndarray, frame: str) -> None:
        """A target that is finite by construction. Raises CommandRefused where it may not be flown
        to."""
        self._require_guided()
        if self._above is not None:
            raise CommandRefused("still taking off; a target now would end the take-off")
        if frame != self._frame:
            raise CommandRefused(
                f"target is in frame '{frame}', this vehicle flies in '{self._frame}'"
            )
        distance_m = float(np.linalg.norm(T_odom_body[:3, 3] - self._here[:3, 3]))
        if not distance_m <= self._limits.furthest_target_m:
            most_m = self._limits.furthest_target_m
            raise CommandRefused(
                f"target is {distance_m:.1f} m away, at most {most_m:.0f} m are allowed"
            )
        self._require_height(float(T_odom_body[2, 3]))
        self._target = transforms.level(T_odom_body)

    def _require_height(self, z_m: float) -> None:
        if self._ground_m is None:
            return  # this agent was started in flight: the ground was never seen
        height_m = z_m - self._ground_m
        low_m, high_m = self._limits.lowest_target_m, self._limits.highest_target_m
        if not low_m <= height_m <= high_m:
            raise CommandRefused(
                f"target is {height_m:.1f} m above the take-off place; {low_m:g} to {high_m:g} m are allowed"
            )

    def hold(self) -> None:
        """Hold where it comes to rest; ends a take-off. Raises CommandRefused."""
        self._require_guided()
        self._above = None
        self._target = self._way.rest(self._here)

    def stay(self) -> None:
        """Whatever was the target, it is here now, where it is flown in GUIDED."""
        if self._mode == Mode.GUIDED and self._here is not None:
            self.hold()

    def take_off(self, now_s: float, altitude_m: float) -> None:
        """Prepares the hold, before the autopilot is told to take off. Raises CommandRefused."""
        self._require_guided()
        if not 0.0 < altitude_m <= self._limits.highest_takeoff_m:  # NaN is refused, too
            most_m = self._limits.highest_takeoff_m
            raise CommandRefused(
                f"take-off to {altitude_m:g} m: more than 0 and at most {most_m:.0f} m are allowed"
            )
        if altitude_m <= self._here[2, 3]:
            raise CommandRefused(
                f"take-off to {altitude_m:g} m: it is at {self._here[2, 3]:.1f} m already"
            )
        self._above = transforms.level(self._here)
        self._above[2, 3] = altitude_m
        self._above_since_s, self._target = now_s, None

    def take_off_refused(self) -> None:
        """The autopilot did not take off."""
        self._above = None

    def _watch_take_off(self, now_s: float) -> None:
        if self._above is None:
            return
        if self._here[2, 3] >= self._above[2, 3] - self._limits.takeoff_done_m:
            self._target, self._above = self._above, None
        elif now_s - self._above_since_s > self._limits.takeoff_timeout_s:
            self._target, self._above = transforms.level(self._here), None

    def _require_guided(self) -> None:
        if self._mode != Mode.GUIDED:
            raise CommandRefused(f"it is in {self._mode or 'no mode yet'}, not in GUIDED")
        if self._here is None:
            raise CommandRefused("the autopilot does not know where it is")
