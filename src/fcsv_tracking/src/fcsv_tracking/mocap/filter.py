# SPDX-License-Identifier: Apache-2.0
"""An error-state Kalman filter on State: one vehicle's pose, odometry offset, drift and delay (Solà
2017, chapter 5).

Queues, gates and bad input are in tracker.py. Time is only in ``dt_s``.
"""

from dataclasses import dataclass, field
from typing import Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.config import require_positive
from fcsv_tracking.mocap import measurements
from fcsv_tracking.mocap.markers import MarkerNoise, MarkerRules
from fcsv_tracking.mocap.state import (
    BA,
    DELAY,
    G_MPS2,
    PHI,
    PO,
    SIZE,
    TH,
    B,
    MocapState,
    P,
    V,
    advance,
    advance_jacobian,
)

PERIOD_S = 0.05  # of the vehicle's packets


@dataclass(frozen=True)
class FilterNoise:
    """Standard deviations; the mocap's own are those of its markers."""

    turn_deg: float = 0.04  # of the turn between two samples of attitude
    accel_mps2: float = 0.25  # a sample at 20 Hz stands for what happens between
    accel_bias_walk: float = 1e-3  # m/s2 per root second
    odometry_position_m: float = 0.006  # quantisation and noise; the drift is its own state
    odometry_velocity_mps: float = 0.05
    # of odometry that adds up speeds: wanders while it stands, too
    odometry_walk_m_per_sqrt_s: float = 1e-9
    odometry_jitter_s: float = 0.006  # of the messages' delay
    attitude_deg: float = 0.45  # coloured over half a second, at 20 Hz, weighed for that
    heading_walk_deg_per_sqrt_s: float = 0.04
    level_walk_deg_per_sqrt_s: float = 0.004
    level_deg: float = 0.08  # constant error of either level, which no time averages away
    drift_share: float = 0.0257  # rms
    # how far a drift that was learned is followed (docs/lab/mocap.md: why no further)
    drift_length_m: float = 7.0
    delay_s: float = 0.03  # first guess's error
    delay_walk_s: float = 2e-4  # per root second
    mocap_jitter_s: float = 0.0017  # of the topic's stamps
    body_m: float = 0.0003  # where the tracker's rigid body was put in the vehicle
    body_deg: float = 0.04
    vibration_deg: float = 0.06  # of the airframe, an axis: 20 samples a second cannot follow it
    markers: MarkerRules = field(default_factory=MarkerRules)

    def __post_init__(self):
        require_positive(self)


