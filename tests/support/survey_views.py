# SPDX-License-Identifier: Apache-2.0
"""Views for surveys, cast from planes and boxes with known truth; matches and edges between
them."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.edges.edge import Edge
from fcsv_stereo.survey.edges.features import located
from fcsv_stereo.survey.views.station import Prior
from fcsv_stereo.survey.views.view import View

CAMERA = PinholeCamera.from_fov(96, 72, np.radians(56.0))
SHARP = PinholeCamera.from_fov(640, 480, np.radians(56.0))
UNKNOWN = float("inf")
_BODY_CAM = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def camera_at(x, y, z=0.0, heading_deg=0.0):
    """T_site_cam of a level camera."""
    return transforms.from_xyz_yaw([x, y, z], np.radians(heading_deg)) @ _BODY_CAM


def prior(T, place_m=0.5, yaw_deg=0.1, scale=0.01, tilt_rad=0.01):
    return Prior(T, tilt_rad, np.radians(yaw_deg), place_m, scale)


def unplaced(T, scale=0.02):
    return Prior(transforms.transform(T[:3, :3], np.zeros(3)), 0.01, UNKNOWN, UNKNOWN, scale)


def cast(T_site_cam, wall_x=40.0, boxes=()):
    """(H,W) depth of a wall across x, and of boxes (x, y0, y1, z0, z1): plates before it, across
    x."""
    rays = CAMERA.rays() @ T_site_cam[:3, :3].T
    p = T_site_cam[:3, 3]
    depth = np.where(
        rays[..., 0] > 0.1,
        (wall_x - p[0]) / np.where(rays[..., 0] > 0.1, rays[..., 0], 1.0),
        np.nan,
    )
    for x, y0, y1, z0, z1 in boxes:
        near = (x - p[0]) / np.where(rays[..., 0] > 0.1, rays[..., 0], np.nan)
        hit = p + near[..., None] * rays
        inside = (hit[..., 1] > y0) & (hit[..., 1] < y1) & (hit[..., 2] > z0) & (hit[..., 2] < z1)
        depth = np.where(inside & (near > 0) & (near < depth), near, depth)
    return depth


def view(name, T, depth=None, sigma_share=0.01, scale=1.0, known_as=None, noise=0.0, seed=0):
    """A view whose map is 1 / ``scale`` times too small; its prior is its true pose unless
    ``known_as``."""
    depth = cast(T) if depth is None else depth
    sigma = np.nan_to_num(sigma_share * depth, nan=1.0)
    told = (depth + noise * sigma * np.random.default_rng(seed).normal(size=depth.shape)) / scale
    kind = np.where(np.isfinite(depth), 2, 0).astype(np.uint8)
    image = np.full((*depth.shape, 3), 90, np.uint8)
    known_as = prior(T) if known_as is None else known_as
    T_home_cam = transforms.transform(T[:3, :3], np.zeros(3))
    return View(
        name,
        f"in/{name}",
        image,
        told.astype(np.float32),
        sigma.astype(np.float32),
        kind,
        CAMERA,
        T_home_cam,
        known_as,
    )


def places(count=200, seed=0):
    """(N,3) points of a site between 30 and 120 m ahead."""
    random = np.random.default_rng(seed)
    low, high = [30.0, -40.0, -5.0], [120.0, 40.0, 15.0]
    return random.uniform(low, high, (count, 3))


def seen(points, T_site_cam, scale=1.0, seed=0, noise_px=0.7):
    """Features of site points as a view measures them: sigma 0.25 % of the depth per 10 m, and
    pixels."""
    random = np.random.default_rng(seed)
    in_cam = transforms.apply(transforms.invert(T_site_cam), points)
    z = in_cam[:, 2]
    uv = (
        in_cam[:, :2] / z[:, None] * SHARP.fx
        + [SHARP.cx, SHARP.cy]
        + random.normal(0.0, noise_px, (len(z), 2))
    )
    sigma = 2.5e-4 * z**2
    depth = (z + sigma * random.normal(size=len(z))) / scale
    return located(SHARP, uv, depth, sigma, np.zeros((len(z), 128), np.float32))


def true_edge(
    a, b, poses, scales, sigma_m=0.05, sigma_rad=5e-4, sigma_scale=1e-3, seed=0, matches=100
):
    """An edge between poses by name with the noise that its covariance states."""
    sigmas = np.array([sigma_rad] * 3 + [sigma_m] * 3 + [sigma_scale])
    S = similarity.between(*(similarity.of_pose(poses[n], scales[n]) for n in (a, b)))
    S = S.retract(sigmas * np.random.default_rng(seed).normal(size=7))
    return Edge(a, b, S, np.diag(sigmas**2), 0.1, matches)
