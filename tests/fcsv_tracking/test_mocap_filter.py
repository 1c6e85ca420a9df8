# SPDX-License-Identifier: Apache-2.0
"""The filter's own Jacobians against numeric ones, and what move_odometry() promises."""

import numpy as np
import pytest

from fcsv_geometry import transforms as tf
from fcsv_tracking.mocap import measurements, so3
from fcsv_tracking.mocap.filter import FilterNoise, MocapFilter
from fcsv_tracking.mocap.state import PHI, PO, SIZE, P, State, V, advance, advance_jacobian

EPSILON = 1e-6


def random_state(random):
    turn = so3.exp(random.normal(0.0, 1.0, 3))
    return State(
        random.normal(0.0, 2.0, 3), random.normal(0.0, 1.0, 3), turn, random.normal(0.0, 2.0, 3),
        so3.exp(random.normal(0.0, 1.0, 3)), random.normal(0.0, 0.02, 3), random.normal(0.0, 0.1, 3), 0.07,
    )  # fmt: skip


def numeric(f, size):
    """Central differences of a vector function of the error state."""
    columns = []
    for i in range(SIZE):
        e = np.zeros(SIZE)
        e[i] = EPSILON
        columns.append((f(e) - f(-e)) / (2.0 * EPSILON))
    return np.stack(columns, axis=1).reshape(size, SIZE)


# central differences err by EPSILON^2 times a third derivative (of order 10) and 1e-16 / EPSILON by rounding: 1e-9
TOLERANCE = 2e-8


@pytest.mark.parametrize("seed", range(20))
def test_jacobian_of_the_motion(seed):
    random = np.random.default_rng(seed)
    state = random_state(random)
    arguments = random.normal(0.0, 1.0, 3), random.normal(0.0, 3.0, 3) + [0, 0, 9.8], 0.05, 20.0
    after = advance(state, *arguments)
    F = numeric(lambda e: advance(state.boxplus(e), *arguments).boxminus(after), SIZE)
    assert np.abs(F - advance_jacobian(state, *arguments)).max() < TOLERANCE


@pytest.mark.parametrize("seed", range(20))
def test_jacobians_of_the_measurements(seed):
    random = np.random.default_rng(100 + seed)
    state = random_state(random)
    near = so3.exp(random.normal(0.0, 0.3, 3))
    T_M_D = tf.transform(state.R_M_D @ near, state.p_M_D + random.normal(0.0, 0.1, 3))
    R_O_D = state.R_M_O.T @ state.R_M_D @ near
    p_O, v_O, rate = random.normal(0.0, 3.0, 3), random.normal(0.0, 1.0, 3), random.normal(0.0, 1.0, 3)
    late_s = 0.013
    models = {
        "mocap": (6, lambda s: measurements.mocap_pose(s, T_M_D)),
        "odometry": (6, lambda s: measurements.odometry(s, p_O, v_O, late_s + s.delay_s - state.delay_s)),
        "attitude": (3, lambda s: measurements.attitude(s, R_O_D, rate, late_s + s.delay_s - state.delay_s)),
    }
    for name, (size, model) in models.items():
        H = -numeric(lambda e, model=model: model(state.boxplus(e))[0], size)
        assert np.abs(H - model(state)[1]).max() < TOLERANCE, name


def test_residuals_vanish_on_the_truth():
    random = np.random.default_rng(5)
    state = random_state(random)
    speed, R_O_M = np.linalg.norm(state.v_M), state.R_M_O.T
    p_O = R_O_M @ (state.p_M_D - state.p_M_O)
    assert np.allclose(measurements.mocap_pose(state, state.T_M_D)[0], 0.0)
    assert np.allclose(measurements.odometry(state, p_O, R_O_M @ state.v_M + speed * state.drift_O, 0.0)[0], 0.0)
    assert np.allclose(measurements.attitude(state, R_O_M @ state.R_M_D, np.ones(3), 0.0)[0], 0.0)


def test_boxminus_undoes_boxplus():
    random = np.random.default_rng(6)
    state, error = random_state(random), random.normal(0.0, 0.3, SIZE)
    assert np.allclose(state.boxplus(error).boxminus(state), error, atol=1e-12)


def test_rotation_vectors_near_nothing_and_near_half_a_turn():
    random = np.random.default_rng(7)
    for angle in (0.0, 1e-9, 1e-5, 1.0, np.pi - 1e-4, np.pi):
        axis = random.normal(0.0, 1.0, 3)
        v = axis / np.linalg.norm(axis) * angle
        assert np.allclose(so3.exp(so3.log(so3.exp(v))), so3.exp(v), atol=1e-7)


def test_odometry_that_began_anew_leaves_the_pose_and_keeps_level():
    T_M_D = tf.from_xyz_rpy([2.0, 1.0, 0.5], [0.02, -0.75, 0.4])
    T_M_O = tf.from_xyz_rpy([0.4, 0.3, -1.0], [0.01, -0.8, 1.2])
    core = MocapFilter(FilterNoise(), T_M_D, tf.invert(T_M_O) @ T_M_D, 0.07)
    turned = tf.from_xyz_yaw([3.0, -2.0, 0.1], 2.0) @ tf.invert(T_M_O) @ T_M_D
    pose_before, up_before = core.state.T_M_D, core.state.R_M_O[:, 2].copy()
    C_before = core.covariance.copy()
    core.move_odometry(turned, 0.05, np.radians(1.0))
    assert np.allclose(core.state.T_M_D, pose_before) and np.allclose(core.state.R_M_O[:, 2], up_before)
    assert np.allclose(core.state.T_M_O @ turned, pose_before, atol=1e-9)
    assert np.allclose(core.covariance[P, P], C_before[P, P]) and np.allclose(core.covariance[V, V], C_before[V, V])
    assert np.linalg.eigvalsh(core.covariance).min() > 0
    # the offset is as uncertain as the pose it was put on, and as the jump itself
    assert core.covariance[PO, PO].trace() > C_before[P, P].trace() + 3 * 0.05**2 - 1e-9
    assert core.covariance[PHI.start + 2, PHI.start + 2] > np.radians(1.0) ** 2
