# SPDX-License-Identifier: Apache-2.0
"""The simulated camera: lens and sensor of a D435F-like colour camera on top of the renderer."""

from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.render import compiled
from fcsv_sim.render.bodies import RenderedBody
from fcsv_sim.render.renderer import Renderer

_POOL = 1 << 20  # normal deviates drawn once; a picture starts somewhere in it


@dataclass(frozen=True)
class CameraParameters:
    """Picture values are 0..1. Noise: variance = read_noise**2 + shot_noise**2 * value.

    A calibrated ``lens`` replaces width, height, angle of view and distortion.
    """

    width: int = 640
    height: int = 480
    horizontal_fov_deg: float = 56.0
    distortion: Tuple[float, float, float, float, float] = (0.042, -0.085, 0.0006, -0.0004, 0.0)
    read_noise: float = 0.004
    shot_noise: float = 0.011
    blur_px: float = 0.45
    vignetting: float = 0.14  # light lost in the corners
    brightness: float = 0.47  # mean value that auto-exposure aims at
    exposure_limits: Tuple[float, float] = (0.25, 4.0)
    exposure_lag_s: float = 0.4
    lens: Optional[PinholeCamera] = None
    mount_deg: float = 0.02  # what camera and airframe do not share of the vibration

    def __post_init__(self):
        for name in ("read_noise", "shot_noise", "blur_px", "exposure_lag_s", "mount_deg"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name}: {getattr(self, name)} must not be negative")
        if not 0 < self.exposure_limits[0] <= self.exposure_limits[1]:
            raise ValueError(f"exposure_limits: {self.exposure_limits} must be positive and rising")

    @property
    def model(self) -> PinholeCamera:
        """Lens and size of the pictures."""
        if self.lens is not None:
            return self.lens
        fov = np.radians(self.horizontal_fov_deg)
        return PinholeCamera.from_fov(self.width, self.height, fov, self.distortion)


@dataclass(frozen=True)
class Shot:
    """One picture: rgb (H,W,3) uint8, true depth (H,W) f32 along the optical axis, and where it was
    truly taken."""

    stamp_s: float
    rgb: np.ndarray
    depth: np.ndarray
    T_world_cam: np.ndarray


class SimulatedCamera:
    """Takes pictures in order of time; the same seed and poses give the same pictures."""

    def __init__(
        self, renderer: Renderer, T_body_cam: np.ndarray, parameters: CameraParameters, seed: int
    ):
        self._renderer = renderer
        self._T_body_cam = T_body_cam
        self._parameters = parameters
        self.model = parameters.model
        self._random = np.random.default_rng([seed, 5])
        self._pool = np.random.default_rng([seed, 6]).standard_normal(_POOL, dtype=np.float32)
        self._vignette = _vignette(self.model, parameters.vignetting)
        self._exposure = 1.0
        self._stamp_s = -np.inf

    @property
    def exposure(self) -> float:
        """Gain of the next picture."""
        return self._exposure

    def shoot(
        self,
        stamp_s: float,
        T_world_body: np.ndarray,
        others: Sequence[RenderedBody] = (),
        samples: int = 5,
    ) -> Shot:
        """A picture at mid-exposure ``stamp_s`` from a body that already vibrates; others are seen
        where they are.

        ``samples`` as in Renderer.
        """
        shake = np.radians(self._parameters.mount_deg) * self._random.standard_normal(3)
        T_mount = transforms.transform(Rotation.from_rotvec(shake).as_matrix(), np.zeros(3))
        T_world_cam = T_world_body @ self._T_body_cam @ T_mount
        values, depth = self._renderer.values(
            T_world_cam, self.model, self._exposure, others, samples
        )
        if self._parameters.blur_px > 0:
            values = cv2.GaussianBlur(values, (5, 5), self._parameters.blur_px)
        rgb = np.empty(values.shape, np.uint8)
        p = self._parameters
        start = int(self._random.integers(_POOL))
        mean = _develop(values, self._vignette, self._pool, start, p.read_noise, p.shot_noise, rgb)
        self._meter(mean, stamp_s)
        return Shot(stamp_s, rgb, depth, T_world_cam)

    def _meter(self, mean: float, stamp_s: float) -> None:
        """Auto-exposure: towards the wished brightness with a lag, inside the sensor's limits."""
        p = self._parameters
        elapsed_s = stamp_s - self._stamp_s
        self._stamp_s = stamp_s
        share = (
            1.0
            if not np.isfinite(elapsed_s) or p.exposure_lag_s == 0
            else 1.0 - np.exp(-elapsed_s / p.exposure_lag_s)
        )
        # values go with the square root of light
        wished = self._exposure * (p.brightness / max(mean, 0.02)) ** 2
        gain = self._exposure * (wished / self._exposure) ** max(share, 0.0)
        self._exposure = float(np.clip(gain, *p.exposure_limits))


def _vignette(camera: PinholeCamera, loss: float) -> np.ndarray:
    """Share of the value that is left (H,W) f32: light falls by ``loss`` to the corners, values by
    half of that."""
    v, u = np.mgrid[: camera.height, : camera.width]
    r2 = ((u - camera.cx) / camera.width * 2) ** 2 + ((v - camera.cy) / camera.width * 2) ** 2
    return (1.0 - 0.5 * loss * r2 / r2.max()).astype(np.float32)


@compiled.kernel
def _develop(values, vignette, pool, start, read_noise, shot_noise, out):
    """Vignetting, noise, eight bits; returns the mean value before noise."""
    mask = pool.size - 1
    n, total = start, 0.0
    height, width = vignette.shape
    for v in range(height):
        for u in range(width):
            for k in range(3):
                x = values[v, u, k] * vignette[v, u]
                total += x
                sigma = np.sqrt(read_noise * read_noise + shot_noise * shot_noise * x)
                y = (x + sigma * pool[n & mask]) * 255.0 + 0.5
                n += 1
                out[v, u, k] = np.uint8(min(max(y, 0.0), 255.0))
    return total / (height * width * 3)
