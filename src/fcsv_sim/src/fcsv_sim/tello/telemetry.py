# SPDX-License-Identifier: Apache-2.0
"""What the Tello writes into its flight log, and when: IMU and visual odometry with the errors of
the real ones.

Rates and delays as measured on a real one (notes of tellopy on sensor times, 2026-09): a message
each 50 ms with the gyro's, the controller's and, every second time, the IMU's record; visual
odometry 0.2 to 0.9 s behind the IMU.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Deque, List, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_sim.sensors.tello_sensors import TelloErrors, TelloSample, TelloSensors
from fcsv_sim.tello import log
from fcsv_sim.tello.flight import Felt

# forward, left, up to forward, right, down; the same for the worlds
_FLIP = np.array([1.0, -1.0, -1.0])
_STALE_S = 3.5  # the age since boot of what it sends first
_LOST_JUMP_M = 1.0


def _no_delays() -> TelloErrors:
    return TelloErrors(delay_s=0.0, delay_offset_s=0.0, jitter_s=0.0, loss=0.0)


@dataclass(frozen=True)
class TelemetryParameters:
    """``mvo_delay_s``: least, mean, most; it wanders. ``lost``: share of log messages that it never
    sends."""

    errors: TelloErrors = field(default_factory=_no_delays)
    mvo_delay_s: Tuple[float, float, float] = (0.2, 0.35, 0.9)
    lost: float = 0.08

    def __post_init__(self):
        least, mean, most = self.mvo_delay_s
        if not 0.0 <= least <= mean <= most:
            raise ValueError(f"mvo_delay_s: {self.mvo_delay_s} must rise: least, mean, most")


class Telemetry:
    """advance() every pass; log messages when they are due. ``boot_s``: when it was switched on."""

    def __init__(self, parameters: TelemetryParameters, seed: int, boot_s: float):
        self._p, self._boot_s = parameters, boot_s
        self._random = np.random.default_rng([seed, 47])
        self._sensors = TelloSensors(parameters.errors, seed)
        self._T_N_O = None
        self._past: Deque[Tuple[float, np.ndarray, np.ndarray, float]] = deque()
        self._late_s = parameters.mvo_delay_s[1]
        self._offset_m, self._saw = self._random.normal(0.0, _LOST_JUMP_M, 3), False
        self._count = self._observations = 0
        self._a_before = np.zeros(3)
        self.v_ned_mps = np.zeros(3)

    def first(self) -> bytes:
        """What a real one sends first after somebody connected: three records from just after it
        was switched on."""
        quiet = (
            np.array([0.0, 0.0, 9.81]) * _FLIP,
            np.zeros(3),
            (0.0,) * 4,
            np.zeros(3),
            np.zeros(3),
            0.0,
            35.0,
        )
        ticks = [log.tick_of(_STALE_S + 0.1 * k) for k in range(3)]
        return b"\x00" + b"".join(log.record(log.IMU, tick, log.imu(*quiet)) for tick in ticks)

    def advance(
        self, now_s: float, T_world_body: np.ndarray, v_world_mps, felt: Felt, control
    ) -> List[bytes]:
        """Payloads of log messages; at most one."""
        found = self._sensors.advance(now_s, T_world_body, v_world_mps)
        if not found:
            return []
        sample = found[0]
        if self._T_N_O is None:  # its world begins where it looked when it was switched on
            self._T_N_O = transforms.from_xyz_yaw(np.zeros(3), -transforms.yaw(sample.T_O_D))
        message = self._message(now_s, sample, felt, control)
        return [] if self._random.uniform() < self._p.lost else [message]

    def _message(self, now_s: float, sample: TelloSample, felt: Felt, control) -> bytes:
        self._count += 1
        T_N_D = self._T_N_O @ sample.T_O_D
        v_ned = _FLIP * (self._T_N_O[:3, :3] @ sample.v_O_mps)
        self._past.append((now_s, _FLIP * T_N_D[:3, 3], v_ned, felt.height_m))
        self._wander()
        tick = log.tick_of(now_s - self._boot_s)
        rates = sample.gyro_radps * _FLIP
        stages = [rates + self._random.normal(0.0, sigma, 3) for sigma in (0.02, 0.015, 0.01)]
        records = [
            log.record(log.GYRO, tick, log.gyro(stages)),
            log.record(log.CONTROL, tick, log.control(control)),
        ]
        if self._count % 2:
            records += [
                log.record(log.IMU, tick, self._imu(sample, T_N_D, v_ned, felt)),
                log.record(log.MVO, tick, self._mvo(now_s, felt)),
            ]
        if self._count % 4 == 1:
            records.append(log.record(log.TOF, tick, log.tof(felt.height_m, self._count)))
        return b"\x00" + b"".join(records)

    def _imu(self, sample: TelloSample, T_N_D: np.ndarray, v_ned: np.ndarray, felt: Felt) -> bytes:
        self.v_ned_mps = v_ned
        x, y, z, w = rotations.quaternion_of_matrix(T_N_D[:3, :3])
        a_ned = _FLIP * (T_N_D[:3, :3] @ sample.accel_mps2 - [0.0, 0.0, 9.81])
        rates = sample.gyro_radps * _FLIP
        return log.imu(
            sample.accel_mps2 * _FLIP, rates, (w, x, -y, -z), a_ned, v_ned, felt.height_m, 60.0
        )

    def _wander(self) -> None:
        """The delay of the odometry: about its mean with a time constant of half a second, within
        its limits."""
        least, mean, most = self._p.mvo_delay_s
        keep = np.exp(-0.1)
        sigma = 0.4 * (mean - least) * np.sqrt(1.0 - keep**2)
        late_s = mean + keep * (self._late_s - mean) + self._random.normal(0.0, sigma)
        self._late_s = float(np.clip(late_s, least, most))

    def _mvo(self, now_s: float, felt: Felt) -> bytes:
        """Where it can see nothing below it says numbers below 3 cm that mean nothing, and is
        elsewhere afterwards."""
        while len(self._past) > 2 and self._past[1][0] <= now_s - self._late_s:
            self._past.popleft()
        _, p, v, height_m = self._past[0]
        if not felt.sees_ground:
            self._saw = False
            return log.mvo(
                np.zeros(3), self._random.uniform(-0.02, 0.02, 3), 0.0, 0, self._observations
            )
        if not self._saw:
            self._saw = True
            self._offset_m = self._random.normal(0.0, _LOST_JUMP_M, 3)
        self._observations += 1
        valid = log.POSITION_BITS | log.VELOCITY_BITS
        return log.mvo(v, p + self._offset_m, height_m, valid, self._observations)
