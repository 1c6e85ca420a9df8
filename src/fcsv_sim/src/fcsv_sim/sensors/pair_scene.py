# SPDX-License-Identifier: Apache-2.0
"""What two vehicles' pictures of one scene have in common, as matched points: no picture is drawn.

It is no kinder than real pictures: features lie 0.7 px off, one match of seven is wrong and stays
so as long as both hold, and vibration, a rolling shutter and late stamps turn each picture. The
scene is that of ``scene``.
"""

from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_sim.sensors.scene import DEPTH_SPREAD, FIELD, TURNED_RAD, SimulatedScene

FOCAL_PX, NOISE_PX = 600.0, 0.7
_MATCHES, _MATCHES_OF_LITTLE_TEXTURE = 130, 15
_WRONG = 1.0 / 7.0
_MOVED_M = 1.0  # then other points are matched


class MatchedScene:
    """Matches points of the cameras whose scenes are ``a`` and ``b``: where one shows too little
    texture the pair does."""

    def __init__(self, a: SimulatedScene, b: SimulatedScene, seed: int):
        self._random = np.random.default_rng([seed, 6])
        self._depth_m, little = a.depth_m, a.little_texture or b.little_texture
        self._count = _MATCHES_OF_LITTLE_TEXTURE if little else _MATCHES
        self._kept: Optional[Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = None

    def rays(self, T_world_a: np.ndarray, T_world_b: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Matched rays (N, 3) with z = 1 in the optical frames of a and b, from where both truly
        are."""
        if self._kept is None or np.linalg.norm(self._kept[0] - T_world_b[:3, 3]) > _MOVED_M:
            self._kept = self._drawn(T_world_a, T_world_b)
        _, p_world, off_px, wrong = self._kept
        p_a, p_b = (transforms.apply(transforms.invert(T), p_world) for T in (T_world_a, T_world_b))
        rays_a, rays_b = self._pictured(p_a), self._pictured(p_b)
        rays_b[:, :2] += off_px / FOCAL_PX
        rays_b[wrong, :2] = off_px[wrong] / NOISE_PX * FIELD
        return rays_a, rays_b

    def _drawn(self, T_world_a: np.ndarray, T_world_b: np.ndarray):
        n, random = self._count, self._random
        depth_m = self._depth_m * np.exp(DEPTH_SPREAD * random.standard_normal(n))
        p_a = depth_m[:, None] * np.column_stack(
            [random.uniform(-1.0, 1.0, (n, 2)) * FIELD, np.ones(n)]
        )
        p_world = transforms.apply(T_world_a, p_a)
        p_b = transforms.apply(transforms.invert(T_world_b), p_world)
        seen = (p_b[:, 2] > 0.5) & (np.abs(p_b[:, :2]) < FIELD * p_b[:, 2:]).all(axis=1)
        off_px = random.normal(0.0, NOISE_PX, (n, 2))
        return (
            T_world_b[:3, 3].copy(),
            p_world[seen],
            off_px[seen],
            random.random(int(seen.sum())) < _WRONG,
        )

    def _pictured(self, p_cam: np.ndarray) -> np.ndarray:
        turned = p_cam @ rotations.exp(self._random.normal(0.0, TURNED_RAD, 3)).T
        return turned / np.maximum(turned[:, 2:], 0.1)
