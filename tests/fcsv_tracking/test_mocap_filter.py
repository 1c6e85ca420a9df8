# SPDX-License-Identifier: Apache-2.0
"""The filter's own Jacobians against numeric ones, and what move_odometry() promises."""

import numpy as np
import pytest

from fcsv_geometry import rotations
from fcsv_geometry import transforms as tf
from fcsv_sim.sensors.v120_duo import V120Duo, V120DuoErrors
from fcsv_tracking.mocap import measurements
from fcsv_tracking.mocap.filter import FilterNoise, MocapFilter
from fcsv_tracking.mocap.markers import MarkerNoise, MarkerRules
from fcsv_tracking.mocap.state import PHI, PO, SIZE, MocapState, P, V, advance, advance_jacobian

EPSILON = 1e-6


def random_state(random):
    turn = rotations.exp(random.normal(0.0, 1.0, 3))
    return MocapState(
        random.normal(0.0, 2.0, 3),
        random.normal(0.0, 1.0, 3),
        turn,
        random.normal(0.0, 2.0, 3),
        rotations.exp(random.normal(0.0, 1.0, 3)),
        random.normal(0.0, 0.02, 3),
        random.normal(0.0, 0.1, 3),
        0.07,
    )


def numeric(f, size):
    """Central differences of a vector function of the error state."""
    columns = []
    for i in range(SIZE):
        e = np.zeros(SIZE)
        e[i] = EPSILON
        columns.append((f(e) - f(-e)) / (2.0 * EPSILON))
    return np.stack(columns, axis=1).reshape(size, SIZE)


# central differences err by EPSILON^2 times a third derivative (of order 10) and 1e-16 / EPSILON by
# rounding: 1e-9
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
    p_O, v_O, rate = (
        random.normal(0.0, 3.0, 3),
        random.normal(0.0, 1.0, 3),
        random.normal(0.0, 1.0, 3),
    )
    late_s = 0.013
    # what is expected
    T_M_D, R_O_D = state.T_M_D, state.R_M_O.T @ state.R_M_D @ rotations.exp(-rate * late_s)
    models = {
        "mocap": (6, lambda s: measurements.mocap_pose(s, T_M_D)),
        "odometry": (
            6,
            lambda s: measurements.odometry(s, p_O, v_O, late_s + s.delay_s - state.delay_s),
        ),
        "attitude": (
            3,
            lambda s: measurements.attitude(s, R_O_D, rate, late_s + s.delay_s - state.delay_s),
        ),
    }
    for name, (size, model) in models.items():
        H = -numeric(lambda e, model=model: model(state.boxplus(e))[0], size)
        assert np.abs(H - model(state)[1]).max() < TOLERANCE, name


def test_covariance_of_a_rigid_fit_is_that_of_many():
    """Simulated frames of one pose: their scatter in the axes of what was foretold is one in all
    six."""
    T = tf.from_xyz_rpy([2.5, 0.3, -0.4], [0.1, -0.7, 0.3])
    duo = V120Duo(V120DuoErrors(body_m=0.0, body_deg=0.0), np.eye(4), 1)
    errors = []
    for k in range(3000):
        seen = duo.frame(k / 120.0, {"a": T})["a"].T_M_D
        errors.append(
            np.concatenate([seen[:3, 3] - T[:3, 3], rotations.log(T[:3, :3].T @ seen[:3, :3])])
        )
    foretold = MarkerNoise(MarkerRules()).pose_covariance(T[:3, :3], T[:3, 3])
    shares = np.linalg.eigvals(np.linalg.solve(foretold, np.cov(np.array(errors).T))).real
    # the variance of 3000 draws is known to 2.6 %, the extremes of six to twice that and again
    assert shares.min() > 0.88 and shares.max() < 1.12


def test_markers_on_a_line_are_no_rigid_body():
    with pytest.raises(ValueError, match="layout_m: a rigid body needs three markers"):
        MarkerRules(layout_m=((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.2, 0.001, 0.0)))


