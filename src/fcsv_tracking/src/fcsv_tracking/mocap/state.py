# SPDX-License-Identifier: Apache-2.0
"""What the filter of one vehicle estimates, and how that moves on with the vehicle's IMU.

Frames: M mocap, O the vehicle's odometry (its IMU's idea of level), D body. The error state is
ordered as the slices below; rotations err on the right, R = R_estimated exp(error). ``T_M_O`` is
the offset that the thesis saves (equation 5.2); it drifts as the odometry does, by ``drift_O``
metres per metre moved (a vector in O).
"""

from dataclasses import dataclass, replace

import numpy as np

from fcsv_geometry import rotations, transforms

G_MPS2 = 9.81
P, V, TH, PO, PHI, B, BA, DELAY = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    slice(9, 12),
    slice(12, 15),
    slice(15, 18),
    slice(18, 21),
    21,
)
SIZE = 22
_G_O = np.array([0.0, 0.0, -G_MPS2])
_SPEED_FLOOR_MPS = 1e-6


@dataclass(frozen=True)
class MocapState:
    """Nominal state. ``delay_s``: how long after the truth the odometry's messages are stamped."""

    p_M_D: np.ndarray
    v_M: np.ndarray  # m/s
    R_M_D: np.ndarray
    p_M_O: np.ndarray
    R_M_O: np.ndarray
    drift_O: np.ndarray  # odometry's error per metre moved
    accel_bias_mps2: np.ndarray  # body
    delay_s: float

    @property
    def T_M_D(self) -> np.ndarray:
        return transforms.transform(self.R_M_D, self.p_M_D)

    @property
    def T_M_O(self) -> np.ndarray:
        return transforms.transform(self.R_M_O, self.p_M_O)

    def boxplus(self, error: np.ndarray) -> "MocapState":
        """The state moved by an error vector (22,)."""
        return MocapState(
            self.p_M_D + error[P],
            self.v_M + error[V],
            self.R_M_D @ rotations.exp(error[TH]),
            self.p_M_O + error[PO],
            self.R_M_O @ rotations.exp(error[PHI]),
            self.drift_O + error[B],
            self.accel_bias_mps2 + error[BA],
            self.delay_s + float(error[DELAY]),
        )

    def boxminus(self, other: "MocapState") -> np.ndarray:
        """Error vector (22,) that takes ``other`` to this state."""
        return np.concatenate(
            [
                self.p_M_D - other.p_M_D,
                self.v_M - other.v_M,
                rotations.log(other.R_M_D.T @ self.R_M_D),
                self.p_M_O - other.p_M_O,
                rotations.log(other.R_M_O.T @ self.R_M_O),
                self.drift_O - other.drift_O,
                self.accel_bias_mps2 - other.accel_bias_mps2,
                [self.delay_s - other.delay_s],
            ]
        )


def advance(
    state: MocapState,
    rate_radps: np.ndarray,
    accel_mps2: np.ndarray,
    dt_s: float,
    drift_length_m: float,
) -> MocapState:
    """The state ``dt_s`` later, turning at a rate under an acceleration (body; specific force;
    level is O's)."""
    a_M = state.R_M_D @ (accel_mps2 - state.accel_bias_mps2) + state.R_M_O @ _G_O
    moved_m = _speed(state) * dt_s
    return replace(
        state,
        p_M_D=state.p_M_D + state.v_M * dt_s + 0.5 * dt_s**2 * a_M,
        v_M=state.v_M + dt_s * a_M,
        R_M_D=state.R_M_D @ rotations.exp(rate_radps * dt_s),
        p_M_O=state.p_M_O - state.R_M_O @ state.drift_O * moved_m,
        drift_O=state.drift_O * np.exp(-moved_m / drift_length_m),
    )


def advance_jacobian(
    state: MocapState,
    rate_radps: np.ndarray,
    accel_mps2: np.ndarray,
    dt_s: float,
    drift_length_m: float,
) -> np.ndarray:
    """(22,22) of advance() with respect to the error state."""
    speed = _speed(state)
    moved_m, keep = speed * dt_s, np.exp(-speed * dt_s / drift_length_m)
    d_moved = state.v_M / speed * dt_s
    a_th = -state.R_M_D @ rotations.skew(accel_mps2 - state.accel_bias_mps2)
    a_phi = -state.R_M_O @ rotations.skew(_G_O)
    F = np.eye(SIZE)
    F[P, V] = np.eye(3) * dt_s
    F[P, TH], F[P, PHI] = 0.5 * dt_s**2 * a_th, 0.5 * dt_s**2 * a_phi
    F[V, TH], F[V, PHI] = dt_s * a_th, dt_s * a_phi
    F[P, BA], F[V, BA] = -0.5 * dt_s**2 * state.R_M_D, -dt_s * state.R_M_D
    F[TH, TH] = rotations.exp(-rate_radps * dt_s)
    F[PO, V] = -np.outer(state.R_M_O @ state.drift_O, d_moved)
    F[PO, PHI] = moved_m * state.R_M_O @ rotations.skew(state.drift_O)
    F[PO, B] = -moved_m * state.R_M_O
    F[B, B] = keep * np.eye(3)
    F[B, V] = np.outer(state.drift_O, -keep / drift_length_m * d_moved)
    return F


def _speed(state: MocapState) -> float:
    return max(float(np.sqrt(state.v_M @ state.v_M)), _SPEED_FLOOR_MPS)
