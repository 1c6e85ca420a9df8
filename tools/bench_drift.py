# SPDX-License-Identifier: Apache-2.0
"""What on board could witness a tracker that drifts slowly; the table goes into
docs/lab/rehearsals.md.

python tools/bench_drift.py [--calm 10] [--drifts 20] [--flown]

Flies rehearsals and looks at their recordings: --calm flights without a fault say how far a witness
is off by itself, 1.15 times the worst of that is its bound, and --drifts flights with `tracker
drifts slowly` say when it is crossed. Witnesses: the accelerometer, turned by the autopilot's
attitude and integrated, against the tracker's velocity; the barometer against the tracker's height.
Both are predicted by a line through what was before, over windows of 2 to 8 s. What the flight link
itself doubted, by its barometer and by its camera's pictures, are the last rows; --flown prints
those alone.
"""

import argparse
import logging
from dataclasses import dataclass
from typing import Callable, List, Tuple

import numpy as np

from fcsv_control.flight.feeding.height_check import HeightCheckRules, height_m
from fcsv_control.flight.feeding.scene_check import SceneCheckRules
from fcsv_geometry import transforms
from fcsv_geometry.missions.mission import load_mission
from fcsv_sim.autopilot.barometer import Barometer
from fcsv_sim.bringup import mission_file
from fcsv_sim.rehearsal.command import Job, rehearse
from fcsv_sim.rehearsal.faults import NONE
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle
from fcsv_sim.vehicles.vehicle import PASS_S

# to be predicted, and before that, through which a line
WINDOWS_S = ((2.0, 4.0), (3.0, 6.0), (5.0, 10.0), (8.0, 16.0))
STEP_S, MEAN_S = 0.1, 0.5  # of what is compared
IMU_HZ, FILTER_HZ = 50.0, 20.0  # of RAW_IMU; INS_ACCEL_FILTER of ArduCopter
G_MPS2, MARGIN = 9.81, 1.15
UP_M, NEAR_GROUND_M = 0.5, 1.5
AT_ONCE_S = 2.0
FAULT = "tracker drifts slowly"


@dataclass(frozen=True)
class Sensors:
    """Errors of the IMU, standard deviations. ``tilt_follows_s``: so slowly the filter takes an
    acceleration that only the tracker tells of for a lean of its own (infinite: it never does)."""

    vibration_mps2: float = 0.3  # left after the 20 Hz filter, in samples 50 times a second
    tilt_follows_s: float = np.inf
    bias_mps2: float = 0.05
    bias_walk_mps2: float = 0.003  # in a root of a second
    tilt_deg: float = 0.3


@dataclass(frozen=True)
class Flown:
    """One vehicle in the air: time (N,), velocity (N, 3), speed through the air and height (N,) in
    the world, heading and turn of the autopilot's frame against the world (N,), the tracker's
    position (N, 3; NaN between samples), when its fault began and when the flight link doubted it
    (NaN: never)."""

    t_s: np.ndarray
    v_mps: np.ndarray
    air_mps: np.ndarray
    z_m: np.ndarray
    yaw_rad: np.ndarray
    turn_rad: np.ndarray
    p_odom_m: np.ndarray
    began_s: float
    doubted_s: float
    by_pictures: bool


def fly(faults: str, first: int, flights: int) -> List[Flown]:
    """Of each vehicle a recording."""
    mission, flown = load_mission(mission_file("short")), []
    for seed in range(first, first + flights):
        recorder = Recorder()
        rehearse(Job(mission, 2, seed, faults), recorder.watch)
        flown += recorder.flown()
    return flown


class Recorder:
    """Of one flight."""

    def watch(self, flight: Flight) -> None:
        """Record each vehicle's passes."""
        self._flight, self._rows = flight, {name: [] for name in flight.fleet}
        for name, vehicle in flight.fleet.items():
            vehicle.step = self._recording(vehicle, vehicle.step, self._rows[name])

    def flown(self) -> List[Flown]:
        """From where they first flew to where they last did."""
        began = {who: at_s for at_s, _, who in self._flight.witness.begun}
        return [_cut(np.array(rows), began.get(name, np.nan)) for name, rows in self._rows.items()]

    @staticmethod
    def _recording(vehicle: RehearsedVehicle, step: Callable, rows: list) -> Callable:
        def stepped(now_s: float) -> None:
            before = vehicle.odometry
            step(now_s)
            p = (
                vehicle.T_odom_body[:3, 3]
                if vehicle.odometry is not before
                else (np.nan, np.nan, np.nan)
            )
            body, yaw_rad = vehicle.body, vehicle.autopilot.estimator.yaw_ext_rad
            turn_rad = yaw_rad - transforms.yaw(body.T_world_body)
            doubted = (
                1
                if vehicle.guardian.air.link.doubt
                else 2
                if vehicle.link.port.check.scene_says
                else 0
            )
            rows.append(
                (
                    now_s,
                    *body.velocity_mps,
                    body.air_mps,
                    body.position_m[2],
                    yaw_rad,
                    turn_rad,
                    *p,
                    doubted,
                )
            )

        return stepped


