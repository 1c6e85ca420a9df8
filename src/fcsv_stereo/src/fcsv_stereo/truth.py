# SPDX-License-Identifier: Apache-2.0
"""Truth, where it is known: a triangle mesh and true camera poses (docs/decisions/0001)."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import ImageEntry, Reference

_SAME_STAMP_S = 1e-3


@dataclass(frozen=True)
class Truth:
    """``cameras``: true T_world_cam by vehicle and stamp in milliseconds."""

    mesh_path: Path
    cameras: Dict[Tuple[str, int], np.ndarray]

    def T_world_cam(self, vehicle: str, stamp_s: float) -> np.ndarray:
        """True pose of a picture. Raises InputError where it is not in cameras.csv."""
        key = round(stamp_s * 1000)
        for near in (key, key - 1, key + 1):
            if (vehicle, near) in self.cameras:
                return self.cameras[vehicle, near]
        raise InputError(f"{self.mesh_path.parent / 'cameras.csv'}: no pose of {vehicle} at {stamp_s:.3f} s")

    def depth(self, reference: Reference) -> np.ndarray:
        """True depth (H,W float32, m along the optical axis, NaN where the sky is) of the reference picture."""
        try:
            import open3d as o3d  # only where truth is: a heavy import, which the wheel does without
        except ImportError as error:
            raise InputError("open3d is not installed: pip install open3d") from error

        if not self.mesh_path.is_file():
            raise InputError(f"{self.mesh_path}: does not exist; truth/ needs scene.ply and cameras.csv")
        mesh = o3d.t.io.read_triangle_mesh(str(self.mesh_path))
        if len(mesh.triangle.indices) == 0:
            raise InputError(f"{self.mesh_path}: holds no triangles")
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(mesh)
        T_world_cam = self.T_world_cam(reference.vehicle, reference.stamp_s)
        directions = reference.camera.rays() @ T_world_cam[:3, :3].T  # length 1 along z: the hit distance is depth
        origins = np.broadcast_to(T_world_cam[:3, 3], directions.shape)
        rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
        depth = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
        depth[~np.isfinite(depth)] = np.nan
        return depth

    def relative_errors(self, reference: Reference, image: ImageEntry) -> Tuple[float, float]:
        """Rotation error (deg) and position error (m) of a picture's pose relative to the reference picture."""
        true = transforms.invert(self.T_world_cam(reference.vehicle, reference.stamp_s))
        true = true @ self.T_world_cam(image.vehicle, image.stamp_s)
        found = transforms.invert(reference.T_home_cam) @ image.T_home_cam
        angle = transforms.rotation_angle(true, found)
        return float(np.degrees(angle)), float(np.linalg.norm(true[:3, 3] - found[:3, 3]))


def load_truth(folder: Path) -> Truth:
    """From ``folder``/scene.ply and cameras.csv. Raises InputError naming the line that is wrong."""
    path = Path(folder) / "cameras.csv"
    cameras = {}
    try:
        with open(path, newline="") as file:
            for number, row in enumerate(csv.DictReader(file), 2):
                try:
                    p = [float(row[k]) for k in ("x", "y", "z")]
                    q = [float(row[k]) for k in ("qx", "qy", "qz", "qw")]
                    key = (row["vehicle"], round(float(row["stamp_s"]) * 1000))
                    cameras[key] = transforms.from_xyz_quaternion(p, q)
                except (KeyError, TypeError, ValueError, GeometryError) as error:
                    raise InputError(f"{path}, line {number}: not a camera pose ({error})") from error
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); truth/ needs scene.ply and cameras.csv"
        ) from error
    return Truth(Path(folder) / "scene.ply", cameras)
