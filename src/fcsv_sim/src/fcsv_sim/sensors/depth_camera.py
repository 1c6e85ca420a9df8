# SPDX-License-Identifier: Apache-2.0
"""The simulated depth camera: what a D435F makes of the true depth, with its noise, its range and
its holes."""

from dataclasses import dataclass

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.near import DepthSensor

_SKY_M = 1e5


@dataclass(frozen=True)
class DepthParameters:
    """``window_px``: of matching, in the colour camera's pixels; errors hang together over it.
    ``step_px``: the finest disparity that is told (D4: 1/32 px). ``dark``, ``bright`` and ``plain``
    are of picture values 0..1: below, above, or with less contrast than it there is no match. Of
    the pixels within a window of an edge ``edge_holes`` have none, and ``edge_between`` a depth
    between both sides. ``speckle``: share of windows without a match for no reason."""

    window_px: int = 5
    step_px: float = 1.0 / 32.0
    dark: float = 0.04
    bright: float = 0.97
    plain: float = 0.004
    edge_holes: float = 0.4
    edge_between: float = 0.2
    speckle: float = 0.02

    def __post_init__(self):
        if self.window_px < 1 or self.window_px % 2 == 0:
            raise ValueError(f"window_px: {self.window_px} must be odd")
        if not 0.0 <= self.edge_holes <= 1.0 - self.edge_between <= 1.0:
            raise ValueError(
                f"edge_holes, edge_between: {self.edge_holes}, {self.edge_between} are shares of one whole"
            )


class SimulatedDepth:
    """Depth pictures in order; the same seed and pictures give the same. ``seed`` is that of a
    camera: its module's calibration is off by an error that all of its pictures share."""

    def __init__(
        self, camera: PinholeCamera, seed: int, sensor: DepthSensor, parameters: DepthParameters
    ):
        self._camera, self._sensor, self._parameters = camera, sensor, parameters
        self._random = np.random.default_rng([seed, 7])
        self._offset_px = float(np.random.default_rng([seed, 8]).normal(0.0, sensor.offset_px))

    def measure(self, depth: np.ndarray, rgb: np.ndarray) -> np.ndarray:
        """(H,W) uint16 mm, 0 where there is none, of true depth (H,W) float32 (m, NaN: sky) and the
        picture (H,W,3) uint8 of the same moment."""
        p, s = self._parameters, self._sensor
        seen = np.where(np.isfinite(depth), depth, np.float32(_SKY_M))
        nearest, farthest = _around(seen, p.window_px)
        lost = self._unmatched(rgb) | self._shadow(seen)
        edge = farthest > 1.1 * nearest
        chance = self._chance()
        lost |= edge & (chance < p.edge_holes)
        between = edge & (farthest < _SKY_M) & (chance > 1.0 - p.edge_between)
        share = self._random.random(depth.shape, dtype=np.float32)
        seen = np.where(between, nearest + share * (farthest - nearest), seen)
        bf = s.focal_px * s.baseline_m
        with np.errstate(divide="ignore", invalid="ignore"):
            disparity = bf / seen + self._offset_px + s.subpixel_px * self._noise()
            disparity = np.rint(disparity / p.step_px) * p.step_px
            measured = bf / disparity
        lost |= ~s.in_range(measured) | (seen >= _SKY_M)
        return np.where(lost, 0.0, np.rint(1000.0 * measured)).astype(np.uint16)

    def _noise(self) -> np.ndarray:
        """(H,W) of unit variance; neighbours within a window hang together."""
        n = self._parameters.window_px
        white = self._random.standard_normal(
            (self._camera.height, self._camera.width), dtype=np.float32
        )
        return cv2.blur(white, (n, n)) * n

    def _chance(self) -> np.ndarray:
        """(H,W) 0..1, the same for a window's neighbours."""
        n = self._parameters.window_px
        height, width = self._camera.height, self._camera.width
        coarse = self._random.random((height // n + 1, width // n + 1), dtype=np.float32)
        return np.repeat(np.repeat(coarse, n, 0), n, 1)[:height, :width]

    def _unmatched(self, rgb: np.ndarray) -> np.ndarray:
        """Where nothing can be matched: dark, too bright (what mirrors the sun too), or plain; and
        a little besides."""
        p = self._parameters
        value = rgb.mean(axis=2, dtype=np.float32) / 255.0
        n = (2 * p.window_px + 1, 2 * p.window_px + 1)
        mean = cv2.blur(value, n)
        contrast2 = cv2.blur(value * value, n) - mean * mean
        without = (mean < p.dark) | (rgb.max(axis=2) > 255.0 * p.bright) | (contrast2 < p.plain**2)
        return without | (self._chance() < p.speckle)

    def _shadow(self, depth: np.ndarray) -> np.ndarray:
        """Where something nearer hides from the right imager what the left one sees: to the left of
        near things."""
        with np.errstate(divide="ignore"):
            in_right = np.arange(depth.shape[1]) - self._camera.fx * self._sensor.baseline_m / depth
        to_the_right = np.minimum.accumulate(in_right[:, ::-1], axis=1)[:, ::-1]
        return in_right > to_the_right + 0.5


def _around(depth: np.ndarray, window_px: int):
    kernel = np.ones((window_px, window_px))
    return cv2.erode(depth, kernel), cv2.dilate(depth, kernel)
