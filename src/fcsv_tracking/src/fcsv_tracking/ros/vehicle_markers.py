# SPDX-License-Identifier: Apache-2.0
"""Vehicles for rviz: body, field of view, tag and name, in their own frames or, before home is set,
as they stand."""

from typing import List, Optional

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from fcsv_geometry import frames, transforms
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_tracking.ros.tracking_markers import view

_COLORS = ((0.95, 0.35, 0.2), (0.2, 0.55, 0.95), (0.3, 0.8, 0.3), (0.9, 0.75, 0.2))
_FRUSTUM_M = 2.0
#: Tangents of half a camera's field of view, across and down: 56 x 43.5 degrees.
HALF_VIEW = (np.tan(np.radians(28.0)), np.tan(np.radians(21.7)))
NAME_M = 0.8  # height of letters: they are read at 1366 px from where rviz/map.rviz looks
_SPACING_M = 3.5  # of the column in which vehicles are drawn before home is set


def vehicle_markers(
    vehicle: VehicleGeometry, number: int, T_home_body: Optional[np.ndarray] = None
) -> List[Marker]:
    """Fixed in the vehicle's own frames; with ``T_home_body`` in home, pale, and called not
    known."""
    n, known = vehicle.name, T_home_body is None
    color = ColorRGBA(*_COLORS[number % len(_COLORS)], 1.0 if known else 0.4)
    body = _marker(n, 0, Marker.CUBE, frames.base_link(n), color, T_home_body, np.eye(4))
    body.scale = Vector3(0.36, 0.30, 0.12)
    white = ColorRGBA(1, 1, 1, color.a)
    tag = _marker(n, 1, Marker.CUBE, frames.tag(n), white, T_home_body, vehicle.T_body_tag)
    tag.scale = Vector3(vehicle.tag_size_m, vehicle.tag_size_m, 0.005)
    sight = view(n, 2, frames.camera_optical(n), HALF_VIEW, _FRUSTUM_M, color)
    if not known:
        _place(sight, T_home_body @ vehicle.T_body_cam)
    label = _marker(
        n, 3, Marker.TEXT_VIEW_FACING, frames.base_link(n), color, T_home_body, np.eye(4)
    )
    label.pose.position.z, label.scale.z = label.pose.position.z + 0.8, NAME_M
    label.text, label.color.a = n if known else f"{n}: home is not set", 1.0
    return [body, tag, sight, label]


def assumed_place(
    number: int, home_height_m: float, T_odom_body: Optional[np.ndarray]
) -> np.ndarray:
    """T_home_body to draw a vehicle at of which only its own odometry is known, if that: in a
    column behind home's place, from the ground up; where its odometry began is where the column has
    its place."""
    T_home_odom = transforms.from_xyz_yaw([-_SPACING_M * number, 0.0, -home_height_m], 0.0)
    return T_home_odom if T_odom_body is None else T_home_odom @ T_odom_body


def _marker(vehicle, number, kind, frame, color, T_home_body, T_body_part) -> Marker:
    marker = Marker(header=conversions.header(0.0, frame), ns=vehicle, id=number, type=kind)
    marker.color = ColorRGBA(color.r, color.g, color.b, color.a)
    marker.pose, marker.frame_locked = Pose(Point(), Quaternion(0, 0, 0, 1)), True
    if T_home_body is not None:
        _place(marker, T_home_body @ T_body_part)
    return marker


def _place(marker: Marker, T_home_part: np.ndarray) -> None:
    marker.header.frame_id, marker.frame_locked = frames.HOME, False
    marker.pose = conversions.transform_to_pose(T_home_part)
