# SPDX-License-Identifier: Apache-2.0
"""Depth frames summed in home: signed distances to the nearest surface, in blocks of voxels where something stands.

Open3D's voxel block grid holds the blocks and extracts the surface. The sum is our own: Open3D's
counts every frame alike, ours by 1/sigma**2 of its depth and pose there.
"""

from dataclasses import dataclass
from typing import Optional

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.config import require_positive
from fcsv_stereo.errors import InputError
from fcsv_stereo.near.frame import DepthFrame
from fcsv_stereo.near.sensor import DepthSensor
from fcsv_stereo.near.summing import add_frame
from fcsv_stereo.near.surface import NearSurface

_BLOCK = 8  # voxels along the edge of one
_BLOCKS = 4096  # at first; the grid grows
_BANDS_M = (0.0, 4.0, 6.0, 8.0, np.inf)  # depths that share how far around them blocks are opened
_LEAST_WEIGHT = 1e-3  # 1/m2: whatever was looked at
_COLOUR = 255.0  # what open3d divides it by


@dataclass(frozen=True)
class NearRules:
    """``voxel_m``: points lie so far apart. ``truncation_voxels``, ``truncation_sigmas``: how far before and behind a
    depth it counts, the larger of both. ``least_looks``: frames that must have seen a surface."""

    voxel_m: float = 0.05
    truncation_voxels: float = 4.0
    truncation_sigmas: float = 3.0
    least_looks: int = 3

    def __post_init__(self):
        require_positive(self)


class NearVolume:
    """Frames in, a surface out. Raises InputError where open3d is not installed."""

    def __init__(self, sensor: Optional[DepthSensor] = None, rules: Optional[NearRules] = None):
        try:
            import open3d  # a heavy import, which the wheel and maps without a near field do without
        except ImportError as error:
            raise InputError("open3d is not installed: pip install open3d, or map with --no-near") from error
        self._o3d, self._core = open3d, open3d.core
        self._sensor, self._rules = sensor or DepthSensor(), rules or NearRules()
        f32 = self._core.float32
        # extraction interpolates and hands out one attribute besides, by this name (see ``summing``)
        names, channels = ("tsdf", "weight", "color"), ((1), (1), (3))
        self._grid = open3d.t.geometry.VoxelBlockGrid(
            names, (f32, f32, f32), channels, self._rules.voxel_m, _BLOCK, _BLOCKS, self._core.Device("CPU:0")
        )
        self.frames = 0

    def integrate(self, frame: DepthFrame) -> None:
        """Add one frame; one without a depth that can be believed changes nothing."""
        depth = frame.believed(self._sensor)
        if not np.isfinite(depth).any():
            return
        self.frames += 1
        T_cam_home = transforms.invert(frame.T_home_cam)
        keys = self._open_blocks(depth, frame.camera, T_cam_home)
        indices, _ = self._grid.hashmap().find(keys)
        xyz, flat = self._grid.voxel_coordinates_and_flattened_indices(indices)
        noise2 = np.square(self._sensor.noise_m(depth))
        shared2 = frame.pose_variance_m2(depth) + np.square(self._sensor.offset_m(depth))
        camera, rules = frame.camera, self._rules
        add_frame(
            xyz.numpy(), flat.numpy(), T_cam_home, np.array([camera.fx, camera.fy, camera.cx, camera.cy]), depth,
            noise2.astype(np.float32), shared2.astype(np.float32), self._unit_m, rules.truncation_sigmas,
            *(self._grid.attribute(n).numpy().reshape(-1, c) for n, c in (("tsdf", 1), ("weight", 1), ("color", 3))),
        )  # fmt: skip

    def surface(self) -> NearSurface:
        """All surfaces that enough frames saw."""
        if not self.frames:
            return NearSurface.none(self._rules.voxel_m)
        mesh = self._grid.extract_triangle_mesh(weight_threshold=_LEAST_WEIGHT)
        if not len(mesh.triangle.indices):
            return NearSurface.none(self._rules.voxel_m)
        own2, shared2, looks = mesh.vertex.colors.numpy().astype(float).T * _COLOUR
        kept = looks > self._rules.least_looks - 0.5  # interpolated between whole numbers
        sigma = np.sqrt(np.maximum(own2 + shared2, 0.0)).astype(np.float32)
        return NearSurface.of(
            mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy(), sigma, kept, self._rules.voxel_m
        )

    @property
    def _unit_m(self) -> float:
        """What a signed distance of 1 in the grid is."""
        return self._rules.truncation_voxels * self._rules.voxel_m

    def _open_blocks(self, depth: np.ndarray, camera: PinholeCamera, T_cam_home: np.ndarray):
        """Keys (tensor, M x 3) of the blocks around a frame's depths, now in the grid."""
        tensor, found = self._core.Tensor, []
        for near_m, far_m in zip(_BANDS_M, _BANDS_M[1:]):
            band = np.where((depth >= near_m) & (depth < far_m), depth, np.float32(0.0))
            if not band.any():
                continue
            sigmas_m = self._rules.truncation_sigmas * float(self._sensor.noise_m(min(far_m, self._sensor.most_m)))
            voxels = max(self._rules.truncation_voxels, sigmas_m / self._rules.voxel_m)
            image = self._o3d.t.geometry.Image(tensor(np.ascontiguousarray(band)))
            found.append(
                self._grid.compute_unique_block_coordinates(
                    image, tensor(camera.K), tensor(T_cam_home), 1.0, float(self._sensor.most_m), voxels
                ).numpy()
            )
        keys = tensor(np.unique(np.concatenate(found), axis=0))
        self._grid.hashmap().activate(keys)
        return keys
