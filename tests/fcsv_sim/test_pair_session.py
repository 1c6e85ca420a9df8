# SPDX-License-Identifier: Apache-2.0
"""The session that a pair before a tracker leaves: read by `map` with the poses that went in, in its own frame."""

import time

import numpy as np
import pytest

from fcsv_control.mission.standing import CaptureWindow
from fcsv_geometry import transforms as tf
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicle import load_vehicles

pytestmark = pytest.mark.ros

NAMES = ["tello1", "tello2"]
CAMERA = PinholeCamera.from_fov(64, 48, np.radians(70.0))
MISSION = Mission("m", [StereoConfiguration("horizontal", 1.0), StereoConfiguration("vertical", 1.5)], "tello1", 0.7,
                  home_height_m=1.7)  # fmt: skip
COVARIANCE = np.diag([1e-4, 2e-4, 3e-4, 1e-5, 2e-5, 3e-5])
T_GROUND_HOME = tf.from_xyz_yaw([2.6, 1.4, 1.7], 0.1)


def camera_pose(k):
    """T_home_cam of picture k: level cameras that shake a little."""
    shake = np.random.default_rng(k).normal(0.0, 0.02, 3)
    return tf.from_xyz_rpy([0.0, -0.1 * k, 0.05 * k], shake) @ tf.transform(tf.R_FLU_OPTICAL, np.zeros(3))


@pytest.fixture
def session(ros_master, tmp_path, root):
    """(folder, T_home_cam by vehicle and stamp) of two configurations with three pictures of either vehicle, a second
    apart, as where a machine is slow."""
    from geometry_msgs.msg import PoseWithCovarianceStamped

    from fcsv_geometry import frames
    from fcsv_geometry.ros import conversions
    from fcsv_sim.demo.ros.pair_session import PairSession

    session = PairSession(tmp_path, MISSION, load_vehicles(root / "config" / "vehicles", NAMES), 1)
    start_s, poses, k = float(int(time.time())), {}, 0
    session.begin(start_s, T_GROUND_HOME)
    for index in range(2):
        stamps = [start_s + 10.0 * index + n for n in range(3)]
        for name in NAMES:
            for stamp_s in stamps:
                image = np.full((48, 64, 3), k, np.uint8)
                poses[name, stamp_s] = camera_pose(k)
                picture = conversions.array_to_image(image, "rgb8", stamp_s, "optical")
                info = conversions.info_from_camera(CAMERA, stamp_s, "optical")
                session.picture(name, picture, info, poses[name, stamp_s])
                told = PoseWithCovarianceStamped(header=conversions.header(stamp_s, frames.HOME))
                told.pose.pose = conversions.transform_to_pose(poses[name, stamp_s])
                told.pose.covariance = COVARIANCE.ravel().tolist()
                session.camera_pose(name, told)
                k += 1
        session.capture(CaptureWindow(index, "tello2", stamps[0] - 1e-3, stamps[-1] + 1e-3, 0.05), time.time())
    assert not list(tmp_path.glob("*.bag")) and len(list(tmp_path.glob("*.active"))) == 3
    session.close()
    session.close()
    return tmp_path, poses


def test_map_reads_every_picture_with_the_pose_that_went_in(session):
    from fcsv_stereo import pipeline

    folder, poses = session
    given = pipeline.load(folder)
    assert not given.warnings and [c.configuration.axis for c in given.configurations] == ["horizontal", "vertical"]
    pictures = [p for c in given.configurations for p in (*c.references, *c.others)]
    assert len(pictures) == len(poses) == 12
    for p in pictures:
        assert np.allclose(p.T_home_cam, T_GROUND_HOME @ poses[p.vehicle, p.stamp_s], atol=1e-9)
        R = np.kron(np.eye(2), T_GROUND_HOME[:3, :3])  # it was told about the axes of the mission's home
        assert np.allclose(p.covariance, R @ COVARIANCE @ R.T)


def test_it_is_a_session_as_any_other(session):
    from fcsv_control.session import load_session

    folder, _ = session
    description = load_session(folder)
    assert description.vehicles == NAMES and description.reference == "tello1" and description.simulation.seed == 1
    assert not list(folder.glob("*.active"))
