# SPDX-License-Identifier: Apache-2.0
"""What gets into a robot's way: boxes that come, stay and go; and how views that watch the place
show them."""

from dataclasses import dataclass, replace
from typing import Callable, Optional, Sequence, Tuple

import cv2
import numpy as np
from scipy.special import ndtri

from fcsv_guidance.ground.views import DepthView
from fcsv_sim.render.caster import make_caster
from fcsv_sim.render.rays import T, ray_buffer, set_rays
from fcsv_sim.world.town import Town

# of live matching with 6 m of baseline, poses refined (docs/lab/guidance.md; 1 px is 2.8e-4 / m):
# what a whole view shares, what pixels and patches have of their own, standard deviations in
# inverse depth (1/m)
_SHARED, _OWN, _OF_PATCHES = 5e-4, 1e-4, 1.5e-4
_OWN_PX, _PATCH_PX = 1.5, 12.0  # how far an error reaches
# how far edges are off, how far that reaches, and what is an edge (1/m)
_WANDERS_PX, _WANDER_PX, _EDGE = 2.0, 8.0, 5e-4
_WRONG, _WRONG_PX, _WRONG_SHIFT = 1.0, (2, 6), 2e-3  # patches a view, their radius, error (1/m)
_NO_DEPTH, _MISSED = 0.2, 0.1  # share of pixels without depth; of views in which a thing has none


