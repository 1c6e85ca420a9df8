# SPDX-License-Identifier: Apache-2.0
"""What a camera sees of a mesh, by Open3D's rays: of the truth, and of the near field."""

import sys
from types import ModuleType
from typing import Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError

_LEARNING = "open3d.ml"  # more than half of the import, and used by nothing here


def open3d():
    """The library: a heavy import, which the wheel and most maps do without. Raises InputError
    where it is missing."""
    first = "open3d" not in sys.modules
    if first:
        sys.modules[_LEARNING] = ModuleType(_LEARNING)
    try:
        import open3d as library
    except ImportError as error:
        raise InputError("open3d is not installed: pip install open3d") from error
    finally:
        if first:
            del sys.modules[_LEARNING]  # who imports it still gets it
    return library


def scene_of(mesh):
    """Makes the scene of an ``open3d.t.geometry.TriangleMesh``, ready for rays."""
    scene = open3d().t.geometry.RaycastingScene()
    scene.add_triangles(mesh)
    return scene


def cast(scene, T_mesh_cam: np.ndarray, camera: PinholeCamera) -> Tuple[np.ndarray, np.ndarray]:
    """Depth (H,W float32, m along the optical axis), NaN where nothing is hit; the triangles (H,W)
    that are hit."""
    directions = camera.rays() @ T_mesh_cam[:3, :3].T  # length 1 along z: the hit distance is depth
    origins = np.broadcast_to(T_mesh_cam[:3, 3], directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    hits = scene.cast_rays(open3d().core.Tensor(rays))
    depth = hits["t_hit"].numpy()
    depth[~np.isfinite(depth)] = np.nan
    return depth, hits["primitive_ids"].numpy()
