# SPDX-License-Identifier: Apache-2.0
"""Synthetic pairs with known depth: textured planes seen by two cameras."""

import functools

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture

CAMERA = PinholeCamera.from_fov(320, 240, np.radians(56.0))
DEPTH_M = 20.0
NEAR_M = 12.0


@functools.lru_cache(maxsize=None)
def texture(seed, size=1024):
    random = np.random.default_rng(seed)
    fine = cv2.GaussianBlur(random.random((size, size)).astype(np.float32), (0, 0), 2.0)
    coarse = cv2.GaussianBlur(random.random((size, size)).astype(np.float32), (0, 0), 12.0)
    both = cv2.normalize(fine, None, 0, 1, cv2.NORM_MINMAX) + cv2.normalize(
        coarse, None, 0, 1, cv2.NORM_MINMAX
    )
    made = cv2.cvtColor((both * 127).astype(np.uint8), cv2.COLOR_GRAY2RGB)
    made.setflags(write=False)  # it is made once
    return made


def _plane(camera, T_home_cam, distance_m, half_m, seed):
    """A plane x = distance in home, 2 half_m wide, as the camera sees it; and where it is."""
    picture = texture(seed)
    n = picture.shape[0]
    scale = 2 * half_m / n
    # texture pixel (u, v) lies at home (distance, half - u scale, half - v scale)
    H_home = np.array([[0, 0, distance_m], [-scale, 0, half_m], [0, -scale, half_m]], float)
    T = transforms.invert(T_home_cam)
    H = camera.K @ (T[:3, :3] @ H_home + np.outer(T[:3, 3], [0, 0, 1]))
    size = (camera.width, camera.height)
    image = cv2.warpPerspective(picture, H, size, flags=cv2.INTER_AREA)
    mask = cv2.warpPerspective(np.full((n, n), 255, np.uint8), H, size, flags=cv2.INTER_NEAREST) > 0
    return image, mask


def photograph(T_home_cam, camera=CAMERA):
    """A wall at 20 m with a smaller one at 12 m in front of it."""
    image, _ = _plane(camera, T_home_cam, DEPTH_M, 25.0, 1)
    near, mask = _plane(camera, T_home_cam, NEAR_M, 2.5, 2)
    image[mask] = near[mask]
    return image


def camera_pose(xyz, rpy_deg=(0.0, 0.0, 0.0)):
    return transforms.from_xyz_rpy(xyz, np.radians(rpy_deg)) @ transforms.transform(
        transforms.R_FLU_OPTICAL, np.zeros(3)
    )


def picture(name, vehicle, stamp_s, T_home_cam):
    return Picture(name, vehicle, stamp_s, photograph(T_home_cam), CAMERA, T_home_cam)


def true_depth(T_home_cam):
    """Of the synthetic scene, by intersecting rays with the two planes."""
    rays = CAMERA.rays() @ T_home_cam[:3, :3].T
    p = T_home_cam[:3, 3]
    far = (DEPTH_M - p[0]) / rays[..., 0]
    near = (NEAR_M - p[0]) / rays[..., 0]
    hit = p + near[..., None] * rays
    inside = (np.abs(hit[..., 1]) < 2.5) & (np.abs(hit[..., 2]) < 2.5)
    return np.where(inside, near, far)


def given(*offsets_and_axes, kind="session"):
    """A MapInput with the reference at home (slightly turned, as a vibrating camera is) and others
    at offsets."""
    T_reference = camera_pose([0, 0, 0], (0.3, -0.2, 0.4))
    reference = picture("uav1/0", "uav1", 10.0, T_reference)
    configurations = []
    for i, (xyz, axis) in enumerate(offsets_and_axes):
        T = camera_pose(xyz, (-0.4, 0.3, -0.3))
        other = picture(f"uav2/{i}", "uav2", 10.1, T)
        configuration = Configuration(axis, float(np.linalg.norm(xyz)), 0.0, f"{axis} {i}")
        configurations.append(ConfigurationInput(configuration, [reference], [other]))
    return MapInput(kind, configurations)
