# SPDX-License-Identifier: Apache-2.0
"""The site as a mesh with colours (glTF, .glb): depths that are surer than a bound, integrated in a
truncated signed distance (Curless, Levoy 1996; Open3D), so that walls stay and nothing is closed
over what no view saw."""

from pathlib import Path
from typing import Any, Iterable, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError, SurveyError
from fcsv_stereo.evaluating.raycast import open3d
from fcsv_stereo.survey.surface.merge import SiteView

#: Side of a cube over the bound, and how far behind a depth its surface reaches over it.
_VOXEL_SHARE, _REACH_SHARE = 0.5, 2.0
_MOST_VOXELS = 1 << 26  # that surfaces touch: a GB
_BLOCK = 16  # cubes along a block's side
_LEAST_TRIANGLES = 50  # of a piece: smaller ones are noise, as pixels alone
#: glTF's y is up, and x to the right: from the site's axes
_T_GLTF_SITE = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])


def check_libraries() -> None:
    """Raises SurveyError where Open3D or trimesh is not installed."""
    _libraries()


def write_mesh(views: Iterable[SiteView], path: Path, bound_m: float) -> int:
    """The mesh of all depths whose sigma is below ``bound_m``, in the site's metres less its
    origin; the number of its triangles.

    Raises SurveyError where there are none or too many, OSError where the disk does not take it.
    """
    o3d, trimesh = _libraries()
    voxel_m = _VOXEL_SHARE * bound_m
    volume = o3d.pipelines.integration.ScalableTSDFVolume(
        voxel_length=voxel_m,
        sdf_trunc=_REACH_SHARE * bound_m,
        color_type=o3d.pipelines.integration.TSDFVolumeColorType.RGB8,
        volume_unit_resolution=_BLOCK,
        depth_sampling_stride=1,
    )
    sure = 0
    for seen in views:
        with np.errstate(invalid="ignore"):
            depth = np.where(seen.sigma < bound_m, seen.depth, 0.0).astype(np.float32)
        depth = np.nan_to_num(depth)
        sure += int((depth > 0).sum())
        _require_room(depth, seen, voxel_m, bound_m)
        if (depth > 0).any():
            volume.integrate(*_picture(o3d, seen, depth))
    if not sure:
        raise SurveyError(
            f"no depth is surer than {bound_m:g} m, so there is no mesh; give a larger --mesh-sigma-m"
        )
    mesh = _cleaned(volume.extract_triangle_mesh())
    if not len(mesh.triangles):
        raise SurveyError(f"what is surer than {bound_m:g} m is no surface, so there is no mesh")
    mesh.transform(_T_GLTF_SITE)
    mesh.compute_vertex_normals()
    made = trimesh.Trimesh(
        np.asarray(mesh.vertices),
        np.asarray(mesh.triangles),
        vertex_normals=np.asarray(mesh.vertex_normals),
        vertex_colors=np.rint(255 * np.asarray(mesh.vertex_colors)).astype(np.uint8),
        process=False,
    )
    path.write_bytes(made.export(file_type="glb"))
    return len(mesh.triangles)


def _libraries() -> Tuple[Any, Any]:
    """Open3D makes the mesh; its glTF is wrong, so trimesh writes it."""
    try:
        import trimesh

        return open3d(), trimesh
    except (ImportError, InputError) as error:
        raise SurveyError(
            f"the product mesh needs open3d and trimesh ({error}); install them: pip install open3d trimesh"
        ) from error


def _require_room(depth: np.ndarray, seen: SiteView, voxel_m: float, bound_m: float) -> None:
    """Raises SurveyError where a view's surfaces touch too many cubes."""
    f = seen.camera.fx
    area = float((np.square(depth[depth > 0] / f)).sum())  # m2, seen straight on
    if area / voxel_m**2 * (2 * _REACH_SHARE / _VOXEL_SHARE) > _MOST_VOXELS:
        raise SurveyError(
            f"a mesh with cubes of {voxel_m:g} m, half of --mesh-sigma-m {bound_m:g}, is too large; give a larger one"
        )


def _picture(o3d: Any, seen: SiteView, depth: np.ndarray) -> Any:
    c = seen.camera
    rgbd = o3d.geometry.RGBDImage.create_from_color_and_depth(
        o3d.geometry.Image(np.ascontiguousarray(seen.view.image)),
        o3d.geometry.Image(np.ascontiguousarray(depth)),
        depth_scale=1.0,
        depth_trunc=float(depth.max()) + 1.0,
        convert_rgb_to_intensity=False,
    )
    intrinsic = o3d.camera.PinholeCameraIntrinsic(c.width, c.height, c.fx, c.fy, c.cx, c.cy)
    return rgbd, intrinsic, transforms.invert(seen.T_site_cam)


def _cleaned(mesh: Any) -> Any:
    """The mesh without pieces of a few triangles."""
    of, counts, _ = mesh.cluster_connected_triangles()
    small = np.asarray(counts)[np.asarray(of, int)] < _LEAST_TRIANGLES
    mesh.remove_triangles_by_mask(small)
    mesh.remove_unreferenced_vertices()
    return mesh
