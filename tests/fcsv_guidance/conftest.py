# SPDX-License-Identifier: Apache-2.0
"""Drawn scenes of boxes on level ground, cast with known truth: depth along the axis, sigma,
kind."""

import json

import numpy as np
import pytest

from fcsv_guidance.ground.views import DepthView

#: the camera 8 m above, tilted 25 degrees down
TILT_RAD = np.radians(25.0)


class Scene:
    """Level ground z = 0 with boxes (x0, x1, y0, y1, z0, z1); ``blank``: rectangles (x0, x1, y0,
    y1) without depth."""

    def __init__(self, boxes=(), blank=(), eye=(0.0, 0.0, 8.0), tilt_rad=TILT_RAD):
        self.boxes, self.blank, self.eye, self.tilt_rad = (
            boxes,
            blank,
            np.array(eye, float),
            tilt_rad,
        )

    def view(
        self,
        noise=0.0,
        seed=0,
        name="drawn",
        sigma_share=0.002,
        stamp_s=5.0,
        size=(640, 480),
        kind=2,
    ):
        """Noise is ``noise`` times the stated sigma, which is ``sigma_share`` of the depth per 10 m
        of depth."""
        width, height = size
        f = 0.94 * width
        K = np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1.0]])
        c, s = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        R = np.array([[0, -s, c], [-1, 0, 0], [0, -c, -s]])  # columns: right, down, forward
        v, u = np.indices((height, width))
        rays = np.stack([(u - K[0, 2]) / f, (v - K[1, 2]) / f, np.ones(u.shape)], -1) @ R.T
        depth = self._cast(rays)
        sigma = sigma_share * depth**2 / 10
        hit = self.eye + rays * np.nan_to_num(depth)[..., None]
        for x0, x1, y0, y1 in self.blank:
            inside = (
                (hit[..., 0] > x0) & (hit[..., 0] < x1) & (hit[..., 1] > y0) & (hit[..., 1] < y1)
            )
            depth = np.where(inside, np.nan, depth)
        depth = depth + noise * np.random.default_rng(seed).normal(
            size=depth.shape
        ) * np.nan_to_num(sigma)
        kinds = np.where(np.isfinite(depth), kind, 0).astype(np.uint8)
        T_home_cam = np.eye(4)
        T_home_cam[:3, :3], T_home_cam[:3, 3] = R, self.eye
        return DepthView(
            name, depth.astype(np.float32), sigma.astype(np.float32), kinds, K, T_home_cam, stamp_s
        )

    def _cast(self, rays):
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(rays[..., 2] < 0, -self.eye[2] / rays[..., 2], np.inf)
            for box in self.boxes:
                low, high = np.array(box[::2], float), np.array(box[1::2], float)
                a, b = (low - self.eye) / rays, (high - self.eye) / rays
                near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
                depth = np.where((near <= far) & (near > 0) & (near < depth), near, depth)
        return np.where(depth < 60, depth, np.nan)


@pytest.fixture
def scene():
    return Scene


def _write_map(view, folder, stamp_s=None):
    """A folder as the command map writes it, with what a ground needs."""
    folder.mkdir()
    for name in ("depth", "sigma", "kind"):
        np.save(folder / f"{name}.npy", getattr(view, name))
    K = view.K
    camera = {
        "fx": K[0, 0],
        "fy": K[1, 1],
        "cx": K[0, 2],
        "cy": K[1, 2],
        "T_home_cam": view.T_home_cam.tolist(),
    }
    camera.update({} if stamp_s is None else {"stamp_s": stamp_s})
    (folder / "report.json").write_text(json.dumps({"reference": camera}))


@pytest.fixture
def write_map():
    return _write_map