@dataclass(frozen=True)
class Box:
    """Middle x, y, lower z (m), half sizes (m), yaw (rad)."""

    x_m: float
    y_m: float
    z_m: float
    half_m: Tuple[float, float]
    high_m: float
    yaw_rad: float = 0.0

    def gap_m(self, x_m, y_m) -> np.ndarray:
        """Measures the gap from places (any shape) to its side; negative inside."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        dx, dy = np.asarray(x_m) - self.x_m, np.asarray(y_m) - self.y_m
        off = np.abs(np.stack([c * dx + s * dy, c * dy - s * dx], -1)) - self.half_m
        return np.hypot(*np.moveaxis(np.maximum(off, 0.0), -1, 0)) + np.minimum(off.max(-1), 0.0)


#: Where a box is at a time; None while it is not there.
Thing = Callable[[float], Optional[Box]]


class Watcher:
    """Vehicles that hold at a station and see where its map does: the true depth of now, with
    errors as live matching has them."""

    def __init__(self, town: Town, view: DepthView, seed: int):
        self.view = view
        self._random = np.random.default_rng([seed, 23])
        self._rays = view.camera.rays() @ view.T_home_cam[:3, :3].T
        flat = self._rays.reshape(-1, 3)
        rays = ray_buffer(len(flat))
        set_rays(rays, np.tile(view.T_home_cam[:3, 3], (len(flat), 1)), flat)
        make_caster(town.vertices, town.triangles, 1).cast(rays)
        self._true = rays[:, T].reshape(view.depth.shape)

    def look(self, stamp_s: float, boxes: Sequence[Box]) -> DepthView:
        """The depth view of an instant."""
        random, old = self._random, self.view
        depth, kind = self._true, old.kind.copy()
        missed = random.random() < _MISSED
        for box in boxes:
            hit = self._hit(box)
            before = hit < depth
            kind[before] = 0 if missed else 2
            depth = np.where(before, hit, depth)
        with np.errstate(divide="ignore"):
            inverse = self._with_edges_off((1.0 / depth).astype(np.float32))
        height, width = depth.shape
        v, u = (np.indices(depth.shape) - np.array([[[height]], [[width]]]) / 2) / width
        a, b, c = _SHARED * random.standard_normal(3)
        off = a + b * u + c * v + _OWN * self._field(_OWN_PX) + _OF_PATCHES * self._field(_PATCH_PX)
        for _ in range(random.poisson(_WRONG)):
            at = int(random.integers(width)), int(random.integers(height))
            wrong = np.zeros(depth.shape, np.uint8)
            cv2.circle(wrong, at, int(random.integers(*_WRONG_PX)), 1, -1)
            off = off + random.choice((-1.0, 1.0)) * _WRONG_SHIFT * wrong
        kind[self._field(_PATCH_PX) < ndtri(_NO_DEPTH)] = 0
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = inverse + off
            depth = np.where(inverse > 1e-3, 1.0 / inverse, np.nan).astype(np.float32)
        sigma = (np.hypot(_SHARED, _OWN) * depth**2).astype(np.float32)
        return replace(old, depth=depth, sigma=sigma, kind=kind, stamp_s=stamp_s)

    def _with_edges_off(self, inverse: np.ndarray) -> np.ndarray:
        """Inverse depth (H,W) which at its edges is that of pixels some way beside."""
        v, u = np.indices(inverse.shape, np.float32)
        u, v = (at + _WANDERS_PX * self._field(_WANDER_PX) for at in (u, v))
        beside = cv2.remap(inverse, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        # in the picture of a plane it is affine: nothing bends
        bends = np.abs(cv2.Laplacian(inverse, cv2.CV_32F)) > _EDGE
        reach = np.ones((2 * round(2 * _WANDERS_PX) + 1,) * 2, np.uint8)
        return np.where(cv2.dilate(bends.astype(np.uint8), reach) > 0, beside, inverse)

    def _field(self, reach_px: float) -> np.ndarray:
        """(H,W) float32 of noise with standard deviation 1 that neighbours share."""
        step = max(1, int(reach_px))
        height, width = self.view.depth.shape
        small = (width // step + 2, height // step + 2)
        noise = self._random.standard_normal(small[::-1], dtype=np.float32)
        noise = cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
        return noise / noise.std()

    def _hit(self, box: Box) -> np.ndarray:
        """(H,W) depth of the box; inf beside it."""
        c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
        R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        eye = R @ (self.view.T_home_cam[:3, 3] - [box.x_m, box.y_m, box.z_m])
        rays = self._rays @ R.T
        low, high = (
            np.array([-box.half_m[0], -box.half_m[1], 0.0]),
            np.array([*box.half_m, box.high_m]),
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - eye) / rays, (high - eye) / rays
            near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
        return np.where((near <= far) & (near > 0), near, np.inf)


class Closer:
    """A thing that stands in the way from a time to a time (s)."""

    def __init__(self, box: Box, from_s: float, until_s: float):
        self._box, self._from_s, self._until_s = box, from_s, until_s
        self.box: Optional[Box] = None
        self.moves = False

    def step(self, now_s: float, x_m: float, y_m: float, room_m: float) -> None:
        """What it is now."""
        self.box = self._box if self._from_s <= now_s < self._until_s else None


class Runner:
    """Comes along ``way`` (N,2), which ends at the robot, at a speed; it halts SHY_M before the
    footprint, waits, and goes back."""

    SHY_M = 0.25
    _HALF_M, _HIGH_M, _WAITS_S = (0.3, 0.3), 1.7, 4.0

    def __init__(self, way: np.ndarray, speed_mps: float, from_s: float, z_m: float):
        self._way, self._speed_mps, self._z_m = way, speed_mps, z_m
        run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        self._run_m, self._at_m, self._last_s, self._back_s = run, 0.0, from_s, np.inf
        self.box: Optional[Box] = None
        self.halted_s: Optional[float] = None
        self.moves = True

    def step(self, now_s: float, x_m: float, y_m: float, room_m: float) -> None:
        """Where it is now; ``room_m`` is the robot's radius."""
        dt_s, self._last_s = max(0.0, now_s - self._last_s), now_s
        if now_s < self._back_s and self.halted_s is None:
            self._at_m += dt_s * self._speed_mps
            box = self._placed()
            if box.gap_m(x_m, y_m) - room_m <= self.SHY_M or self._at_m >= self._run_m[-1]:
                self.halted_s, self._back_s = now_s, now_s + self._WAITS_S
        elif now_s >= self._back_s:
            self._at_m -= dt_s * self._speed_mps
        self.box = self._placed() if self._at_m >= 0.0 else None

    def _placed(self) -> Box:
        x, y = (float(np.interp(self._at_m, self._run_m, self._way[:, k])) for k in (0, 1))
        return Box(x, y, self._z_m, self._HALF_M, self._HIGH_M)
