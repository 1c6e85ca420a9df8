# SPDX-License-Identifier: Apache-2.0
"""Where the robot is: fixes from outside, wheel odometry between, in an augmented Kalman filter
(Larsen et al. 1998).

Its state is x, y, yaw in home and the wheels' systematic errors (Borenstein and Feng 1996): scale
of distances, scale of turns, and yaw per metre of unequal wheels. A port: messages and monotonic
time in, a PlaceState out.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Deque, List, NamedTuple, Optional, Tuple, Union

import numpy as np

from fcsv_geometry import chi_squared, rotations
from fcsv_geometry.config import require_positive, require_within
from fcsv_guidance.clock import ahead_of_clock, behind_clock
from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.place.wheels import WheelOdometry, WheelReader, WheelRules, between

STATES = 6  # x, y, yaw, scale of distances, scale of turns, yaw per metre
_WHEELS_LOST_S = 1.0  # so long wheels may be refused before the place is not known
_NO_START = "no fixes that agree have come while the robot stood: let it stand for a moment"


@dataclass(frozen=True)
class LevelPlace:
    """A place in home; ``covariance`` (3,3) of x (m), y (m), yaw (rad)."""

    stamp_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    covariance: np.ndarray


@dataclass(frozen=True)
class PlaceFix(LevelPlace):
    """A place of the robot that something outside of it measured: a vehicle's camera that reads its
    tag, or any PoseStamped. A yaw variance of inf: the yaw is not measured. ``stamp_s``: of the
    picture, in the time of the robot's wheels."""


@dataclass(frozen=True)
class PlaceState:
    """``place`` is None where it is not known; ``reason`` says why, empty where it is.
    ``yaw_sigma_rad``; numbers of fixes that were used and refused, and why the last was. ``hold``:
    why the robot shall stand so that its place stays known; empty where it may drive."""

    place: Optional[RobotPlace]
    reason: str
    yaw_sigma_rad: float
    used: int
    refused: int
    last_refusal: str
    hold: str = ""


#: from the least to the largest share of disagreements that chance explains
GATES = (0.5, 0.999999)


@dataclass(frozen=True)
class PlaceRules:
    """Sigmas of the wheels' errors, and what is believed. ``*_noise``: standard deviation after one
    metre or radian; it grows with the root of the way. ``common_share``: of a fix's variance that
    other fixes share (the vehicle's own place), so that they do not average it away. After
    ``longest_blind_m`` by wheels alone the place is not known: what two sigma leave out adds up."""

    distance_noise_m: float = 0.04
    turn_noise_rad: float = 0.04
    yaw_noise_radpm: float = 0.02
    distance_scale: float = 0.03
    turn_scale: float = 0.08
    curve_radpm: float = 0.02
    common_share: float = 0.7
    gate: float = 0.999
    to_begin: int = 3
    to_doubt: int = 3
    relocate_s: float = 8.0
    stands_m: float = 0.03
    oldest_fix_s: float = 15.0
    longest_blind_m: float = 3.0
    history_s: float = 2.0
    wheels: WheelRules = field(default_factory=WheelRules)

    def __post_init__(self):
        require_positive(self, but=("common_share",))
        require_within(self, 0.0, 1.0, "common_share")
        require_within(self, *GATES, "gate")


Message = Union[PlaceFix, WheelOdometry]


class _FilterState(NamedTuple):
    """The filter right after the wheels were read."""

    wheels: WheelOdometry
    x: np.ndarray
    P: np.ndarray


