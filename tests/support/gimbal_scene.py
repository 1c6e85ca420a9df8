# SPDX-License-Identifier: Apache-2.0
"""A gimbal, a body with tags on its sides, and corners as an ideal detector would report them, with
noise."""

import numpy as np

from fcsv_geometry import transforms as tf
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.gimbal.geometry import GimbalGeometry
from fcsv_tracking.tags import corner_points, observation

CAMERA = PinholeCamera.from_fov(1920, 1080, np.radians(21.5))
GIMBAL = GimbalGeometry(
    Mount((0.1, 0.2, 0.4), (1.0, -2.0, 5.0)), (0.0, 0.0, 0.05), Mount((0.03, 0.01, 0.0))
)


def sides(lean_deg=10.0, size_m=0.08, first=20):
    """Four tags about a body, leaning inwards."""
    return [
        BodyTag(first + k, size_m, Mount((0.065 * c, 0.065 * s, 0.06), (0.0, -lean_deg, 90.0 * k)))
        for k, (c, s) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1)))
    ]


def seen(tags, T_cam_body, random=None, noise_px=0.0, only=None):
    """Observations of the tags that face the camera and lie in the picture; ``noise_px`` of corners
    seen face on."""
    found = []
    for tag in tags:
        T_cam_tag = T_cam_body @ tag.T_body_tag
        facing = T_cam_tag[:3, 2] @ T_cam_tag[:3, 3] / np.linalg.norm(T_cam_tag[:3, 3])
        uv = CAMERA.project(tf.apply(T_cam_tag, corner_points(tag.size_m)))
        if facing < np.cos(np.radians(68.0)) or not ((uv > 0).all() and (uv < [1919, 1079]).all()):
            continue
        if only is not None and tag.id not in only:
            continue
        if random is not None:
            uv = uv + random.normal(0.0, noise_px / facing, uv.shape)
        found.append(observation(tag.id, tag.size_m, uv, CAMERA))
    return found


def body(distance_m=3.0, yaw_deg=45.0, height_m=0.6, tilt_deg=(0.0, 0.0)):
    """T_G_D of a body ahead of the ground robot."""
    return tf.from_xyz_rpy([distance_m, 0.3, height_m], np.radians([*tilt_deg, yaw_deg]))
