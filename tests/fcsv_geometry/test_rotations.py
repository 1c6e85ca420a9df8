# SPDX-License-Identifier: Apache-2.0
"""Rotations that are written out agree with scipy's."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcsv_geometry import rotations

COUNT = 50


@pytest.fixture
def random():
    return np.random.default_rng(2)


@pytest.fixture
def turns(random):
    """Of all sizes, with those for which a formula has a case of its own."""
    axes = random.normal(0.0, 1.0, (COUNT, 3))
    angles = np.concatenate(
        [random.uniform(0.0, np.pi, COUNT - 7), [0.0, 1e-9, 9e-7, 2e-6, 1e-4, np.pi - 1e-4, np.pi]]
    )
    return Rotation.from_rotvec(
        axes / np.linalg.norm(axes, axis=1, keepdims=True) * angles[:, None]
    )


def test_quaternions(turns, random):
    for A, B in zip(turns, turns[::-1]):
        v = random.normal(size=3)
        q_a, q_b = tuple(A.as_quat().tolist()), tuple(B.as_quat().tolist())
        assert np.allclose(rotations.rotate(q_a, tuple(v)), A.apply(v))
        assert np.isclose(abs(np.array(rotations.multiply(q_a, q_b)) @ (A * B).as_quat()), 1.0)
        assert np.allclose(
            rotations.rotate(rotations.conjugate(q_a), rotations.rotate(q_a, tuple(v))), v
        )
        assert np.allclose(rotations.matrix_of_quaternion(q_a), A.as_matrix(), atol=1e-12)
        again = rotations.quaternion_of_matrix(A.as_matrix())
        assert again[3] >= 0.0 and np.isclose(abs(np.array(again) @ q_a), 1.0)
        x_b = A.as_matrix()[:, 0]
        assert np.isclose(rotations.yaw(q_a), math.atan2(x_b[1], x_b[0]))
        cosine = A.as_matrix()[2] @ B.as_matrix()[2]  # a's vertical in both
        assert np.isclose(
            rotations.tilt_between(q_a, q_b), math.acos(min(1.0, max(-1.0, cosine))), atol=1e-7
        )


def test_angles(random):
    for roll, pitch, yaw in random.uniform(-1.5, 1.5, (COUNT, 3)):
        R = Rotation.from_euler("xyz", [roll, pitch, yaw])
        assert np.allclose(rotations.rpy(tuple(R.as_quat())), [roll, pitch, yaw])
        about_z = Rotation.from_euler("z", yaw)
        assert np.allclose(rotations.turn_about_z(yaw), about_z.as_matrix())
        assert np.isclose(abs(np.array(rotations.quaternion_of_yaw(yaw)) @ about_z.as_quat()), 1.0)


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
@pytest.mark.parametrize("angle", [-3.1, -0.4, 0.0, 2.9])
def test_whole_turns_do_not_count(angle, turns):
    assert rotations.wrap(angle + 2.0 * math.pi * turns) == pytest.approx(angle, abs=1e-12)


def test_rotation_vectors(turns):
    for A in turns:
        v = A.as_rotvec()
        # below 1e-6 rad the square of the angle is left out
        assert np.allclose(rotations.exp(v), A.as_matrix(), atol=1e-12)
        assert np.allclose(rotations.exp(rotations.log(A.as_matrix())), A.as_matrix(), atol=1e-7)
        if A.magnitude() < np.pi - 1e-3:
            assert np.allclose(rotations.log(A.as_matrix()), v, atol=1e-9)


def test_the_jacobian_of_the_logarithm(turns):
    step = 1e-6
    for A in turns[:-2]:  # near a half turn there is none
        columns = []
        for axis in np.eye(3):
            sides = [(A * Rotation.from_rotvec(s * step * axis)).as_rotvec() for s in (1.0, -1.0)]
            columns.append((sides[0] - sides[1]) / (2 * step))
        if A.magnitude() < np.pi - 0.1:
            expected = np.stack(columns, axis=1)
            assert np.allclose(rotations.inverse_right_jacobian(A.as_rotvec()), expected, atol=1e-5)


def test_between_two_directions(random):
    for _ in range(COUNT):
        a, b = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
        R = rotations.between(a, b)
        assert np.allclose(R @ a, b) and np.isclose(
            Rotation.from_matrix(R).magnitude(), math.acos(a @ b)
        )


def test_cross_products(random):
    v, w = random.normal(size=(2, COUNT, 3))
    assert np.allclose(np.einsum("nij,nj->ni", rotations.skews(v), w), np.cross(v, w))
    assert np.array_equal(rotations.skews(v), [rotations.skew(x) for x in v])


def test_roll_pitch_and_yaw_of_matrices(random):
    for rpy in random.uniform(-1.0, 1.0, (COUNT, 3)) * [np.pi, 0.5 * np.pi - 1e-4, np.pi]:
        R = Rotation.from_euler("xyz", rpy).as_matrix()
        assert np.allclose(rotations.matrix_of_rpy(*rpy), R, atol=1e-14)
        assert np.allclose(rotations.rpy_of_matrix(R), rpy, atol=1e-9)
