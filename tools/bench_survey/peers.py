# SPDX-License-Identifier: Apache-2.0
"""Joins the same maps as others do: Open3D's multiway registration of rigid bodies (Choi, Zhou and
Koltun, CVPR 2015), as its documentation leads to it."""

from typing import Dict, List, Sequence

import numpy as np
import open3d as o3d

from bench_survey.truth import rays_of
from fcsv_geometry import transforms
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.edges.edge import Edge
from fcsv_stereo.survey.views.view import View

#: Voxels of the clouds (m); what may correspond, in voxels: at first, then.
_VOXEL_M = 1.0
_COARSE, _FINE = 4.0, 1.5
_PRUNE = 0.25
_registration = o3d.pipelines.registration


def multiway(views: Sequence[View], edges: Sequence[Edge]) -> Dict[str, object]:
    """S_site_cam (of scale 1) by view: point-to-plane ICP from the poses as flown, for each pair that
    the survey joined (of all that may overlap, most would be wrong); then the pose graph with its line
    process."""
    clouds = {v.name: _cloud(v) for v in views}
    number = {v.name: i for i, v in enumerate(views)}
    flown = {v.name: v.prior.T_site_cam for v in views}
    graph = _registration.PoseGraph()
    for v in views:
        graph.nodes.append(_registration.PoseGraphNode(flown[v.name]))
    for e in (e for e in edges if e.kept):
        T_b_a = transforms.invert(flown[e.b]) @ flown[e.a]
        T_b_a, information = _registered(clouds[e.a], clouds[e.b], T_b_a)
        follows = number[e.b] == number[e.a] + 1
        graph.edges.append(
            _registration.PoseGraphEdge(
                number[e.a], number[e.b], T_b_a, information, uncertain=not follows
            )
        )
    _registration.global_optimization(
        graph,
        _registration.GlobalOptimizationLevenbergMarquardt(),
        _registration.GlobalOptimizationConvergenceCriteria(),
        _registration.GlobalOptimizationOption(
            max_correspondence_distance=_FINE * _VOXEL_M,
            edge_prune_threshold=_PRUNE,
            reference_node=0,
        ),
    )
    poses: List[np.ndarray] = [np.asarray(node.pose) for node in graph.nodes]
    return {v.name: similarity.of_pose(T) for v, T in zip(views, poses)}


def _cloud(view: View):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(rays_of(view)[0]))
    cloud = cloud.voxel_down_sample(_VOXEL_M)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=4 * _VOXEL_M, max_nn=30))
    return cloud


def _registered(a, b, T_b_a: np.ndarray):
    plane = _registration.TransformationEstimationPointToPlane()
    for reach in (_COARSE, _FINE):
        found = _registration.registration_icp(a, b, reach * _VOXEL_M, T_b_a, plane)
        T_b_a = found.transformation
    information = _registration.get_information_matrix_from_point_clouds(
        a, b, _FINE * _VOXEL_M, T_b_a
    )
    return T_b_a, information