def test_noise_much_larger_about_one_axis_leaves_level_alone():
    """Frames of a body at rest, with noise about other axes than the filter holds to be the noisy
    ones."""
    noise = FilterNoise()
    T_M_D = tf.from_xyz_rpy([2.0, 0.6, -0.3], [0.0, -0.8, 0.4])
    T_M_O = tf.from_xyz_rpy([2.0, 0.6, -1.0], [0.0, -0.8, 0.9])
    T_O_D = tf.invert(T_M_O) @ T_M_D
    force = T_O_D[:3, :3].T @ [0.0, 0.0, 9.81]
    _, axes = np.linalg.eigh(
        MarkerNoise(noise.markers).pose_covariance(T_M_D[:3, :3], T_M_D[:3, 3])[3:, 3:]
    )
    spread = axes @ rotations.exp(np.array([0.4, 0.4, 0.0])) @ np.diag(np.radians([0.05, 1.0, 1.5]))
    off = []
    for seed in range(4):
        random, core = (
            np.random.default_rng(seed),
            MocapFilter(noise, T_M_D, T_O_D, np.zeros(3), 0.07),
        )
        for k in range(960):
            core.predict(np.zeros(3), force, 1.0 / 120.0)
            turn = rotations.exp(spread @ random.standard_normal(3))
            core.mocap(tf.transform(T_M_D[:3, :3] @ turn, T_M_D[:3, 3])).apply()
            if k % 6 == 0:
                core.attitude(T_O_D[:3, :3], np.zeros(3), 0.07).apply()
        off.append((T_M_O[:3, :3].T @ core.state.R_M_O)[:2, 2])
    # 1.5 degrees a frame, 960 frames, four flights: 0.024 degrees; four of them
    assert np.degrees(np.abs(np.mean(off, axis=0)).max()) < 0.1


def test_residuals_vanish_on_the_truth():
    random = np.random.default_rng(5)
    state = random_state(random)
    speed, R_O_M = np.linalg.norm(state.v_M), state.R_M_O.T
    p_O = R_O_M @ (state.p_M_D - state.p_M_O)
    assert np.allclose(measurements.mocap_pose(state, state.T_M_D)[0], 0.0)
    assert np.allclose(
        measurements.odometry(state, p_O, R_O_M @ state.v_M + speed * state.drift_O, 0.0)[0], 0.0
    )
    assert np.allclose(measurements.attitude(state, R_O_M @ state.R_M_D, np.ones(3), 0.0)[0], 0.0)


def test_boxminus_undoes_boxplus():
    random = np.random.default_rng(6)
    state, error = random_state(random), random.normal(0.0, 0.3, SIZE)
    assert np.allclose(state.boxplus(error).boxminus(state), error, atol=1e-12)


def test_odometry_that_began_anew_leaves_the_pose_and_keeps_level():
    T_M_D = tf.from_xyz_rpy([2.0, 1.0, 0.5], [0.02, -0.75, 0.4])
    T_M_O = tf.from_xyz_rpy([0.4, 0.3, -1.0], [0.01, -0.8, 1.2])
    core = MocapFilter(FilterNoise(), T_M_D, tf.invert(T_M_O) @ T_M_D, np.zeros(3), 0.07)
    turned = tf.from_xyz_yaw([3.0, -2.0, 0.1], 2.0) @ tf.invert(T_M_O) @ T_M_D
    pose_before, up_before = core.state.T_M_D, core.state.R_M_O[:, 2].copy()
    C_before = core.covariance.copy()
    core.move_odometry(turned, 0.05, np.radians(1.0))
    assert np.allclose(core.state.T_M_D, pose_before) and np.allclose(
        core.state.R_M_O[:, 2], up_before
    )
    assert np.allclose(core.state.T_M_O @ turned, pose_before, atol=1e-9)
    assert np.allclose(core.covariance[P, P], C_before[P, P]) and np.allclose(
        core.covariance[V, V], C_before[V, V]
    )
    assert np.linalg.eigvalsh(core.covariance).min() > 0
    # the offset is as uncertain as the pose it was put on, and as the jump itself
    assert core.covariance[PO, PO].trace() > C_before[P, P].trace() + 3 * 0.05**2 - 1e-9
    assert core.covariance[PHI.start + 2, PHI.start + 2] > np.radians(1.0) ** 2