def _cut(a: np.ndarray, began_s: float) -> Flown:
    up = np.flatnonzero(a[:, 5] > UP_M)
    a = a[up[0] : up[-1]]
    doubted = a[a[:, 11] > 0, 0]
    doubted_s = float(doubted[0]) if len(doubted) else np.nan
    by_pictures = bool(len(doubted)) and bool(a[a[:, 11] > 0, 11][0] == 2)
    return Flown(
        a[:, 0],
        a[:, 1:4],
        a[:, 4],
        a[:, 5],
        a[:, 6],
        a[:, 7],
        a[:, 8:11],
        began_s,
        doubted_s,
        by_pictures,
    )


# ---- witnesses -----------------------------------------------------------------------------------


def by_imu(
    flown: Flown, sensors: Sensors, random: np.random.Generator
) -> Tuple[np.ndarray, np.ndarray]:
    """Times (M,) and velocity (M, 2) of the tracker against the integral of what the IMU feels,
    means over 0.5 s."""
    acc = np.diff(flown.v_mps[:, :2], axis=0, prepend=flown.v_mps[:1, :2]) / PASS_S
    acc = _turned(_lagged(acc, 1.0 / (2.0 * np.pi * FILTER_HZ), PASS_S), flown.turn_rad)
    every = int(round(1.0 / (IMU_HZ * PASS_S)))
    t_s, yaw_rad, dt_s = flown.t_s[::every], flown.yaw_rad[::every], 1.0 / IMU_HZ
    walk = np.cumsum(
        random.normal(0.0, sensors.bias_walk_mps2 * np.sqrt(dt_s), (len(t_s), 2)), axis=0
    )
    level = random.normal(0.0, sensors.bias_mps2, 2) + G_MPS2 * np.radians(
        random.normal(0.0, sensors.tilt_deg, 2)
    )
    wrong = _turned(
        level + walk + random.normal(0.0, sensors.vibration_mps2, (len(t_s), 2)), yaw_rad
    )
    way = np.cumsum(np.cumsum(acc[::every] + wrong, axis=0), axis=0) * dt_s**2
    known = np.isfinite(flown.p_odom_m[:, 0])
    at_s = np.arange(flown.t_s[known][0] + MEAN_S, flown.t_s[-1], STEP_S)
    means = [
        (_at(at_s, t, p) - _at(at_s - MEAN_S, t, p)) / MEAN_S
        for t, p in ((flown.t_s[known], flown.p_odom_m[known, :2]), (t_s, way))
    ]
    apart = means[0] - means[1]
    # what the filter has taken for a lean is not seen any more
    if np.isfinite(sensors.tilt_follows_s):
        apart = apart - _lagged(apart, sensors.tilt_follows_s, STEP_S)
    return at_s, apart


def by_barometer(
    flown: Flown, _sensors: Sensors, random: np.random.Generator
) -> Tuple[np.ndarray, np.ndarray]:
    """Times (M,) and height (M, 1) of the tracker against the simulated autopilot's barometer."""
    known = np.isfinite(flown.p_odom_m[:, 0])
    at_s = np.arange(flown.t_s[known][0], flown.t_s[-1], STEP_S)
    told = np.interp(at_s, flown.t_s[known], flown.p_odom_m[known, 2])
    z_m, air_mps = np.interp(at_s, flown.t_s, flown.z_m), np.interp(at_s, flown.t_s, flown.air_mps)
    barometer, heights = Barometer(int(random.integers(1 << 30))), []
    for now_s, height, speed in zip(at_s.tolist(), z_m.tolist(), air_mps.tolist()):
        barometer.feel(height, speed)
        heights.append(height_m(barometer.pressure_hpa(now_s, True)))
    apart = (told - heights)[:, None]
    apart[z_m < NEAR_GROUND_M] = np.nan
    return at_s, apart


def beyond_line(values: np.ndarray, window_s: float, before_s: float) -> np.ndarray:
    """(M,) how far each of (M, K) is from a line through what was a window before it; NaN where too
    little was."""
    ahead, n = int(round(window_s / STEP_S)), int(round(before_s / STEP_S)) + 1
    x = np.arange(n)
    weights = np.array([1.0, n - 1 + ahead]) @ np.linalg.pinv(np.stack([np.ones(n), x], axis=1))
    off = np.full(len(values), np.nan)
    for i in range(ahead + n - 1, len(values)):
        off[i] = np.linalg.norm(values[i] - weights @ values[i - ahead - n + 1 : i - ahead + 1])
    return off


def _lagged(values: np.ndarray, lag_s: float, step_s: float) -> np.ndarray:
    out, share = np.empty_like(values), 1.0 - np.exp(-step_s / lag_s)
    out[0] = values[0]
    for i in range(1, len(values)):
        out[i] = out[i - 1] + share * (values[i] - out[i - 1])
    return out


