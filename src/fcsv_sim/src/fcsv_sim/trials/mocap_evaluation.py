# SPDX-License-Identifier: Apache-2.0
"""A pair of Tellos in view, then out of it for 20 m, then back: how far the tracker is from the
truth all the while."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.errors import GeometryError
from fcsv_sim.trials import mocap_flight
from fcsv_sim.trials.mocap_flight import T_WORLD_MOCAP, FlightErrors, TrueTrack
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.mocap import equations
from fcsv_tracking.mocap.rules import TrackerRules
from fcsv_tracking.mocap.system import MocapSystem

RATE_HZ = 30.0
AWAY_M = 20.0
LEVEL_AFTER_S = 10.0  # from the start: five seconds of both in view
SETTLED_S = 3.0  # in view for so long before a pose counts as one in view
START_S = 1000.0
_AHEAD = np.array([np.cos(np.radians(20.0)), np.sin(np.radians(20.0))])


@dataclass(frozen=True)
class PoseErrorRecord:
    """One pose given out, against the truth at its stamp; errors in M's axes."""

    stamp_s: float
    error_m: np.ndarray
    error_rad: np.ndarray
    covariance: np.ndarray
    in_view: bool
    settled: bool
    away_m: float  # true distance flown since it left the view
    raw_m: float  # odometry's own error since then, in the axes of the moment of leaving


@dataclass
class EvaluatedFlight:
    """All that one flight gave; ``relative`` holds (in view of both, error m, error rad, normalised
    error)."""

    records: Dict[str, List[PoseErrorRecord]]
    level_deg: List[Tuple[float, float]]
    relative: List[Tuple[bool, float, float, float]]
    system: MocapSystem
    truths: Dict[str, TrueTrack]
    wrong_poses: int = 0


def in_view(flight: EvaluatedFlight) -> Dict[str, float]:
    """Errors (m, deg) of poses of both vehicles while in view: rms, 95 %, worst."""
    settled = [r for records in flight.records.values() for r in records if r.settled]
    out = {}
    for unit, errors in (
        ("m", [r.error_m for r in settled]),
        ("deg", [np.degrees(r.error_rad) for r in settled]),
    ):
        size = np.linalg.norm(errors, axis=1)
        out.update(
            {
                f"rms_{unit}": float(np.sqrt(np.mean(size**2))),
                f"p95_{unit}": float(np.percentile(size, 95)),
                f"worst_{unit}": float(size.max()),
            }
        )
    return out


def at_20_m(records: List[PoseErrorRecord]) -> PoseErrorRecord:
    """The pose after 20 m out of view."""
    return min((r for r in records if r.away_m > 0.0), key=lambda r: abs(r.away_m - AWAY_M))


def normalised(record: PoseErrorRecord) -> float:
    """Squared error over covariance, six degrees of freedom."""
    error = np.concatenate([record.error_m, record.error_rad])
    return float(error @ np.linalg.solve(record.covariance, error))


