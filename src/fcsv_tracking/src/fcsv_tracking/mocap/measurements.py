# SPDX-License-Identifier: Apache-2.0
"""What mocap, odometry and attitude should read in a state: residuals, and the Jacobian H of what
is expected.

H is that at the expected reading, never at the one that came: turned by a frame's noise it would
weigh every frame by its own error, and where noise is much larger about one axis than another that
bends the mean (0.1 degrees of level).

``late_s`` is the state's delay minus the one that was assumed when the sample was put at its time,
so that a better idea of the delay moves samples that are already there.
"""

from typing import Tuple

import numpy as np

from fcsv_geometry import rotations
from fcsv_tracking.mocap.state import DELAY, PHI, PO, SIZE, TH, B, MocapState, P, V

Residual = Tuple[np.ndarray, np.ndarray]


def mocap_pose(state: MocapState, T_M_D: np.ndarray) -> Residual:
    """Six: position (m, M), rotation (rad, body) of the tracker's pose."""
    turn = rotations.log(state.R_M_D.T @ T_M_D[:3, :3])
    H = np.zeros((6, SIZE))
    H[:3, P] = np.eye(3)
    H[3:, TH] = np.eye(3)
    return np.concatenate([T_M_D[:3, 3] - state.p_M_D, turn]), H


def odometry(state: MocapState, p_O_D: np.ndarray, v_O: np.ndarray, late_s: float) -> Residual:
    """Six: position (m) and velocity (m/s) by the odometry, in its own frame, drift included."""
    R_O_M = state.R_M_O.T
    position = R_O_M @ (state.p_M_D - state.v_M * late_s - state.p_M_O)
    v_seen = R_O_M @ state.v_M
    speed = max(float(np.sqrt(state.v_M @ state.v_M)), 1e-6)
    H = np.zeros((6, SIZE))
    H[:3, P], H[:3, V], H[:3, PO] = R_O_M, -late_s * R_O_M, -R_O_M
    H[:3, PHI] = rotations.skew(position)
    H[:3, DELAY] = -v_seen
    H[3:, V] = R_O_M + np.outer(state.drift_O, state.v_M / speed)
    H[3:, PHI] = rotations.skew(v_seen)
    H[3:, B] = speed * np.eye(3)
    return np.concatenate([p_O_D - position, v_O - v_seen - state.drift_O * speed]), H


def attitude(
    state: MocapState, R_O_D: np.ndarray, rate_radps: np.ndarray, late_s: float
) -> Residual:
    """Three (rad, body): the IMU's attitude in its odometry frame."""
    turned = rotations.exp(-rate_radps * late_s)
    R_expected = state.R_M_O.T @ state.R_M_D @ turned
    residual = rotations.log(R_expected.T @ R_O_D)
    H = np.zeros((3, SIZE))
    H[:, TH] = turned.T
    H[:, PHI] = -R_expected.T
    H[:, DELAY] = -rate_radps  # along the rotation's own axis the right Jacobian is one
    return residual, H
