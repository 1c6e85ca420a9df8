# SPDX-License-Identifier: Apache-2.0
"""Synthetic scene for pose refinement: textured boards from 10 to 250 m before an even sky, drawn
by homographies."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Picture

CAMERA = PinholeCamera.from_fov(640, 480, np.radians(56.0))


@dataclass(frozen=True)
class Board:
    """Upright, facing home's x: centre (m), half width and half height (m), and the seed of its
    texture."""

    xyz: tuple
    half_m: tuple
    seed: int


def town(seed: int = 0) -> list:
    """Far to near: a background to the horizon and forty boards before it."""
    random = np.random.default_rng(seed)
    boards = [Board((250.0, 0.0, -40.0), (190.0, 60.0), 100)]
    for i, x in enumerate(np.geomspace(160.0, 10.0, 40)):
        y, z = random.uniform(-0.5, 0.5) * x, random.uniform(-0.35, 0.12) * x
        boards.append(Board((float(x), float(y), float(z)), (0.09 * x, 0.07 * x), i))
    return boards


def draw(
    T_home_cam: np.ndarray, boards: Sequence[Board], camera: PinholeCamera = CAMERA
) -> np.ndarray:
    """The scene as a camera sees it, twice oversampled, with one grey level of noise."""
    size = (2 * camera.width, 2 * camera.height)
    shift = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
    T_cam_home = transforms.invert(T_home_cam)
    image = np.full((size[1], size[0]), 215, np.uint8)
    for b in boards:
        texture = _texture(b)
        h, w = texture.shape
        (x, y, z), (half_w, half_h) = b.xyz, b.half_m
        su, sv = 2 * half_w / w, 2 * half_h / h
        H_home = np.array([[0, 0, x], [-su, 0, y + half_w], [0, -sv, z + half_h]], float)
        H = (
            shift
            @ camera.K
            @ (T_cam_home[:3, :3] @ H_home + np.outer(T_cam_home[:3, 3], [0, 0, 1]))
        )
        rows, columns = _about(
            H @ np.array([[-1, -1, 1], [w, -1, 1], [-1, h, 1], [w, h, 1]], float).T, size
        )
        window = columns.stop - columns.start, rows.stop - rows.start
        if min(window) <= 0:
            continue
        H = np.array([[1, 0, -columns.start], [0, 1, -rows.start], [0, 0, 1]], float) @ H
        drawn = cv2.warpPerspective(texture, H, window, flags=cv2.INTER_LINEAR)
        mask = (
            cv2.warpPerspective(np.full((h, w), 255, np.uint8), H, window, flags=cv2.INTER_NEAREST)
            > 0
        )
        image[rows, columns][mask] = drawn[mask]
    image = cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(image[::7, ::7].astype(int).sum()).normal(0.0, 1.0, image.shape)
    return cv2.cvtColor(np.clip(image + noise, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2RGB)


def pose(xyz, rpy_deg=(0.0, 0.0, 0.0)) -> np.ndarray:
    """T_home_cam of a camera looking along home's x."""
    T = transforms.from_xyz_rpy(xyz, np.radians(rpy_deg))
    return T @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def shot(
    name: str,
    T_home_cam: np.ndarray,
    boards: Sequence[Board],
    vehicle: str = "uav2",
    stamp_s: float = 0.0,
):
    """A picture whose prior is the truth."""
    return Picture(name, vehicle, stamp_s, draw(T_home_cam, boards), CAMERA, T_home_cam)


def with_prior(picture: Picture, xyz_m=(0.0, 0.0, 0.0), rpy_deg=(0.0, 0.0, 0.0)) -> Picture:
    """The same picture, with a prior off by so much (home's and the camera's axes)."""
    off = transforms.from_xyz_rpy([0.0] * 3, np.radians(rpy_deg))
    T = picture.T_home_cam @ off
    T[:3, 3] += xyz_m
    return replace(picture, T_home_cam=T)


def noisy(
    picture: Picture, reference: Picture, random, rotation_deg: float = 0.15, share: float = 0.01
) -> Picture:
    """A prior as a flight gives it: per axis so many degrees, and a share of the baseline in
    all."""
    baseline_m = float(np.linalg.norm(picture.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]))
    xyz_m = random.normal(0.0, share * baseline_m / np.sqrt(3.0), 3)
    return with_prior(picture, xyz_m, random.normal(0.0, rotation_deg, 3))


@lru_cache(maxsize=512)  # three quarters of the time of a drawing; a texture is some 25 kB
def _texture(board: Board) -> np.ndarray:
    """The board's texture (uint8), read only: every picture of it has the same."""
    w, h = (int(np.clip(2 * m / board.xyz[0] * 1000, 64, 2000)) for m in board.half_m)
    random = np.random.default_rng(board.seed)
    layers = []
    for sigma in (2.0, 6.0, 20.0):
        layer = cv2.GaussianBlur(random.random((h, w)).astype(np.float32), (0, 0), sigma)
        layers.append((layer - layer.mean()) / max(float(layer.std()), 1e-6))
    base = random.uniform(70, 170)
    texture = np.clip(base + 22 * sum(layers), 0, 255).astype(np.uint8)
    texture.flags.writeable = False
    return texture


def depth(
    T_home_cam: np.ndarray, boards: Sequence[Board], camera: PinholeCamera = CAMERA
) -> np.ndarray:
    """True depth (HxW, m along the optical axis) of what draw() shows; NaN in the sky."""
    rays_home = camera.rays() @ T_home_cam[:3, :3].T
    p, T_cam_home = T_home_cam[:3, 3], transforms.invert(T_home_cam)
    out = np.full(rays_home.shape[:2], np.nan)
    for b in boards:
        corners = (
            np.array([(0.0, y * b.half_m[0], z * b.half_m[1]) for y in (-1, 1) for z in (-1, 1)])
            + b.xyz
        )
        window = _about(
            camera.K @ transforms.apply(T_cam_home, corners).T, (camera.width, camera.height)
        )
        rays = rays_home[window]
        # rays have z = 1 in the camera: their length is the depth
        z = (b.xyz[0] - p[0]) / rays[..., 0]
        y, up = p[1] + z * rays[..., 1] - b.xyz[1], p[2] + z * rays[..., 2] - b.xyz[2]
        on = (np.abs(y) < b.half_m[0]) & (np.abs(up) < b.half_m[1]) & (z > 0)
        out[window][on] = z[on]
    return out


def _about(corners: np.ndarray, size: Tuple[int, int]) -> Tuple[slice, slice]:
    """Rows and columns of a picture of ``size`` (width, height) that hold all between ``corners``
    (3xN homogeneous px): the whole of it where some are behind the camera."""
    width, height = size
    if corners[2].min() <= 1e-6:
        return slice(0, height), slice(0, width)
    u, v = corners[:2] / corners[2]
    low = [int(np.clip(np.floor(x.min()) - 2, 0, n)) for x, n in ((v, height), (u, width))]
    high = [int(np.clip(np.ceil(x.max()) + 3, 0, n)) for x, n in ((v, height), (u, width))]
    return slice(low[0], high[0]), slice(low[1], high[1])
