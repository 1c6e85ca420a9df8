# SPDX-License-Identifier: Apache-2.0
"""Equations 5.1 to 5.4 on truth: ours hold, the printed ones do so only in the cases that
equations.py names."""

import numpy as np
import pytest

from fcsv_geometry import transforms as tf
from fcsv_geometry.errors import GeometryError
from fcsv_tracking.mocap import equations

R_M_W = tf.from_xyz_rpy([0, 0, 0], [0.02, 0.78, 0.0])[:3, :3]  # a lens that looks up by 45 degrees


class Scene:
    """Two vehicles whose odometries began at different places with different headings, both
    level."""

    def __init__(self, seed, same_heading=False):
        random = np.random.default_rng(seed)
        T_M_W = tf.transform(R_M_W, np.zeros(3))
        headings = [0.0, 0.0] if same_heading else random.uniform(-np.pi, np.pi, 2)
        self.T_M_O = [T_M_W @ tf.from_xyz_yaw(random.normal(0.0, 2.0, 3), h) for h in headings]
        self.T_O_D = [
            tf.from_xyz_rpy(random.normal(0.0, 3.0, 3), random.normal(0.0, 0.2, 3))
            for _ in range(2)
        ]
        self.T_M_D = [a @ b for a, b in zip(self.T_M_O, self.T_O_D)]
        self.T_Da_Db = tf.invert(self.T_M_D[0]) @ self.T_M_D[1]


def rotation(T):
    return T[:3, :3]


@pytest.mark.parametrize("seed", range(5))
def test_5_1_level_from_both_whatever_their_headings(seed):
    scene = Scene(seed)
    axes = [
        equations.odometry_axes(rotation(M), rotation(O)) for M, O in zip(scene.T_M_D, scene.T_O_D)
    ]
    found = equations.level_horizon(axes, [0.001, 0.002])
    assert np.allclose(found[:, 2], R_M_W[:, 2])
    assert found[0, 0] > 0 and abs(found[0, 1]) < 1e-12  # x of W has the lens's heading
    # average of whole rotations
    printed = tf.Rotation.from_matrix(np.stack(axes)).mean().as_matrix()
    # level is right as printed: both err about the vertical alone
    assert np.allclose(printed[:, 2], R_M_W[:, 2])


def test_5_1_weighs_the_better_vehicle_more():
    tilted = [tf.from_xyz_rpy([0, 0, 0], [a, 0, 0])[:3, :3] for a in (0.0, 0.01)]
    found = equations.level_horizon(tilted, [0.001, 0.003])
    assert np.arccos(found[2, 2]) == pytest.approx(0.01 * 1 / 10, rel=1e-3)


def test_5_1_refuses_what_says_nothing():
    with pytest.raises(GeometryError, match="no vehicle"):
        equations.level_horizon([], [])
    straight_up = tf.from_xyz_rpy([0, 0, 0], [0, np.pi / 2, 0])[:3, :3]
    with pytest.raises(GeometryError, match="straight up"):
        equations.level_horizon([straight_up], [0.001])


@pytest.mark.parametrize("seed", range(5))
def test_5_2_offset(seed):
    scene = Scene(seed)
    for k in range(2):
        assert np.allclose(equations.offset(scene.T_M_D[k], scene.T_O_D[k]), scene.T_M_O[k])

    def printed(scene, k):  # T_O = T_M->D - R_W->M T_D
        return scene.T_M_D[k][:3, 3] - R_M_W @ scene.T_O_D[k][:3, 3]

    alike = Scene(seed, same_heading=True)
    assert np.allclose(printed(alike, 0), alike.T_M_O[0][:3, 3])
    assert np.linalg.norm(printed(scene, 0) - scene.T_M_O[0][:3, 3]) > 0.1


@pytest.mark.parametrize("seed", range(5))
def test_5_3_in_view(seed):
    scene = Scene(seed)
    assert np.allclose(equations.relative_in_view(*scene.T_M_D), scene.T_Da_Db)

    def printed(a, b):
        R = rotation(b) @ rotation(a).T
        return tf.transform(R, b[:3, 3] - R @ a[:3, 3])

    assert not np.allclose(printed(*scene.T_M_D), scene.T_Da_Db, atol=0.05)
    # read with M -> D as the tracker's pose in the body it is right, and gives the pose of a in b
    assert np.allclose(printed(*(tf.invert(T) for T in scene.T_M_D)), tf.invert(scene.T_Da_Db))


@pytest.mark.parametrize("seed", range(5))
def test_5_4_out_of_view(seed):
    scene = Scene(seed)
    found = equations.relative_out_of_view(
        scene.T_M_O[0], scene.T_O_D[0], scene.T_M_O[1], scene.T_O_D[1]
    )
    assert np.allclose(found, scene.T_Da_Db)
    for same_heading in (True, False):
        s = Scene(seed, same_heading)
        R = rotation(s.T_O_D[1]) @ rotation(s.T_O_D[0]).T
        p = (
            s.T_O_D[1][:3, 3]
            - s.T_M_O[1][:3, 3]
            - R_M_W @ R @ (s.T_O_D[0][:3, 3] - s.T_M_O[0][:3, 3])
        )
        assert not np.allclose(tf.transform(R, p), s.T_Da_Db, atol=0.05)


def test_relative_covariance_is_that_of_drawn_poses():
    random = np.random.default_rng(3)
    scene = Scene(3)
    draws = [np.linalg.cholesky(np.diag(random.uniform(0.2, 1.0, 6)) * 1e-4) for _ in range(2)]
    C = equations.relative_covariance(
        scene.T_M_D[0], draws[0] @ draws[0].T, scene.T_M_D[1], draws[1] @ draws[1].T
    )
    errors = []
    for _ in range(4000):
        moved = []
        for T, L in zip(scene.T_M_D, draws):
            e = L @ random.standard_normal(6)
            turn = tf.Rotation.from_rotvec(e[3:]).as_matrix()
            moved.append(tf.transform(turn @ T[:3, :3], T[:3, 3] + e[:3]))
        T = equations.relative_in_view(*moved)
        turn = tf.Rotation.from_matrix(T[:3, :3] @ scene.T_Da_Db[:3, :3].T).as_rotvec()
        errors.append(np.concatenate([T[:3, 3] - scene.T_Da_Db[:3, 3], turn]))
    found = np.cov(np.array(errors).T)
    # 4000 draws know a variance to 2.2 %; entries scale with the largest
    assert np.abs(found - C).max() < 0.1 * np.abs(C).max()