def _turned(xy: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([c * xy[:, 0] - s * xy[:, 1], s * xy[:, 0] + c * xy[:, 1]], axis=1)


def _at(at_s: np.ndarray, t_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(at_s, t_s, column) for column in values.T], axis=1)


# ---- what they see -------------------------------------------------------------------------------


def drifted_m(flown: Flown, until_s: float) -> float:
    """How far the tracker went off from when its fault began until a time, without its own noise
    and turn."""
    at_s, apart = by_imu(flown, Sensors(0.0, np.inf, 0.0, 0.0, 0.0), np.random.default_rng(0))
    calm = apart[at_s < flown.began_s]
    during = (at_s >= flown.began_s) & (at_s <= until_s)
    return float(np.linalg.norm((apart[during] - calm[-20:].mean(axis=0)).sum(axis=0)) * STEP_S)


def row(
    name: str, witness: Callable, sensors: Sensors, calm: List[Flown], drifts: List[Flown]
) -> str:
    """One row of the table."""
    random = np.random.default_rng(1)
    told = [witness(f, sensors, random)[1] for f in calm]
    bounds = [
        MARGIN * max(np.nanmax(beyond_line(v, *w), initial=0.0) for v in told) for w in WINDOWS_S
    ]
    seen = []
    for flown in drifts:
        at_s, values = witness(flown, sensors, random)
        crossed = [
            (beyond_line(values, *w) > b) & (at_s >= flown.began_s)
            for w, b in zip(WINDOWS_S, bounds)
        ]
        when = at_s[np.any(crossed, axis=0)]
        if len(when):
            seen.append((when[0] - flown.began_s, drifted_m(flown, when[0])))
    limits = ", ".join(f"{b:.2f}" for b in bounds)
    if not seen:
        return f"| {name} | {limits} | 0 of {len(drifts)} | – | – |"
    after_s, off_m = (np.array(column) for column in zip(*seen))
    times, metres = (f"{np.median(a):.1f}, worst {a.max():.1f}" for a in (after_s, off_m))
    return f"| {name} | {limits} | {len(seen)} of {len(drifts)} | {times} | {metres} |"


def as_flown(calm: List[Flown], drifts: List[Flown], by_pictures: bool) -> str:
    """The row of what the flight link itself doubted first by one of its witnesses, with its
    rules."""
    bound = (
        f"{SceneCheckRules().off_rad:g} rad" if by_pictures else f"{HeightCheckRules().off_m:g} m"
    )
    witness = "pictures" if by_pictures else "barometer"
    calm = [f for f in calm if f.by_pictures == by_pictures]
    seen = [f for f in drifts if np.isfinite(f.doubted_s) and f.by_pictures == by_pictures]
    false = sum(np.isfinite(f.doubted_s) for f in calm)
    name = f"{witness}, as the flight link has it ({false} calm vehicles doubted)"
    if not seen:
        return f"| {name} | {bound} | 0 of {len(drifts)} | – | – |"
    after_s = np.array([f.doubted_s - f.began_s for f in seen])
    off_m = np.array([drifted_m(f, f.doubted_s) for f in seen])
    times, metres = (f"{np.median(a):.1f}, worst {a.max():.1f}" for a in (after_s, off_m))
    return f"| {name} | {bound} | {len(seen)} of {len(drifts)} | {times} | {metres} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--calm", type=int, default=10, help="flights without a fault")
    parser.add_argument(
        "--drifts", type=int, default=20, help="flights with a tracker that drifts slowly"
    )
    parser.add_argument("--flown", action="store_true", help="only what the flight link doubted")
    args = parser.parse_args()
    logging.disable(logging.CRITICAL)
    calm, drifting = fly(NONE, 50001, args.calm), fly(FAULT, 50101, args.drifts)
    drifting = [f for f in drifting if f.began_s < f.t_s[-1] - AT_ONCE_S]
    missed = [f for f in drifting if not f.doubted_s - f.began_s < AT_ONCE_S]
    print(
        f"{len(drifting)} trackers drifted; the flight link doubted {len(drifting) - len(missed)} within "
        f"{AT_ONCE_S:g} s. The others:\n"
    )
    windows = ", ".join(f"{w:g}" for w, _ in WINDOWS_S)
    print(f"| witness | bounds (m/s; m) over {windows} s | seen | after (s) | off by then (m) |")
    print("| --- | --- | --- | --- | --- |")
    for vibration_mps2 in () if args.flown else (0.1, 0.3, 0.5):
        for follows_s in (np.inf, 10.0, 2.5):
            sensors = Sensors(vibration_mps2, follows_s)
            lean = "never" if follows_s == np.inf else f"in {follows_s:g} s"
            print(
                row(
                    f"IMU, vibration {vibration_mps2:g} m/s², lean follows {lean}",
                    by_imu,
                    sensors,
                    calm,
                    missed,
                )
            )
    if not args.flown:
        print(row("barometer, likewise", by_barometer, Sensors(), calm, missed))
    for by_pictures in (False, True):
        print(as_flown(calm, missed, by_pictures))


if __name__ == "__main__":
    main()
