# SPDX-License-Identifier: Apache-2.0
"""Messages to arrays and back, without a master."""

import numpy as np
import pytest
from geometry_msgs.msg import Pose
from sensor_msgs.msg import CameraInfo

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.ros import conversions, fences

T_A_B = transforms.from_xyz_rpy([1.0, -2.0, 3.0], [0.1, -0.2, 2.5])


def test_pose_round_trip():
    assert np.allclose(conversions.pose_to_transform(conversions.transform_to_pose(T_A_B)), T_A_B)
    message = conversions.transform_stamped(T_A_B, 12.25, "a", "b")
    assert (message.header.frame_id, message.child_frame_id, message.header.stamp.to_sec()) == (
        "a",
        "b",
        12.25,
    )
    assert np.allclose(conversions.transform_from_msg(message.transform), T_A_B)


def test_an_unset_quaternion_is_not_identity():
    with pytest.raises(GeometryError):
        conversions.pose_to_transform(Pose())


def test_camera_info_round_trip():
    camera = PinholeCamera(640, 480, 601.0, 602.0, 320.5, 238.0, (-0.05, 0.02, 0.001, 0.0, 0.0))
    assert conversions.camera_from_info(conversions.info_from_camera(camera, 1.0, "c")) == camera


@pytest.mark.parametrize(
    "info, word",
    [
        (
            CameraInfo(width=640, height=480, distortion_model="plumb_bob", D=[0.0] * 5),
            "not calibrated",
        ),
        (
            CameraInfo(
                width=640, height=480, distortion_model="equidistant", D=[0.1] * 4, K=[1.0] * 9
            ),
            "equidistant",
        ),
    ],
)
def test_camera_info_that_cannot_be_used(info, word):
    with pytest.raises(GeometryError, match=word):
        conversions.camera_from_info(info)


@pytest.mark.parametrize(
    "encoding, dtype, channels",
    [
        ("rgb8", np.uint8, 3),
        ("bgr8", np.uint8, 3),
        ("mono8", np.uint8, 1),
        ("mono16", np.uint16, 1),
        ("32FC1", np.float32, 1),
    ],
)
def test_image_round_trip(encoding, dtype, channels):
    shape = (12, 16, channels) if channels > 1 else (12, 16)
    image = np.random.default_rng(0).integers(0, 255, shape).astype(dtype)
    message = conversions.array_to_image(image, encoding, 3.5, "cam")
    assert np.array_equal(conversions.image_to_array(message), image)


def test_image_errors():
    message = conversions.array_to_image(np.zeros((4, 4), np.uint8), "mono8", 0.0, "cam")
    message.data = message.data[:-1]
    with pytest.raises(GeometryError, match="15 bytes"):
        conversions.image_to_array(message)
    message = conversions.array_to_image(np.zeros((4, 4), np.uint8), "mono8", 0.0, "cam")
    message.encoding = "yuv999"
    with pytest.raises(GeometryError, match="yuv999"):
        conversions.image_to_array(message, "bgr8")


def test_a_fence_comes_through_its_message_and_nan_is_none():
    fence = Fence(1.0, 20.0, 50.0, [(0.0, -5.0), (40.0, 0.0), (0.0, 5.0)])
    message = fences.to_message(fence, 3.5)
    assert fences.from_message(message) == fence
    message.polygon.points[1].x = float("nan")
    with pytest.raises(GeometryError, match="polygon"):
        fences.from_message(message)