class MocapFilter:
    """State and covariance (22,22). Every correction returns its squared Mahalanobis distance
    before it is taken."""

    def __init__(
        self,
        noise: FilterNoise,
        T_M_D: np.ndarray,
        T_O_D: np.ndarray,
        v_O: np.ndarray,
        delay_s: float,
    ):
        self._noise = n = noise
        self._markers = MarkerNoise(n.markers)
        T_M_O = T_M_D @ transforms.invert(T_O_D)
        zero = np.zeros(3)
        self.state = MocapState(
            T_M_D[:3, 3].copy(),
            T_M_O[:3, :3] @ v_O,
            T_M_D[:3, :3].copy(),
            T_M_O[:3, 3],
            T_M_O[:3, :3],
            zero,
            zero,
            delay_s,
        )
        deg = np.pi / 180.0
        begin = [0.02, 0.5, 3 * deg, 0.1, 3 * deg, n.drift_share / np.sqrt(3.0), 0.05]
        self.covariance = np.diag([*np.repeat(begin, 3), n.delay_s]) ** 2

    def predict(
        self, rate_radps: np.ndarray, accel_mps2: np.ndarray, dt_s: float, apart_s: float = PERIOD_S
    ) -> None:
        """Move on by ``dt_s`` between two samples of the IMU that are ``apart_s`` apart."""
        n, apart_s = self._noise, max(apart_s, PERIOD_S)
        # what lies between two samples errs alike until the next: as white noise that is its
        # density; and of a force that changes, a straight line between them knows the less the
        # further apart they are
        accel_mps2_off = n.accel_mps2 * apart_s / PERIOD_S
        turn_density = np.radians(n.turn_deg) ** 2 / PERIOD_S
        self._move_on(
            rate_radps, accel_mps2, dt_s, accel_mps2_off**2 * apart_s * dt_s, turn_density * dt_s
        )

    def coast(self, dt_s: float, silent_s: float) -> None:
        """Move on by ``dt_s`` without an IMU, as if hovering; by then nothing has been heard for
        ``silent_s``."""
        # 2 m/s2 that change, 60 deg/s that last: between two frames of the mocap no body turns as
        # swapped markers do
        turned = np.radians(60.0) ** 2 * (2.0 * silent_s - dt_s) * dt_s
        self._move_on(np.zeros(3), np.array([0.0, 0.0, G_MPS2]), dt_s, 4.0 * dt_s, turned)

    def _move_on(
        self, rate_radps, accel_mps2, dt_s: float, velocity_variance: float, turn_variance: float
    ) -> None:
        n, s = self._noise, self.state
        F = advance_jacobian(s, rate_radps, accel_mps2, dt_s, n.drift_length_m)
        self.state = advance(s, rate_radps, accel_mps2, dt_s, n.drift_length_m)
        q = np.zeros(SIZE)
        q[V], q[TH] = velocity_variance, turn_variance
        q[PHI] = np.radians(n.level_walk_deg_per_sqrt_s) ** 2 * dt_s
        q[PHI.start + 2] = np.radians(n.heading_walk_deg_per_sqrt_s) ** 2 * dt_s
        moved_m = float(np.sqrt(s.v_M @ s.v_M)) * dt_s
        q[PO] = n.odometry_walk_m_per_sqrt_s**2 * dt_s
        q[B] = n.drift_share**2 / 3.0 * 2.0 * moved_m / n.drift_length_m
        q[BA] = n.accel_bias_walk**2 * dt_s
        q[DELAY] = n.delay_walk_s**2 * dt_s
        self.covariance = F @ self.covariance @ F.T
        self.covariance.flat[:: SIZE + 1] += q

    def mocap(self, T_M_D: np.ndarray) -> "Correction":
        """A pose by the tracker on the ground."""
        residual, H = measurements.mocap_pose(self.state, T_M_D)
        return Correction(self, residual, H, self._mocap_noise(T_M_D[:3, 3]))

    def odometry(self, p_O_D: np.ndarray, v_O: np.ndarray, assumed_delay_s: float) -> "Correction":
        """Position and velocity by the vehicle, put at its stamp less ``assumed_delay_s``."""
        n = self._noise
        residual, H = measurements.odometry(
            self.state, p_O_D, v_O, self.state.delay_s - assumed_delay_s
        )
        R = np.diag(np.repeat([n.odometry_position_m, n.odometry_velocity_mps], 3) ** 2)
        v_m = self.state.R_M_O.T @ self.state.v_M * n.odometry_jitter_s
        R[:3, :3] += np.outer(v_m, v_m)
        return Correction(self, residual, H, R)

    def attitude(
        self, R_O_D: np.ndarray, rate_radps: np.ndarray, assumed_delay_s: float
    ) -> "Correction":
        """Attitude by the vehicle's IMU, likewise."""
        late_s = self.state.delay_s - assumed_delay_s
        residual, H = measurements.attitude(self.state, R_O_D, rate_radps, late_s)
        turn = rate_radps * self._noise.odometry_jitter_s
        R = np.eye(3) * np.radians(self._noise.attitude_deg) ** 2 + np.outer(turn, turn)
        return Correction(self, residual, H, R)

    def inflate(self, error: np.ndarray) -> None:
        """Add independent errors (22,) standard deviations."""
        self.covariance.flat[:: SIZE + 1] += error**2

    def move_odometry(self, T_O_D: np.ndarray, p_sigma_m: float, yaw_sigma_rad: float) -> None:
        """The odometry began anew: the offset is re-anchored on the pose as it is now, level kept.

        T_M_O' = T_M_D T_D_O' with the heading alone free, so the pose stays and its errors become
        the offset's.
        """
        s = self.state
        up_M = s.R_M_O[:, 2]
        R = s.R_M_D @ T_O_D[:3, :3].T
        turn = rotations.between(R[:, 2], up_M)
        R_M_O = turn @ R
        moved = MocapState(
            s.p_M_D,
            s.v_M,
            s.R_M_D,
            s.p_M_D - R_M_O @ T_O_D[:3, 3],
            R_M_O,
            s.drift_O,
            s.accel_bias_mps2,
            s.delay_s,
        )
        J = np.eye(SIZE)
        J[PO, :], J[PHI.start + 2, :] = 0.0, 0.0
        J[PO, P] = np.eye(3)
        J[PHI.start + 2, TH] = R_M_O[:, 2] @ s.R_M_D  # heading follows the body's
        C = J @ self.covariance @ J.T
        lever = np.cross(R_M_O[:, 2], R_M_O @ T_O_D[:3, 3])
        yaw = np.zeros(SIZE)
        yaw[PHI.start + 2], yaw[PO] = 1.0, -lever
        C += yaw_sigma_rad**2 * np.outer(yaw, yaw)
        C[PO, PO] += p_sigma_m**2 * np.eye(3)
        self.state, self.covariance = moved, C

    def pose_covariance(self) -> np.ndarray:
        """(6,6) of the body in M: position (m), rotation about M's axes (rad); constant errors of
        level included."""
        s = self.state
        J = np.zeros((6, SIZE))
        J[:3, P], J[3:, TH] = np.eye(3), s.R_M_D
        C = J @ self.covariance @ J.T
        C[:3, :3] += self._noise.body_m**2 * np.eye(3)
        C[3:, 3:] += (
            np.radians(self._noise.body_deg) ** 2 + np.radians(self._noise.vibration_deg) ** 2
        ) * np.eye(3)
        return C

    def level_covariance(self) -> np.ndarray:
        """(3,3) rad^2 about M's axes of the rotation R_M_O."""
        C = self.covariance[PHI, PHI] + np.diag(
            [np.radians(self._noise.level_deg) ** 2] * 2 + [0.0]
        )
        return self.state.R_M_O @ C @ self.state.R_M_O.T

    def _mocap_noise(self, p_M_D: np.ndarray) -> np.ndarray:
        """(6,6) of a pose by the tracker: its markers, when it was, and the airframe's
        vibration."""
        n, s = self._noise, self.state
        R = self._markers.pose_covariance(s.R_M_D, p_M_D)
        v_m = s.v_M * n.mocap_jitter_s
        R[:3, :3] += np.outer(v_m, v_m)
        R[3:, 3:] += np.radians(n.vibration_deg) ** 2 * np.eye(3)
        return R


class Correction:
    """One measurement against the state: look at ``distance2`` first, then apply()."""

    def __init__(self, owner: MocapFilter, residual: np.ndarray, H: np.ndarray, R: np.ndarray):
        self._owner, self.residual, self._H, self._R = owner, residual, H, R
        self._PHt = owner.covariance @ H.T
        self.S = H @ self._PHt + R
        self._S_inverse = np.linalg.inv(self.S)

    @property
    def distance2(self) -> float:
        """Squared Mahalanobis distance of the residual."""
        return float(self.residual @ self._S_inverse @ self.residual)

    def part(self, rows: slice) -> Tuple[float, np.ndarray]:
        """Squared distance and residual of some rows alone."""
        r = self.residual[rows]
        return float(r @ np.linalg.solve(self.S[rows, rows], r)), r

    def apply(self) -> None:
        """Take it, in Joseph's form: the covariance stays symmetric and positive."""
        owner = self._owner
        K = self._PHt @ self._S_inverse
        IKH = np.eye(SIZE) - K @ self._H
        C = IKH @ owner.covariance @ IKH.T + K @ self._R @ K.T
        owner.covariance = 0.5 * (C + C.T)
        owner.state = owner.state.boxplus(K @ self.residual)
