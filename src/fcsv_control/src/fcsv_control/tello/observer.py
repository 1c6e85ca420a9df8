# SPDX-License-Identifier: Apache-2.0
"""Where a Tello is now, by poses that tell where it was: they are late (mocap 0.1 s, video of
gimbals 0.1 to 0.3 s).

A fading-memory filter (Zarchan and Musoff, "Fundamentals of Kalman Filtering", table 4.4) about the
way on which the last commands lead. A pose is compared with what was estimated for its own moment,
and all estimates since then are moved. What the commands do not explain is found: horizontally as
an acceleration (wind), vertically as a velocity.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Deque, List, Optional, Tuple

import numpy as np

from fcsv_control.tello.pid import StickModel, Sticks
from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.rotations import turn_about_z, wrap

_DT_S = (0.005, 1.0)  # between two poses, for the filter's gains
_CLIMB = np.array([0.0, 0.0, 1.0])  # the axis whose stick asks for a velocity


@dataclass(frozen=True)
class ObserverRules:
    """``climb_lag_s``: how a Tello takes up the climb rate that its stick asks for;
    ``stick_delay_s``: until it leans. ``pose_s``, ``log_s``: time constants of the filter.

    A pose that is older than ``oldest_s``, or further than ``gate_m`` + ``gate_mps`` times the time
    since the last good one from where the vehicle must be, is refused.
    """

    climb_lag_s: float = 0.35
    stick_delay_s: float = 0.1
    pose_s: float = 0.3
    log_s: float = 0.4  # time constant with which the vehicle's own velocity is believed
    most_drift: float = 1.0  # m/s2, vertically m/s: of what the commands do not explain
    oldest_s: float = 0.7
    gate_m: float = 0.4
    gate_mps: float = 0.6
    gate_deg: float = 25.0

    def __post_init__(self):
        require_positive(self)


@dataclass
class _PastEstimate:
    """Estimate at a time: position (3,), velocity (3,) without drift, yaw (rad)."""

    now_s: float
    p_m: np.ndarray
    v_mps: np.ndarray
    yaw_rad: float


class Observer:
    """``step`` with every command, ``pose`` and ``velocity`` as they come. Time is monotonic;
    frame: uavN/odom."""

    def __init__(self, rules: ObserverRules, sticks: StickModel):
        self._rules, self._model = rules, sticks
        self._moments: Deque[_PastEstimate] = deque(maxlen=200)
        self._drift = np.zeros(3)  # m/s2, vertically m/s
        self._given: Deque[Tuple[float, Sticks]] = deque(maxlen=20)
        self._stamp_s = -math.inf
        self.refused = 0
        self.why_refused = ""

    @property
    def known(self) -> bool:
        """Whether there was a pose since the beginning."""
        return bool(self._moments)

    @property
    def stamp_s(self) -> float:
        """Gives the stamp of the newest pose that was taken."""
        return self._stamp_s

    @property
    def T_odom_body(self) -> np.ndarray:
        """Now, level; only where ``known``."""
        now = self._moments[-1]
        return transforms.from_xyz_yaw(now.p_m, now.yaw_rad)

    @property
    def v_mps(self) -> np.ndarray:
        """Velocity now (3,), m/s; nought where nothing is known."""
        return self._moments[-1].v_mps + self._drift * _CLIMB if self._moments else np.zeros(3)

    def forget(self) -> None:
        """Begin anew with the next pose."""
        self._moments.clear()
        self._drift, self._stamp_s = np.zeros(3), -math.inf

    def step(self, now_s: float, sticks: Sticks) -> None:
        """These sticks were given until now."""
        self._given.append((now_s, sticks))
        if not self._moments or now_s <= self._moments[-1].now_s:
            return
        last = self._moments[-1]
        dt_s = now_s - last.now_s
        s = next(
            (k for t_s, k in reversed(self._given) if t_s <= now_s - self._rules.stick_delay_s),
            Sticks(),
        )
        m, R = self._model, turn_about_z(last.yaw_rad)
        v_body = R.T @ last.v_mps
        acc = np.zeros(3)
        for axis, stick in enumerate((s.forward, s.left)):
            brakes = abs(stick) <= m.dead_band
            acc[axis] = (
                m.most_mps2 * m.share(stick)
                - (m.brake_per_s if brakes else m.drag_per_s) * v_body[axis]
            )
        v = last.v_mps + R @ acc * dt_s + self._drift * (1.0 - _CLIMB) * dt_s
        climb = m.climb_mps * m.share(s.up)
        v[2] = last.v_mps[2] + (climb - last.v_mps[2]) * (
            1.0 - math.exp(-dt_s / self._rules.climb_lag_s)
        )
        p = last.p_m + (0.5 * (last.v_mps + v) + self._drift * _CLIMB) * dt_s
        turn_rps = math.radians(m.turn_dps) * m.share(s.turn)
        self._moments.append(_PastEstimate(now_s, p, v, wrap(last.yaw_rad + turn_rps * dt_s)))

    def pose(self, now_s: float, stamp_s: float, T_odom_body: np.ndarray) -> bool:
        """A pose of the tracker, measured at ``stamp_s``. Whether it was taken."""
        why = self._wrong(now_s, stamp_s, T_odom_body)
        if why:
            self.refused, self.why_refused = self.refused + 1, why
            return False
        p, yaw = T_odom_body[:3, 3], transforms.yaw(T_odom_body)
        if not self._moments:
            self._moments.append(_PastEstimate(now_s, p.copy(), np.zeros(3), yaw))
        else:
            self._correct(now_s, stamp_s, p, yaw)
        self._stamp_s = stamp_s
        return True

    def velocity(self, now_s: float, stamp_s: float, v_body_mps: np.ndarray, dt_s: float) -> None:
        """The vehicle's own velocity in its body's axes, measured at ``stamp_s``; ``dt_s`` since
        the last one."""
        v_body = np.asarray(v_body_mps, float)
        if (
            not self._moments
            or now_s - stamp_s > self._rules.oldest_s
            or not np.isfinite(v_body).all()
        ):
            return
        then = self._at(stamp_s)
        error = turn_about_z(then.yaw_rad) @ v_body - then.v_mps - self._drift * _CLIMB
        share = 1.0 - math.exp(-min(max(dt_s, 0.0), _DT_S[1]) / self._rules.log_s)
        self._faster(stamp_s, share * error, np.zeros(3))

    def _wrong(self, now_s: float, stamp_s: float, T: np.ndarray) -> str:
        r = self._rules
        if not (math.isfinite(stamp_s) and np.isfinite(T).all()):
            return "it is not finite"
        if stamp_s > now_s + 0.05:
            return f"its stamp lies {stamp_s - now_s:.2f} s ahead"
        if now_s - stamp_s > r.oldest_s:
            return f"it is {now_s - stamp_s:.2f} s old"
        if stamp_s <= self._stamp_s:
            return "its stamp is not after the one before"
        if not self._moments:
            return ""
        then, gap_s = self._at(stamp_s), stamp_s - self._stamp_s
        off_m = float(np.linalg.norm(T[:3, 3] - then.p_m))
        if off_m > r.gate_m + r.gate_mps * gap_s:
            return f"it is {off_m:.1f} m from where the vehicle must be"
        off_deg = abs(math.degrees(wrap(transforms.yaw(T) - then.yaw_rad)))
        return (
            f"it is turned by {off_deg:.0f} degrees" if off_deg > r.gate_deg * (1.0 + gap_s) else ""
        )

    def _correct(self, now_s: float, stamp_s: float, p: np.ndarray, yaw: float) -> None:
        then = self._at(stamp_s)
        dt_s = min(max(stamp_s - self._stamp_s, _DT_S[0]), _DT_S[1])
        theta = math.exp(-dt_s / self._rules.pose_s)
        off, turned = p - then.p_m, wrap(yaw - then.yaw_rad)
        second, third = (1.0 - theta) ** 2, 1.5 * (1.0 - theta) ** 2 * (1.0 + theta)
        dv = off / dt_s * (third * (1.0 - _CLIMB) + second * _CLIMB)
        nearer = off * ((1.0 - theta**3) * (1.0 - _CLIMB) + (1.0 - theta**2) * _CLIMB)
        for m in self._moments:
            if m.now_s >= stamp_s - _DT_S[1]:
                m.p_m = m.p_m + nearer + dv * max(0.0, m.now_s - stamp_s)
                m.yaw_rad = wrap(m.yaw_rad + (1.0 - theta) * turned)
        self._faster(stamp_s, dv, off * ((1.0 - theta) ** 3 / dt_s**2))

    def _faster(self, stamp_s: float, dv: np.ndarray, acceleration: np.ndarray) -> None:
        """The velocity since a moment was other than it was taken to be: what draws the vehicle
        aside is another."""
        self._drift = self._drift + dv * _CLIMB + acceleration * (1.0 - _CLIMB)
        length = float(np.linalg.norm(self._drift))
        if length > self._rules.most_drift:
            self._drift *= self._rules.most_drift / length
        for m in self._moments:
            if m.now_s >= stamp_s:
                m.v_mps = m.v_mps + dv * (1.0 - _CLIMB)

    def _at(self, stamp_s: float) -> _PastEstimate:
        """The estimate of a moment in between."""
        moments: List[_PastEstimate] = list(self._moments)
        later: Optional[_PastEstimate] = None
        for m in reversed(moments):
            if m.now_s <= stamp_s:
                if later is None:
                    return _PastEstimate(
                        stamp_s, m.p_m + self.v_mps * (stamp_s - m.now_s), m.v_mps, m.yaw_rad
                    )
                share = (stamp_s - m.now_s) / (later.now_s - m.now_s)
                p, v = (
                    m.p_m + share * (later.p_m - m.p_m),
                    m.v_mps + share * (later.v_mps - m.v_mps),
                )
                return _PastEstimate(
                    stamp_s, p, v, wrap(m.yaw_rad + share * wrap(later.yaw_rad - m.yaw_rad))
                )
            later = m
        first = moments[0]
        return _PastEstimate(stamp_s, first.p_m, first.v_mps, first.yaw_rad)
