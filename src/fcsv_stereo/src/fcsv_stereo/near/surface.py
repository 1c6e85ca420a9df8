# SPDX-License-Identifier: Apache-2.0
"""Surfaces of the near field in home: as points, and as a camera sees them."""

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.evaluating.raycast import cast, open3d, scene_of


@dataclass(frozen=True)
class NearPoints:
    """N points in home: float32 (N,3) m; float32 (N,) standard deviation per axis (m)."""

    points_home_m: np.ndarray
    sigma_m: np.ndarray

    def __len__(self) -> int:
        return len(self.points_home_m)


@dataclass(frozen=True)
class NearSurface:
    """Triangles (M,3) int of vertices (N,3) float32 (home, m) with standard deviations per axis
    (N,) float32 (m); ``voxel_m`` is how fine it is."""

    vertices_home_m: np.ndarray
    triangles: np.ndarray
    sigma_m: np.ndarray
    voxel_m: float

    @classmethod
    def none(cls, voxel_m: float) -> "NearSurface":
        """Nothing was seen."""
        return cls(
            np.zeros((0, 3), np.float32),
            np.zeros((0, 3), np.int64),
            np.zeros(0, np.float32),
            voxel_m,
        )

    @classmethod
    def of(cls, vertices_home_m, triangles, sigma_m, kept, voxel_m: float) -> "NearSurface":
        """Makes a surface of those vertices that are ``kept`` (N,) bool, and the triangles between
        them."""
        number = np.cumsum(kept) - 1
        whole = kept[triangles].all(axis=1)
        return cls(vertices_home_m[kept], number[triangles[whole]], sigma_m[kept], voxel_m)

    def __len__(self) -> int:
        return len(self.vertices_home_m)

    def points(self) -> NearPoints:
        """One point per voxel: the mean of its vertices, weighted by 1/sigma**2. What one voxel
        holds is of the same frames, so that sigma is that of one."""
        if not len(self):
            return NearPoints(self.vertices_home_m, self.sigma_m)
        cell = np.floor(self.vertices_home_m / self.voxel_m).astype(np.int64)
        cell -= cell.min(axis=0)
        size = cell.max(axis=0) + 1
        flat = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
        _, voxel = np.unique(flat, return_inverse=True)
        weight = 1.0 / np.maximum(self.sigma_m.astype(float), 1e-6) ** 2
        total = np.bincount(voxel, weight)
        mean = np.stack(
            [np.bincount(voxel, weight * axis) for axis in self.vertices_home_m.T.astype(float)],
            axis=-1,
        )
        sigma = np.sqrt(np.bincount(voxel) / total)
        return NearPoints((mean / total[:, None]).astype(np.float32), sigma.astype(np.float32))

    def seen(self, camera: PinholeCamera, T_home_cam: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """(H,W) float32 each: depth (m along the optical axis) and sigma (m) as a camera sees it,
        NaN where nothing."""
        shape = (camera.height, camera.width)
        depth, sigma = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
        if not len(self.triangles):
            return depth, sigma
        tensor, mesh = open3d().core.Tensor, open3d().t.geometry.TriangleMesh()
        mesh.vertex.positions = tensor(self.vertices_home_m)
        mesh.triangle.indices = tensor(self.triangles.astype(np.uint32))
        depth, triangles = cast(scene_of(mesh), T_home_cam, camera)
        hit = np.isfinite(depth)
        sigma[hit] = self.sigma_m[self.triangles[triangles[hit]]].mean(axis=1)
        return depth, sigma
