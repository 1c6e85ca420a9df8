# SPDX-License-Identifier: Apache-2.0
"""What a camera sees of a scene, as points that are followed from picture to picture: no picture is
drawn.

It is no kinder than real pictures: in one flight of seven there is too little texture, points are
followed to half a pixel of a small picture, some move by themselves, and vibration, a rolling
shutter and late stamps turn all of a picture. How far away the scene is differs from flight to
flight: half of its points are beyond 40 to 160 m, as from 8 to 12 m above the drawn worlds.
"""

from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_tracking.scene.scene_motion import SceneLook, look, outlived

_POINTS, _POINTS_OF_LITTLE_TEXTURE, _LITTLE_TEXTURE = 60, 10, 1.0 / 7.0
FIELD = np.array([0.53, 0.4])  # tangents of the half angles of view: 56 degrees wide
_DEPTHS_M, DEPTH_SPREAD = (40.0, 160.0), 1.1  # of the middle one; of the logarithm, about it
_FOLLOWED_RAD = 0.0017  # half a pixel of 320 across the field
_KEPT = 0.5  # as scene_motion
_MOVE_BY_THEMSELVES, _MOVE_MPS = 0.15, 0.5
TURNED_RAD = 0.003  # of a whole picture: vibration, rolling shutter
_STAMP_S = 0.008


class SimulatedScene:
    """Stands where scene_motion.SceneWatch stands: the truth and the tracker's pose in, what a look
    says out."""

    def __init__(self, T_body_cam: np.ndarray, seed: int):
        self._random = np.random.default_rng([seed, 5])
        self._T_body_cam = T_body_cam
        # of its middle point
        self.depth_m = float(np.exp(self._random.uniform(*np.log(_DEPTHS_M))))
        self.little_texture = bool(self._random.random() < _LITTLE_TEXTURE)
        self._count = _POINTS_OF_LITTLE_TEXTURE if self.little_texture else _POINTS
        self.begin_again()

    def begin_again(self) -> None:
        """Begins anew, as SceneWatch's."""
        self._then: Optional[Tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = None

    def observe(
        self,
        stamp_s: float,
        T_world_body: np.ndarray,
        T_odom_body: np.ndarray,
        turns_radps: np.ndarray,
    ) -> Optional[SceneLook]:
        """None where points were only taken now. ``turns_radps`` (3,) in the body: a late stamp
        turns the picture."""
        T_world_cam, T_odom_cam = T_world_body @ self._T_body_cam, T_odom_body @ self._T_body_cam
        if self._then is None:
            return self._restart(stamp_s, T_world_cam, T_odom_cam, turns_radps)
        then_s, T_odom_then, p_world, v_world, xy_then = self._then
        span_s = stamp_s - then_s
        p_cam = transforms.apply(transforms.invert(T_world_cam), p_world + span_s * v_world)
        xy = self._pictured(p_cam, turns_radps)
        seen = (p_cam[:, 2] > 0.5) & (np.abs(xy[:, 0]) < FIELD[0]) & (np.abs(xy[:, 1]) < FIELD[1])
        T_now_then = transforms.invert(T_odom_cam) @ T_odom_then
        if seen.sum() < _KEPT * len(xy) or outlived(span_s, T_now_then):
            return self._restart(stamp_s, T_world_cam, T_odom_cam, turns_radps)
        return look(span_s, xy_then[seen], xy[seen], T_now_then, T_odom_cam[:3, :3])

    def _restart(
        self, stamp_s: float, T_world_cam: np.ndarray, T_odom_cam: np.ndarray, turns_radps
    ) -> None:
        n, random = self._count, self._random
        depth_m = self.depth_m * np.exp(DEPTH_SPREAD * random.standard_normal(n))
        xy = random.uniform(-1.0, 1.0, (n, 2)) * FIELD
        p_cam = depth_m[:, None] * np.column_stack([xy, np.ones(n)])
        p_world = transforms.apply(T_world_cam, p_cam)
        moving = random.random(n) < _MOVE_BY_THEMSELVES
        v_world = moving[:, None] * random.normal(0.0, _MOVE_MPS, (n, 3))
        self._then = (stamp_s, T_odom_cam, p_world, v_world, self._pictured(p_cam, turns_radps))

    def _pictured(self, p_cam: np.ndarray, turns_radps: np.ndarray) -> np.ndarray:
        """(N, 2) x/z, y/z of points (optical frame) with the errors of following them."""
        random = self._random
        late_rad = random.normal(0.0, _STAMP_S) * (self._T_body_cam[:3, :3].T @ turns_radps)
        turned = p_cam @ rotations.exp(random.normal(0.0, TURNED_RAD, 3) + late_rad).T
        xy = turned[:, :2] / np.maximum(turned[:, 2:], 0.1)
        return xy + random.normal(0.0, _FOLLOWED_RAD, xy.shape)
