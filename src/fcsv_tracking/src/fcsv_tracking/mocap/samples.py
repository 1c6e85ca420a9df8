# SPDX-License-Identifier: Apache-2.0
"""What comes in, and the checks that need no filter: numbers, stamps, repeated poses, odometry that
jumps."""

from dataclasses import dataclass
from typing import Optional

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.streams.flow import DropCounter
from fcsv_tracking.errors import SampleRejected


@dataclass(frozen=True)
class VehicleSample:
    """One packet of the vehicle's own sensors, all of one moment; accel is specific force (m/s2,
    body)."""

    stamp_s: float
    T_O_D: np.ndarray
    v_O_mps: np.ndarray
    gyro_radps: np.ndarray
    accel_mps2: np.ndarray


@dataclass(frozen=True)
class InputRules:
    """Bounds on what is a sample at all."""

    oldest_s: float = 1.0  # a stamp further back than this, or in the future, is no stamp
    future_s: float = 0.05
    patience_samples: int = 100  # stamps that go back before the clock is taken to have been set
    max_speed_mps: float = 10.0
    max_rate_radps: float = 15.0
    max_accel_mps2: float = 80.0
    max_step_m: float = 0.25  # of the odometry, off what its own velocity says
    max_turn_rad: float = 0.15  # likewise, off what its gyro says
    old_pose_s: float = 0.1  # the same pose for longer than this: the tracker streams an old one

    def __post_init__(self):
        require_positive(self)


class StampGate:
    """Stamps of one stream: near the time of arrival, and rising."""

    def __init__(self, rules: InputRules, counts: DropCounter, stream: str):
        self._rules, self._counts, self._stream = rules, counts, stream
        self._last_s: Optional[float] = None
        self._back_in_a_row = 0

    def check(self, now_s: float, stamp_s: float) -> bool:
        """False on the first stamp after the clock was set back for good. Raises SampleRejected."""
        if not np.isfinite(stamp_s) or stamp_s > now_s + self._rules.future_s:
            raise self.reject(
                "stamp in the future", f"stamp is {stamp_s - now_s:.3f} s ahead of the clock"
            )
        if stamp_s < now_s - self._rules.oldest_s:
            raise self.reject("stamp too old", f"stamp is {now_s - stamp_s:.3f} s old")
        if self._last_s is not None and stamp_s <= self._last_s:
            self._back_in_a_row += 1
            if self._back_in_a_row < self._rules.patience_samples:
                raise self.reject(
                    "stamp goes back", f"stamp goes back {self._last_s - stamp_s:.3f} s"
                )
        continued = not self._back_in_a_row >= self._rules.patience_samples
        self._back_in_a_row = 0
        self._last_s = stamp_s
        return continued

    def reject(self, reason: str, message: str) -> SampleRejected:
        """Count it; the error to raise."""
        self._counts.count(f"{self._stream}: {reason}")
        return SampleRejected(reason, f"{self._stream}: {message}")


class MocapInput:
    """Poses of one body as mocap_optitrack publishes them."""

    def __init__(self, rules: InputRules, counts: DropCounter):
        self._rules = rules
        self.gate = StampGate(rules, counts, "mocap")
        self._last: Optional[np.ndarray] = None
        self._same_since_s = 0.0
        self.old_pose = False

    def check(self, now_s: float, stamp_s: float, p_M_D_m, q_M_D_xyzw) -> np.ndarray:
        """T_M_D of a pose that is new. Raises SampleRejected."""
        try:
            T_M_D = transforms.from_xyz_quaternion(p_M_D_m, q_M_D_xyzw)
        except GeometryError as error:
            raise self.gate.reject("not a pose", str(error)) from error
        self.gate.check(now_s, stamp_s)
        raw = np.concatenate([np.asarray(p_M_D_m, float), np.asarray(q_M_D_xyzw, float)])
        if self._last is not None and np.array_equal(raw, self._last):
            # the topic is faster than the cameras, so a pose may come twice; noise never repeats
            # for long
            self.old_pose = stamp_s - self._same_since_s > self._rules.old_pose_s
            reason = "old pose streamed on" if self.old_pose else "same frame again"
            raise self.gate.reject(
                reason, f"pose is that of {stamp_s - self._same_since_s:.3f} s before"
            )
        self._last, self._same_since_s, self.old_pose = raw, stamp_s, False
        return T_M_D


class VehicleInput:
    """Odometry and IMU of one vehicle."""

    def __init__(self, rules: InputRules, counts: DropCounter):
        self._rules = rules
        self.gate = StampGate(rules, counts, "odometry")
        self._last: Optional[VehicleSample] = None

    def check(
        self, now_s: float, stamp_s: float, p_O_D_m, q_O_D_xyzw, v_D_mps, gyro_radps, accel_mps2
    ):
        """(VehicleSample, whether it continues the one before). Raises SampleRejected."""
        try:
            T_O_D = transforms.from_xyz_quaternion(p_O_D_m, q_O_D_xyzw)
        except GeometryError as error:
            raise self.gate.reject("not a pose", str(error)) from error
        rules, vectors = (
            self._rules,
            [np.asarray(v, float) for v in (v_D_mps, gyro_radps, accel_mps2)],
        )
        bounds = (rules.max_speed_mps, rules.max_rate_radps, rules.max_accel_mps2)
        for name, vector, most in zip(("velocity", "gyro", "accelerometer"), vectors, bounds):
            if not np.isfinite(vector).all() or float(np.sqrt(vector @ vector)) > most:
                raise self.gate.reject(
                    f"{name} impossible", f"{name} is {vector.tolist()}, at most {most:g}"
                )
        continues = self.gate.check(now_s, stamp_s)
        v_D, gyro, accel = vectors
        sample = VehicleSample(stamp_s, T_O_D, T_O_D[:3, :3] @ v_D, gyro, accel)
        before, self._last = self._last, sample
        return sample, continues and (before is None or self._continues(before, sample))

    def _continues(self, a: VehicleSample, b: VehicleSample) -> bool:
        """Whether a step is what velocity and gyro say; over a long silence that says less and
        less."""
        dt_s = b.stamp_s - a.stamp_s
        moved = 0.5 * dt_s * (a.v_O_mps + b.v_O_mps)
        off_m = float(np.linalg.norm(b.T_O_D[:3, 3] - a.T_O_D[:3, 3] - moved))
        turn_rad = transforms.rotation_angle(a.T_O_D, b.T_O_D)
        rate = max(float(np.linalg.norm(a.gyro_radps)), float(np.linalg.norm(b.gyro_radps)))
        slack = 1.0 + 4.0 * max(0.0, dt_s - 0.1)
        return (
            off_m < self._rules.max_step_m * slack
            and turn_rad < self._rules.max_turn_rad * slack + rate * dt_s
        )
