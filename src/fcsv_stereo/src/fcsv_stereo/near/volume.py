# SPDX-License-Identifier: Apache-2.0
"""Depth frames summed in home: signed distances to the nearest surface, in blocks of voxels where
something stands.

Open3D's voxel block grid holds the blocks and extracts the surface. The sum is our own: Open3D's
counts every frame alike, ours by 1/sigma**2 of its depth and pose there.
"""

from dataclasses import dataclass
from typing import List, Optional

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_stereo.evaluating.raycast import open3d
from fcsv_stereo.near.frame import DepthFrame
from fcsv_stereo.near.reach import View, within_reach
from fcsv_stereo.near.sensor import DepthSensor
from fcsv_stereo.near.summing import add_frame
from fcsv_stereo.near.surface import NearSurface

_BLOCK = 8  # voxels along the edge of one
_BLOCKS = 4096  # at first; the grid grows
_STRIDE = 4  # pixels of which one opens blocks: less than a block apart at any depth
_LEAST_WEIGHT = 1e-3  # 1/m2: whatever was looked at
_COLOUR = 255.0  # what open3d divides it by


@dataclass(frozen=True)
class NearRules:
    """``voxel_m``: points lie so far apart. ``truncation_voxels``, ``truncation_sigmas``: how far
    before and behind a depth it counts, the larger of both. ``least_looks``: frames that must have
    seen a surface."""

    voxel_m: float = 0.05
    truncation_voxels: float = 4.0
    truncation_sigmas: float = 3.0
    least_looks: int = 3

    def __post_init__(self):
        require_positive(self)


class NearVolume:
    """Frames in, a surface out. Raises InputError where open3d is not installed."""

    def __init__(self, sensor: Optional[DepthSensor] = None, rules: Optional[NearRules] = None):
        library = open3d()
        self._core = library.core
        self._sensor, self._rules = sensor or DepthSensor(), rules or NearRules()
        f32 = self._core.float32
        # extraction interpolates and hands out one attribute besides, by this name (see
        # ``summing``)
        names, channels = ("tsdf", "weight", "color"), ((1), (1), (3))
        self._grid = library.t.geometry.VoxelBlockGrid(
            names,
            (f32, f32, f32),
            channels,
            self._rules.voxel_m,
            _BLOCK,
            _BLOCKS,
            self._core.Device("CPU:0"),
        )
        self._views: List[View] = []

    @property
    def frames(self) -> int:
        """How many are in it."""
        return len(self._views)

    def integrate(self, frame: DepthFrame) -> None:
        """Add one frame; one without a depth that can be believed changes nothing."""
        depth = frame.believed(self._sensor)
        if not np.isfinite(depth[::_STRIDE, ::_STRIDE]).any():
            return
        self._views.append((frame.camera, frame.T_home_cam))
        T_cam_home = transforms.invert(frame.T_home_cam)
        keys = self._open_blocks(depth, frame)
        indices, _ = self._grid.hashmap().find(keys)
        xyz, flat = self._grid.voxel_coordinates_and_flattened_indices(indices)
        noise2 = np.square(self._sensor.noise_m(depth))
        shared2 = frame.pose_variance_m2(depth) + np.square(self._sensor.offset_m(depth))
        camera, rules = frame.camera, self._rules
        add_frame(
            xyz.numpy(),
            flat.numpy(),
            T_cam_home,
            np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
            depth,
            noise2.astype(np.float32),
            shared2.astype(np.float32),
            self._unit_m,
            rules.truncation_sigmas,
            *(
                self._grid.attribute(n).numpy().reshape(-1, c)
                for n, c in (("tsdf", 1), ("weight", 1), ("color", 3))
            ),
        )

    def surface(self) -> NearSurface:
        """All surfaces that enough frames saw, and of which one was near enough: at the end of its
        range a camera tells only what noise brought nearer."""
        if not self.frames:
            return NearSurface.none(self._rules.voxel_m)
        mesh = self._grid.extract_triangle_mesh(weight_threshold=_LEAST_WEIGHT)
        if not len(mesh.triangle.indices):
            return NearSurface.none(self._rules.voxel_m)
        own2, shared2, looks = mesh.vertex.colors.numpy().astype(float).T * _COLOUR
        kept = looks > self._rules.least_looks - 0.5  # interpolated between whole numbers
        vertices = mesh.vertex.positions.numpy()
        kept[kept] = within_reach(vertices[kept], self._views, self._sensor.sure_m)
        sigma = np.sqrt(np.maximum(own2 + shared2, 0.0)).astype(np.float32)
        return NearSurface.of(
            vertices, mesh.triangle.indices.numpy(), sigma, kept, self._rules.voxel_m
        )

    @property
    def _unit_m(self) -> float:
        """What a signed distance of 1 in the grid is."""
        return self._rules.truncation_voxels * self._rules.voxel_m

    def _open_blocks(self, depth: np.ndarray, frame: DepthFrame):
        """Keys (tensor, M x 3) of the blocks around a frame's depths, as far as these count; now in
        the grid.

        Open3D's own search takes one truncation for all depths, and raises where few pixels have
        one.
        """
        depth, rays = depth[::_STRIDE, ::_STRIDE], frame.camera.rays()[::_STRIDE, ::_STRIDE]
        known = np.isfinite(depth)
        z, rays = depth[known].astype(float), rays[known] @ frame.T_home_cam[:3, :3].T
        reach = np.maximum(self._unit_m, self._rules.truncation_sigmas * self._sensor.noise_m(z))
        edge_m = _BLOCK * self._rules.voxel_m
        steps = np.linspace(-1.0, 1.0, 2 + int(np.ceil(4.0 * reach.max(initial=0.0) / edge_m)))
        along = np.maximum(z[:, None] + steps * reach[:, None], 0.0)
        places = frame.T_home_cam[:3, 3] + along[..., None] * rays[:, None, :]
        keys = _unique_rows(np.floor(places.reshape(-1, 3) / edge_m).astype(np.int64))
        keys = self._core.Tensor(keys.astype(np.int32))
        self._grid.hashmap().activate(keys)
        return keys


def _unique_rows(keys: np.ndarray) -> np.ndarray:
    """Rows (M,3) of whole numbers (N,3), each once."""
    least = keys.min(axis=0)
    size = keys.max(axis=0) - least + 1
    x, y, z = (keys - least).T
    flat = np.unique((x * size[1] + y) * size[2] + z)
    return (
        np.stack([flat // (size[1] * size[2]), flat // size[2] % size[1], flat % size[2]], axis=-1)
        + least
    )