class RobotTracker:
    """Weighs fixes and wheels by their covariances. Without wheels, the last fix is the place."""

    def __init__(self, rules: PlaceRules = PlaceRules()):
        self._rules = rules
        self._used, self._refused, self._why = 0, 0, ""
        self._begin()

    def _begin(self) -> None:
        """Forgets the place and all that led to it."""
        self._reader = WheelReader(self._rules.wheels)
        self._history: Deque[_FilterState] = deque()
        self._fixes: Deque[PlaceFix] = deque()  # used, as old as the history
        self._waiting: List[PlaceFix] = []  # newer than the wheels
        self._candidates: List[PlaceFix] = []  # not used, while the wheels stood
        self._proposed_s = -np.inf  # the last that might have been one
        self._wheels: Optional[WheelOdometry] = None
        # where the wheels were when the candidates began
        self._stood: Optional[WheelOdometry] = None
        self._common = np.zeros((3, 3))
        self._fixed_s, self._blind_m = -np.inf, 0.0  # the last fix, and the way since
        self._in_a_row, self._doubted = 0, False

    def receive(self, now_s: float, message: Message) -> None:
        """A message came. Raises TypeError where its type is not known; one that is not finite, or
        whose stamp is far from now, is refused."""
        if self._newest_s > now_s and ahead_of_clock(now_s, self._newest_s):
            self._begin()
            self._why = "the clock was set back"
        if isinstance(message, WheelOdometry):
            self._on_wheels(now_s, message)
        elif isinstance(message, PlaceFix):
            self._on_fix(now_s, message)
        else:
            raise TypeError(f"a robot's place does not know {type(message).__name__}")

    def step(self, now_s: float) -> PlaceState:
        """The place as of the last wheels, at most as good as the fixes are in common."""
        if self._reader.refusal and now_s - self._wheels_s > _WHEELS_LOST_S:
            return self._state(None, self._reader.refusal)
        rules = self._rules
        if not self._history:
            came = now_s - self._proposed_s <= rules.oldest_fix_s
            return self._state(None, _NO_START if came else "no fix has come")
        if self._doubted:
            return self._state(
                None,
                f"{rules.to_doubt} fixes and more in a row contradict the wheels: let the robot stand "
                f"for {rules.relocate_s:g} s",
            )
        age_s = now_s - self._fixed_s
        if age_s > rules.oldest_fix_s:
            return self._state(None, f"no fix for {age_s:.0f} s")
        if self._blind_m > rules.longest_blind_m:
            return self._state(None, f"no fix for {self._blind_m:.1f} m of its way")
        wheels, x, P = self._history[-1]
        P = P[:3, :3] + self._common
        sigma_m = float(np.sqrt(P[0, 0] + P[1, 1]))
        place = RobotPlace(
            wheels.stamp_s, float(x[0]), float(x[1]), rotations.wrap(float(x[2])), sigma_m
        )
        return self._state(place, "", float(np.sqrt(P[2, 2])))

    def _state(
        self, place: Optional[RobotPlace], reason: str, yaw_sigma_rad: float = np.inf
    ) -> PlaceState:
        return PlaceState(place, reason, yaw_sigma_rad, self._used, self._refused, self._why)

    @property
    def _wheels_s(self) -> float:
        return -np.inf if self._wheels is None else self._wheels.stamp_s

    @property
    def _newest_s(self) -> float:
        """The newest stamp of what counts."""
        last_s = self._history[-1].wheels.stamp_s if self._history else -np.inf
        return max(self._wheels_s, last_s)

    def _on_wheels(self, now_s: float, raw: WheelOdometry) -> None:
        wheels = self._reader.read(now_s, raw)
        self._why = self._reader.refusal or self._reader.jump or self._why
        if wheels is None:
            return  # where it was late or twice the next one holds the whole way
        if self._wheels is None and self._history:  # the last fix was a place without wheels
            self._history[-1] = self._history[-1]._replace(wheels=wheels)
        if self._wheels is not None:
            last = self._wheels
            self._blind_m += float(np.hypot(wheels.x_m - last.x_m, wheels.y_m - last.y_m))
        self._wheels = wheels
        stood = self._stood or wheels
        moved_m = np.hypot(wheels.x_m - stood.x_m, wheels.y_m - stood.y_m)
        if (
            moved_m > self._rules.stands_m
            or abs(rotations.wrap(wheels.yaw_rad - stood.yaw_rad)) > self._rules.stands_m
        ):
            self._candidates, self._stood = [], wheels
        if self._history and self._history[-1].wheels is not wheels:
            before = self._history[-1]
            self._history.append(
                _FilterState(wheels, *self._moved(before.x, before.P, before.wheels, wheels))
            )
            self._forget(wheels.stamp_s)
        waiting, self._waiting = self._waiting, []
        for fix in waiting:
            self._weigh(fix)

    def _forget(self, now_s: float) -> None:
        oldest_s = now_s - self._rules.history_s
        while len(self._history) > 2 and self._history[1].wheels.stamp_s < oldest_s:
            self._history.popleft()
        while self._fixes and self._fixes[0].stamp_s < self._history[0].wheels.stamp_s:
            self._fixes.popleft()

    def _on_fix(self, now_s: float, fix: PlaceFix) -> None:
        refusal = _refusal(now_s, fix, self._rules.oldest_fix_s)
        if refusal:
            self._refuse(refusal)
        elif self._wheels is None:
            self._alone(fix)
        elif fix.stamp_s > self._wheels.stamp_s:
            self._waiting = [*self._waiting[-19:], fix]
        else:
            self._weigh(fix)

    def _alone(self, fix: PlaceFix) -> None:
        """Takes the fix alone: without wheels each fix is a place of its own."""
        if not np.isfinite(fix.covariance[2, 2]):
            self._refuse("a fix without yaw needs wheels")
            return
        if self._history and fix.stamp_s <= self._history[-1].wheels.stamp_s:
            self._refuse("a fix is older than the last one")
            return
        self._history = deque(
            [_FilterState(WheelOdometry(fix.stamp_s, 0.0, 0.0, 0.0), *self._begun(fix))]
        )
        self._common[:] = 0.0
        self._count(1, fix.stamp_s)

    def _weigh(self, fix: PlaceFix) -> None:
        """Use a fix where the filter expects it; else keep it as a candidate of another place."""
        if not self._history:
            self._propose(fix)
            return
        if fix.stamp_s < self._history[0].wheels.stamp_s:
            self._refuse("a fix came too late")
            return
        x, P = self._at(fix.stamp_s)
        d2, bound = self._distance2(x, P, fix)
        if d2 > bound:
            self._refuse(f"a fix lies {np.sqrt(d2):.1f} sigma away")
            self._in_a_row += 1
            self._doubted = self._doubted or self._in_a_row >= self._rules.to_doubt
            self._propose(fix)
            return
        self._in_a_row = min(self._in_a_row, self._rules.to_doubt) - 1 if self._doubted else 0
        self._doubted = self._doubted and self._in_a_row > 0
        self._use(fix)

    def _use(self, fix: PlaceFix) -> None:
        """Put it among those used, and run the filter again from the oldest moment on."""
        self._fixes = deque(sorted([*self._fixes, fix], key=lambda f: f.stamp_s))
        self._count(1, max(self._fixed_s, fix.stamp_s))
        share = self._rules.common_share * np.where(
            np.isfinite(fix.covariance), fix.covariance, 0.0
        )
        self._common = share if self._used == 1 else 0.8 * self._common + 0.2 * share
        moments = list(self._history)
        start = max(i for i, m in enumerate(moments) if m.wheels.stamp_s <= fix.stamp_s)
        at, x, P = moments[start]
        # earlier ones are in its state
        later = [f for f in self._fixes if f is fix or f.stamp_s > at.stamp_s]
        again = moments[:start]
        for moment in moments[start:]:
            while later and later[0].stamp_s <= moment.wheels.stamp_s:
                if later[0].stamp_s > at.stamp_s:
                    middle = between(at, moment.wheels, later[0].stamp_s)
                    x, P = self._moved(x, P, at, middle)
                    at = middle
                x, P = _updated(x, P, later.pop(0))
            x, P = self._moved(x, P, at, moment.wheels)
            at = moment.wheels
            again.append(_FilterState(at, x, P))
        self._history = deque(again)

    def _at(self, stamp_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """State and covariance at a time within the history."""
        before = self._history[0]
        for moment in self._history:
            if moment.wheels.stamp_s > stamp_s:
                return self._moved(
                    before.x,
                    before.P,
                    before.wheels,
                    between(before.wheels, moment.wheels, stamp_s),
                )
            before = moment
        return before.x, before.P

    def _distance2(self, x: np.ndarray, P: np.ndarray, fix: PlaceFix) -> Tuple[float, float]:
        """Squared Mahalanobis distance, and its bound."""
        H, off, R = _innovation(x, fix)
        S = H @ (P + _padded(self._common)) @ H.T + R
        return float(off @ np.linalg.solve(S, off)), chi_squared.quantile(
            self._rules.gate, len(off)
        )

    def _propose(self, fix: PlaceFix) -> None:
        """Begin, or begin anew, where enough fixes agree while the wheels stand."""
        rules = self._rules
        if not np.isfinite(fix.covariance[2, 2]):
            return
        self._stood, self._proposed_s = self._stood or self._wheels, fix.stamp_s
        if fix.stamp_s < self._stood.stamp_s:
            return  # the robot has moved since
        agree = [c for c in self._candidates if self._agree(c, fix)]
        self._candidates = [*agree, fix]
        lasting_s = fix.stamp_s - self._candidates[0].stamp_s
        if len(self._candidates) < rules.to_begin or (
            self._history and lasting_s < rules.relocate_s
        ):
            return
        x, P = self._begun(self._candidates[0])
        for other in self._candidates[1:]:
            x, P = _updated(x, P, other)
        self._history = deque([_FilterState(self._wheels, x, P)])
        self._fixes.clear()
        self._common = rules.common_share * np.asarray(fix.covariance, float)
        self._count(len(self._candidates), fix.stamp_s)
        self._candidates, self._in_a_row, self._doubted = [], 0, False

    def _agree(self, a: PlaceFix, b: PlaceFix) -> bool:
        off = np.array([a.x_m - b.x_m, a.y_m - b.y_m, rotations.wrap(a.yaw_rad - b.yaw_rad)])
        S = np.asarray(a.covariance) + b.covariance
        return bool(off @ np.linalg.solve(S, off) <= chi_squared.quantile(self._rules.gate, 3))

    def _begun(self, fix: PlaceFix) -> Tuple[np.ndarray, np.ndarray]:
        r = self._rules
        P = np.diag([0.0, 0.0, 0.0, r.distance_scale**2, r.turn_scale**2, r.curve_radpm**2])
        P[:3, :3] = fix.covariance
        return np.array([fix.x_m, fix.y_m, fix.yaw_rad, 0.0, 0.0, 0.0]), P

    def _moved(self, x, P, a: WheelOdometry, b: WheelOdometry) -> Tuple[np.ndarray, np.ndarray]:
        """The state after the wheels turned from reading to reading."""
        new, F, Q = moved_by_wheels(x, a, b, self._rules, self._reader)
        return new, F @ P @ F.T + Q

    def _count(self, fixes: int, newest_s: float) -> None:
        self._used, self._fixed_s, self._blind_m = self._used + fixes, newest_s, 0.0

    def _refuse(self, why: str) -> None:
        self._refused, self._why = self._refused + 1, why


def moved_by_wheels(
    x: np.ndarray, a: WheelOdometry, b: WheelOdometry, rules: PlaceRules, reader: WheelReader
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The robot's state (6,) after its wheels turned from reading ``a`` to ``b``, the Jacobian
    (6,6) to the state before, and the motion's noise (6,6), with what ``reader`` does not know."""
    c, s = np.cos(a.yaw_rad), np.sin(a.yaw_rad)
    dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
    ahead = np.array([c * dx + s * dy, c * dy - s * dx])
    turned = rotations.wrap(b.yaw_rad - a.yaw_rad)
    far = abs(float(ahead[0]))
    turn = (1.0 + x[4]) * turned + x[5] * ahead[0]
    # ``ahead`` is a chord: it holds half of the turn as measured
    heading = x[2] + 0.5 * (turn - turned)
    ch, sh = np.cos(heading), np.sin(heading)
    way = np.array([ch * ahead[0] - sh * ahead[1], sh * ahead[0] + ch * ahead[1]])
    across = (1.0 + x[3]) * np.array([-way[1], way[0]])
    new = np.array(x)
    new[:2] += (1.0 + x[3]) * way
    new[2] += turn
    F = np.eye(STATES)
    F[:2, 2], F[:2, 3] = across, way
    F[:2, 4], F[:2, 5] = 0.5 * turned * across, 0.5 * ahead[0] * across
    F[2, 4], F[2, 5] = turned, ahead[0]
    Q = np.zeros((STATES, STATES))
    Q[0, 0] = Q[1, 1] = rules.distance_noise_m**2 * far
    Q[2, 2] = rules.yaw_noise_radpm**2 * far + rules.turn_noise_rad**2 * abs(turned)
    Q[:3, :3] += np.diag(reader.unknown(a.stamp_s, b.stamp_s))
    return new, F, Q


def _refusal(now_s: float, fix: PlaceFix, oldest_s: float) -> str:
    """Why a fix cannot be used whatever the filter says; empty where it can."""
    C = np.asarray(fix.covariance, float)
    if C.shape != (3, 3):
        return f"a fix has a covariance of shape {C.shape}, not (3, 3)"
    size = 3 if C[2, 2] != np.inf else 2
    C = C[:size, :size]
    if not (np.isfinite([fix.stamp_s, fix.x_m, fix.y_m]).all() and np.isfinite(C).all()):
        return "a fix is not finite"
    if size == 3 and not np.isfinite(fix.yaw_rad):
        return "a fix is not finite"
    if not np.allclose(C, C.T) or np.linalg.eigvalsh(C)[0] <= 0.0:
        return "a fix has a covariance that is none"
    off = ahead_of_clock(now_s, fix.stamp_s) or behind_clock(now_s, fix.stamp_s, oldest_s)
    return off and f"a fix {off}"


def _innovation(x: np.ndarray, fix: PlaceFix) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """H, how far the fix is from the state, and its covariance; without yaw where that is not
    measured."""
    R = np.asarray(fix.covariance, float)
    size = 3 if np.isfinite(R[2, 2]) else 2
    off = np.array(
        [fix.x_m - x[0], fix.y_m - x[1], rotations.wrap(fix.yaw_rad - x[2]) if size == 3 else 0.0]
    )
    return np.eye(STATES)[:size], off[:size], R[:size, :size]


def _updated(x: np.ndarray, P: np.ndarray, fix: PlaceFix) -> Tuple[np.ndarray, np.ndarray]:
    """Updates the state by Joseph's form, which keeps the covariance positive."""
    H, off, R = _innovation(x, fix)
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    keep = np.eye(STATES) - K @ H
    return x + K @ off, keep @ P @ keep.T + K @ R @ K.T


def _padded(C: np.ndarray) -> np.ndarray:
    whole = np.zeros((STATES, STATES))
    whole[:3, :3] = C
    return whole