def normalised_in_view(flight: EvaluatedFlight) -> List[float]:
    """The middle one of either vehicle: constant errors of a mounting make poses of one flight
    alike."""
    settled = [[r for r in records if r.settled] for records in flight.records.values()]
    return [normalised(records[len(records) // 2]) for records in settled]


def largest_jump_m(records: List[PoseErrorRecord]) -> float:
    """Largest step between neighbouring poses that the vehicle did not move, from the re-entry
    on."""
    last_away = max(i for i, r in enumerate(records) if r.away_m > 0.0)
    errors = np.array([r.error_m for r in records[last_away:]])
    return float(np.linalg.norm(np.diff(errors, axis=0), axis=1).max())


def truths(seed: int) -> Dict[str, TrueTrack]:
    """Vehicle a stays in view, b leaves it for 24 m and comes back."""
    x, y = 2.0 * _AHEAD
    around = [
        (x, y, 2.1, 5),
        (x + 0.4, y, 2.2, 3),
        (x, y + 0.4, 1.9, 3),
        (x - 0.3, y - 0.2, 2.0, 3),
        (x, y, 2.1, 3),
    ]
    a = [
        (x, y, 0.02, 0),
        *around,
        (x, y, 2.1, 4),
        (x + 0.3, y, 2.1, 4),
        (x, y + 0.3, 2.2, 4),
        (x, y, 2.1, 4),
        *[(x + dx, y, 2.1, 5) for dx in (0.3, 0.0, 0.3, 0.0, 0.3, 0.0)],
    ]
    u, w = x + 0.5 * _AHEAD[0] - 0.45 * _AHEAD[1], y + 0.5 * _AHEAD[1] + 0.45 * _AHEAD[0]
    b = [(u, w, 0.02, 0)] + [(px + u - x, py + w - y, pz + 0.25, s) for px, py, pz, s in around]
    b += [
        (u, w, 2.4, 2),
        (u + 11.2, w + 2.0, 2.6, 13),
        (u + 10.7, w + 4.5, 2.8, 5),
        (u, w, 2.4, 13),
        (u + 0.2, w + 0.1, 2.4, 4),
        (u, w, 2.4, 5),
    ]
    return {
        "a": mocap_flight.fly(a, 0.1, seed, START_S),
        "b": mocap_flight.fly(b, -0.1, seed + 500, START_S),
    }


def evaluate(
    seed: int,
    errors: Optional[FlightErrors] = None,
    rules: Optional[TrackerRules] = None,
    hidden=lambda _t_s: (),
) -> EvaluatedFlight:
    """Fly the pair and follow it."""
    flown = truths(seed)
    errors = errors or FlightErrors()
    system = MocapSystem({n: np.eye(4) for n in flown}, rules)
    watches = {n: _Watch(T, errors) for n, T in flown.items()}
    flight = EvaluatedFlight({n: w.records for n, w in watches.items()}, [], [], system, flown)
    next_s = 0.0
    for now_s, name, message in mocap_flight.messages(flown, errors, seed, hidden):
        watches[name].on_message(message)
        flight.wrong_poses += (
            isinstance(message, mocap_flight.MocapPose) and message.seen and not message.true_pose
        )
        _deliver(system, name, message)
        if now_s >= next_s:
            next_s = now_s + 1.0 / RATE_HZ
            for vehicle, watch in watches.items():
                watch.look(system.trackers[vehicle].pose(now_s))
            _look_at_both(flight, now_s)
    return flight


def _deliver(system: MocapSystem, name: str, message) -> None:
    try:
        mocap_flight.deliver(Named(system, name), message)
    except SampleRejected:
        pass  # counted where it was rejected


class Named:
    """One vehicle of a system, as a tracker."""

    def __init__(self, system: MocapSystem, name: str):
        self._system, self._name = system, name

    def add_mocap(self, *args) -> None:
        self._system.add_mocap(self._name, *args)

    def add_vehicle(self, *args) -> None:
        self._system.add_vehicle(self._name, *args)


class _Watch:
    """Compares one vehicle's poses with the truth."""

    def __init__(self, truth: TrueTrack, errors: FlightErrors):
        self._truth = truth
        self.records: List[PoseErrorRecord] = []
        self._path_m = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(truth.p, axis=0), axis=1))]
        )
        self._left: Optional[Tuple[float, np.ndarray]] = None
        self._entered_s: Optional[float] = None
        self._seen_s = -np.inf
        self._packet = self._packet_left = None

    def on_message(self, message) -> None:
        if isinstance(message, mocap_flight.TelloSample):
            self._packet = message
        elif message.seen:
            if self._left is not None or self._entered_s is None:
                self._left, self._entered_s = None, message.arrival_s
            self._seen_s, self._packet_left = message.arrival_s, self._packet
        elif self._left is None and message.arrival_s - self._seen_s > 0.3:
            self._left = (self._packet_left.truth_s, self._truth.at(self._packet_left.truth_s))

    def look(self, pose) -> None:
        if pose is None or (self.records and pose.stamp_s <= self.records[-1].stamp_s):
            return
        T_M_D = transforms.invert(T_WORLD_MOCAP) @ self._truth.at(pose.stamp_s)
        turn = rotations.log(pose.T_M_D[:3, :3] @ T_M_D[:3, :3].T)
        settled = self._left is None and pose.stamp_s - self._entered_s > SETTLED_S
        away_m = raw_m = 0.0
        if self._left is not None:
            away_m = self._flown(self._left[0], self._packet.truth_s)
            raw_m = self._odometry_error()
        self.records.append(
            PoseErrorRecord(
                pose.stamp_s,
                pose.T_M_D[:3, 3] - T_M_D[:3, 3],
                turn,
                pose.covariance,
                pose.in_view,
                settled,
                away_m,
                raw_m,
            )
        )

    def _flown(self, from_s: float, to_s: float) -> float:
        return float(np.diff(np.interp([from_s, to_s], self._truth.t_s, self._path_m))[0])

    def _odometry_error(self) -> float:
        """How far the odometry is off what was flown since the view was left, were its axes known
        exactly then."""
        T_left, now = self._left[1], self._truth.at(self._packet.truth_s)
        R_O_world = self._packet_left.T_O_D[:3, :3] @ T_left[:3, :3].T
        moved_O = self._packet.T_O_D[:3, 3] - self._packet_left.T_O_D[:3, 3]
        return float(np.linalg.norm(moved_O - R_O_world @ (now[:3, 3] - T_left[:3, 3])))


def _look_at_both(flight: EvaluatedFlight, now_s: float) -> None:
    try:
        R_M_W, _ = flight.system.level()
    except GeometryError:
        return
    up_M = T_WORLD_MOCAP[:3, :3].T[:, 2]
    flight.level_deg.append((now_s, float(np.degrees(np.arccos(min(1.0, R_M_W[:, 2] @ up_M))))))
    poses = [flight.system.trackers[n].pose(now_s) for n in ("a", "b")]
    relative = flight.system.relative("a", "b", now_s)
    if relative is None or abs(poses[0].stamp_s - poses[1].stamp_s) > 0.02:
        return
    T_Da_Db, C = relative
    T_true = equations.relative_in_view(
        *(flight.truths[n].at(p.stamp_s) for n, p in zip(("a", "b"), poses))
    )
    turn = rotations.log(T_Da_Db[:3, :3] @ T_true[:3, :3].T)
    error = np.concatenate([T_Da_Db[:3, 3] - T_true[:3, 3], turn])
    flight.relative.append(
        (
            poses[1].in_view,
            float(np.linalg.norm(error[:3])),
            float(np.linalg.norm(turn)),
            float(error @ np.linalg.solve(C, error)),
        )
    )
