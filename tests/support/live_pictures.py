# SPDX-License-Identifier: Apache-2.0
"""Pictures and recordings as they come in over the link while two vehicles fly."""

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.in_flight.live import RecordingWindow
from fcsv_stereo.model import Configuration, LivePicture

CAMERA = PinholeCamera.from_fov(64, 48, np.radians(56.0), (0.04, -0.08, 0.0, 0.0, 0.0))
R_OPTICAL = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def picture(vehicle, stamp_s, y_m=0.0, z_m=0.0, size=(48, 64)):
    """A plain one of a camera that looks forward, y_m to the left and z_m above its odometry's origin."""
    image = np.full((*size, 3), 90, np.uint8)
    _, jpeg = cv2.imencode(".jpg", image)
    T_odom_cam = transforms.from_xyz_yaw([0.0, y_m, z_m], 0.0) @ R_OPTICAL
    return LivePicture(vehicle, stamp_s, jpeg.tobytes(), CAMERA, T_odom_cam)


def window(index, start_s, stop_s, name="horizontal 2 m"):
    """A recording of uav2 beside uav1."""
    return RecordingWindow(
        index, Configuration("horizontal", 2.0, 0.0, name), "uav1", "uav2", start_s, stop_s
    )
