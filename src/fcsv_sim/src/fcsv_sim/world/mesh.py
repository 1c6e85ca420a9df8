# SPDX-License-Identifier: Apache-2.0
"""Collects quads and triangles with material, instance and metric texture coordinates into one
mesh."""

from dataclasses import dataclass
from typing import List, Optional

import numpy as np

from fcsv_sim.world.materials import COLUMNS

_CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
_FACES = np.array(
    [[0, 2, 6, 4], [3, 1, 5, 7], [1, 0, 4, 5], [2, 3, 7, 6], [4, 5, 7, 6], [1, 0, 2, 3]]
)


@dataclass(frozen=True)
class Placement:
    """A place on the ground with a heading: world = R_z(yaw) @ local + xyz (m, rad)."""

    x: float
    y: float
    z: float
    yaw: float = 0.0

    def apply(self, p_local: np.ndarray) -> np.ndarray:
        """Points (..., 3) in the world."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return p_local @ R.T + [self.x, self.y, self.z]


class MeshBuilder:
    """Append, then ``build``. Corners of a quad run around it; orientation does not matter."""

    def __init__(self):
        self._vertices: List[np.ndarray] = []
        self._triangles: List[np.ndarray] = []
        self._vertex_count = 0
        self._uv: List[np.ndarray] = []
        self._material: List[np.ndarray] = []
        self._instance: List[np.ndarray] = []
        self._rows: List[np.ndarray] = []
        self._row_count = 0

    def instances(self, rows: np.ndarray) -> np.ndarray:
        """Indices of new rows (K, <= COLUMNS) in the instance table."""
        rows = np.atleast_2d(np.asarray(rows, np.float32))
        full = np.zeros((len(rows), COLUMNS), np.float32)
        full[:, : rows.shape[1]] = rows
        self._rows.append(full)
        self._row_count += len(rows)
        return np.arange(self._row_count - len(rows), self._row_count)

    def instance(self, colour, seed: float = 0.0, rest=()) -> int:
        """Index of one new row: colour (3), seed, and the material's own columns from 4 on."""
        return int(self.instances(np.array([[*colour, seed, *rest]]))[0])

    def faces(
        self, corners: np.ndarray, material: int, instance, uv: Optional[np.ndarray] = None
    ) -> None:
        """Quads (K, 4, 3) or triangles (K, 3, 3) with uv (K, 4 or 3, 2) in metres; else it is taken
        from the shape."""
        corners = np.asarray(corners, float)
        if len(corners) == 0:
            return
        uv = _shape_uv(corners) if uv is None else np.asarray(uv, float)
        count, sides = corners.shape[:2]
        fan = np.array([[0, 1, 2]] if sides == 3 else [[0, 1, 2], [0, 2, 3]])
        triangles = (sides * np.arange(count)[:, None, None] + fan).reshape(-1, 3)
        instances = np.repeat(np.broadcast_to(np.asarray(instance, np.int32), (count,)), len(fan))
        self._append(corners.reshape(-1, 3), triangles, uv.reshape(-1, 2), material, instances)

    def copies(
        self, points: np.ndarray, faces: np.ndarray, material: int, instance: np.ndarray
    ) -> None:
        """K meshes of one topology: points (K, V, 3), triangles (F, 3) among them, an instance
        each; no uv."""
        count, size = points.shape[:2]
        first = size * np.arange(count)[:, None, None]
        self._append(
            points.reshape(-1, 3),
            (first + faces).reshape(-1, 3),
            np.zeros((count * size, 2)),
            material,
            np.repeat(np.asarray(instance, np.int32), len(faces)),
        )

    def box(self, place: Placement, low, high, material: int, instance, faces=range(6)) -> None:
        """Axis-aligned box in the placement's frame; faces: -x, +x, -y, +y, top, bottom."""
        low, high = np.asarray(low, float), np.asarray(high, float)
        self.faces(
            place.apply((low + _CUBE * (high - low))[_FACES[list(faces)]]), material, instance
        )

    def build(self):
        """vertices (N,3) f32, triangles (M,3) i32, uv (N,2) f32, material (M) u8, instance (M) i32,
        table f32."""
        return (
            np.concatenate(self._vertices),
            np.concatenate(self._triangles),
            np.concatenate(self._uv),
            np.concatenate(self._material),
            np.concatenate(self._instance),
            np.concatenate(self._rows),
        )

    def _append(self, vertices, triangles, uv, material, instance) -> None:
        self._vertices.append(vertices.astype(np.float32))
        self._triangles.append((triangles + self._vertex_count).astype(np.int32))
        self._uv.append(uv.astype(np.float32))
        self._material.append(np.full(len(triangles), material, np.uint8))
        self._instance.append(instance)
        self._vertex_count += len(vertices)


def _shape_uv(corners: np.ndarray) -> np.ndarray:
    """Metres along the first edge and across it: right for rectangles and parallelograms."""
    along = corners[:, 1] - corners[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    rest = corners - corners[:, :1]
    u = np.einsum("kci,ki->kc", rest, along)
    v = np.linalg.norm(rest - u[..., None] * along[:, None], axis=-1)
    return np.stack([u, v], -1)
