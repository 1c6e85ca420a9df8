# SPDX-License-Identifier: Apache-2.0
"""What a mission plans, for rviz: home, fence, places of its configurations, and what two cameras
both see. In home."""

from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from fcsv_geometry import transforms
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.ros import conversions
from fcsv_tracking.mission_view import PlannedPlace, fence_lines, planned_places
from fcsv_tracking.ros.tracking_markers import marker_in_home
from fcsv_tracking.scene.shared_view import shared_view

_REACH_M = 30.0  # where views are cut: baselines of 10 m begin to share theirs at 9.4 m
_TOGETHER_S = 1.0  # poses further apart tell nothing of one moment
_AXES_M, _ARROW_M, _LINE_M = 1.5, 1.0, 0.05
TEXT_M = 0.7  # height of letters, as vehicle_markers.NAME_M
_FENCE, _PLACE, _RUNNING = (
    ColorRGBA(0.84, 0.37, 0.0, 0.7),
    ColorRGBA(0.8, 0.8, 0.8, 0.9),
    ColorRGBA(0.0, 0.62, 0.45, 1),
)
_SHARED = ColorRGBA(0.94, 0.89, 0.26, 0.8)


def mission_markers(
    mission: Optional[Mission],
    running: Optional[int],
    cameras: Dict[str, PoseWithCovarianceStamped],
    tangents: Tuple[float, float],
) -> MarkerArray:
    """Draws the mission in place of all that was drawn before. ``running``: index of the
    configuration that is flown; ``cameras`` in home, by vehicle; ``tangents`` of half their field
    of view, across and down."""
    markers = [Marker(action=Marker.DELETEALL), *home_markers()]
    if mission is not None:
        markers.append(fence_marker(mission))
        for place in planned_places(mission):
            markers += place_markers(place, place.index == running)
        markers += overlap_markers(mission.reference, cameras, tangents)
    return MarkerArray(markers)


def home_markers() -> List[Marker]:
    """Its axes, x red, y green, z blue, and its name."""
    axes = marker_in_home("home", 0, Marker.LINE_LIST, ColorRGBA(1, 1, 1, 1))
    axes.scale.x = _LINE_M
    for k in range(3):
        color = ColorRGBA(*np.eye(3)[k], 1.0)
        axes.points += [Point(), Point(*(_AXES_M * np.eye(3)[k]))]
        axes.colors += [color, color]
    return [axes, _text("home", 1, "home", (0.0, 0.0, -0.8), ColorRGBA(1, 1, 1, 1))]


def fence_marker(mission: Mission) -> Marker:
    """Draws the fence as if home were as high above the take-off place as the mission asks for."""
    marker = marker_in_home("fence", 0, Marker.LINE_LIST, _FENCE)
    marker.scale.x = 2.0 * _LINE_M
    marker.points = [
        Point(*p) for p in fence_lines(mission.fence, mission.home_height_m).reshape(-1, 3)
    ]
    return marker


def place_markers(place: PlannedPlace, running: bool) -> List[Marker]:
    """An arrow where the camera looks, its number in the list below it (places stand 2 m apart), of
    a sweep its way."""
    color = _RUNNING if running else _PLACE
    arrow = marker_in_home("planned places", 2 * place.index, Marker.ARROW, color)
    arrow.pose = conversions.transform_to_pose(
        place.T_home_cam @ transforms.transform(transforms.R_FLU_OPTICAL.T, np.zeros(3))
    )
    arrow.scale = Vector3(_ARROW_M, 0.12, 0.12)
    x, y, z = place.T_home_cam[:3, 3]
    markers = [
        arrow,
        _text("planned places", 2 * place.index + 1, str(place.index + 1), (x, y, z - 0.8), color),
    ]
    if place.end_m is not None:
        way = marker_in_home("sweeps", place.index, Marker.LINE_LIST, color)
        way.scale.x, way.points = 2.0 * _LINE_M, [Point(x, y, z), Point(*place.end_m)]
        markers.append(way)
    return markers


def overlap_markers(
    reference: str, cameras: Dict[str, PoseWithCovarianceStamped], tangents: Tuple[float, float]
) -> List[Marker]:
    """What the reference and each other camera both see, where both poses are of one moment."""
    markers: List[Marker] = []
    own = cameras.get(reference)
    for k, (name, pose) in enumerate(sorted(cameras.items())):
        if (
            own is None
            or name == reference
            or abs((own.header.stamp - pose.header.stamp).to_sec()) > _TOGETHER_S
        ):
            continue
        T_home_a, T_home_b = (conversions.pose_to_transform(p.pose.pose) for p in (own, pose))
        markers += _faces(k, shared_view(T_home_a, T_home_b, tangents, _REACH_M))
    return markers


def _faces(number: int, faces: Sequence[np.ndarray]) -> List[Marker]:
    if not faces:
        return []
    faint = ColorRGBA(_SHARED.r, _SHARED.g, _SHARED.b, 0.12)
    filled = marker_in_home("overlap", 2 * number, Marker.TRIANGLE_LIST, faint)
    edges = marker_in_home("overlap", 2 * number + 1, Marker.LINE_LIST, _SHARED)
    filled.scale, edges.scale.x = Vector3(1, 1, 1), _LINE_M
    for face in faces:
        corners = [Point(*p) for p in face]
        for a, b in zip(corners[1:], corners[2:]):
            filled.points += [corners[0], a, b]
        for a, b in zip(corners, [*corners[1:], corners[0]]):
            edges.points += [a, b]
    return [filled, edges]


def _text(
    namespace: str, number: int, words: str, p_home_m: Sequence[float], color: ColorRGBA
) -> Marker:
    marker = marker_in_home(namespace, number, Marker.TEXT_VIEW_FACING, color)
    marker.pose.position, marker.scale.z, marker.text = Point(*p_home_m), TEXT_M, words
    return marker
