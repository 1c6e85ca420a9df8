# SPDX-License-Identifier: Apache-2.0
"""What tracking knows, for rviz: three-sigma ellipsoids of the cameras, the calibration's residuals
per link, and what cameras, gimbals and mocap see."""

from typing import Dict, List, Optional, Tuple

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseWithCovarianceStamped, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from fcsv_geometry import frames, transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Calibration, CalibrationLink
from fcsv_tracking.scene.shared_view import corners

_SIGMAS = 3.0
_LEAST_M = 0.01  # a smaller ellipsoid cannot be seen
_GIMBAL_REACH_M, _MOCAP_REACH_M = 4.0, 7.0  # tags of 8 cm (thesis 4.2), markers of a V120 Duo
_GOOD_YAW_DEG, _POOR_YAW_DEG = 0.2, 0.6


def tracking_markers(
    cameras: Dict[str, PoseWithCovarianceStamped], calibration: Optional[Calibration]
) -> MarkerArray:
    """All in home; vehicles by name. A link is drawn where both of its cameras are known."""
    markers: List[Marker] = [
        ellipsoid(k, name, pose) for k, (name, pose) in enumerate(sorted(cameras.items()))
    ]
    for k, link in enumerate(calibration.links if calibration else []):
        if link.parent in cameras and link.child in cameras:
            ends = [cameras[n].pose.pose.position for n in (link.parent, link.child)]
            markers += [_line(k, link, ends), _label(k, link, ends)]
    return MarkerArray(markers)


def ellipsoid(number: int, name: str, pose: PoseWithCovarianceStamped) -> Marker:
    """Where the camera is with 97 % (three sigma in three dimensions), along the covariance's own
    axes."""
    covariance = np.reshape(pose.pose.covariance, (6, 6))[:3, :3]
    variances, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    axes[:, 0] *= np.linalg.det(axes)  # right-handed
    marker = marker_in_home(
        f"covariance of {name}", number, Marker.SPHERE, ColorRGBA(0.95, 0.85, 0.2, 0.45)
    )
    q = conversions.transform_to_pose(transforms.transform(axes, np.zeros(3))).orientation
    marker.pose = Pose(pose.pose.pose.position, q)
    lengths = np.maximum(2.0 * _SIGMAS * np.sqrt(np.maximum(variances, 0.0)), _LEAST_M)
    marker.scale = Vector3(*lengths)
    return marker


def view(
    namespace: str, number: int, frame: str, tangents: Tuple[float, float], reach_m: float, color
) -> Marker:
    """A pyramid of lines that rviz keeps locked to an optical frame: what is seen up to ``reach_m``
    along its z.

    ``tangents`` of half the field of view, across and down.
    """
    marker = marker_in_home(namespace, number, Marker.LINE_LIST, color)
    marker.header.frame_id, marker.frame_locked, marker.scale.x = frame, True, 0.03
    ends = reach_m * corners(tangents)
    for a, b in zip(ends, np.roll(ends, -1, axis=0)):
        marker.points += [Point(0, 0, 0), Point(*a), Point(*a), Point(*b)]
    return marker


def gimbal_views(cameras: Dict[str, PinholeCamera]) -> List[Marker]:
    """What the gimbals' cameras see, by the vehicle that each follows."""
    views = []
    for k, (name, c) in enumerate(sorted(cameras.items())):
        tangents = (0.5 * c.width / c.fx, 0.5 * c.height / c.fy)
        color = ColorRGBA(0.4, 0.9, 0.9, 0.8)
        views.append(
            view("gimbal views", k, frames.gimbal_optical(name), tangents, _GIMBAL_REACH_M, color)
        )
    return views


def mocap_view(frame: str, fov_deg: Tuple[float, float]) -> Marker:
    """What a mocap sees; its frame has x out of the lenses."""
    tangents = (
        float(np.tan(np.radians(fov_deg[0] / 2))),
        float(np.tan(np.radians(fov_deg[1] / 2))),
    )
    marker = view("mocap view", 0, frame, tangents, _MOCAP_REACH_M, ColorRGBA(0.9, 0.5, 0.9, 0.8))
    marker.pose = conversions.transform_to_pose(
        transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
    )
    return marker


def _line(number: int, link: CalibrationLink, ends: List[Point]) -> Marker:
    """Draws a line from camera to camera, green where the yaw between them is sharp, red where it
    is not."""
    share = np.clip(
        (_yaw_std_deg(link) - _GOOD_YAW_DEG) / (_POOR_YAW_DEG - _GOOD_YAW_DEG), 0.0, 1.0
    )
    color = ColorRGBA(float(share), float(1.0 - share), 0.2, 0.9)
    marker = marker_in_home("calibration", number, Marker.LINE_LIST, color)
    marker.scale.x, marker.points = 0.03, ends
    return marker


def _label(number: int, link: CalibrationLink, ends: List[Point]) -> Marker:
    marker = marker_in_home(
        "residuals", number, Marker.TEXT_VIEW_FACING, ColorRGBA(1.0, 1.0, 1.0, 1.0)
    )
    middle = [0.5 * (getattr(ends[0], a) + getattr(ends[1], a)) for a in "xyz"]
    marker.pose.position, marker.scale.z = Point(middle[0], middle[1], middle[2] + 0.5), 0.4
    marker.text = (
        f"{link.child} > {link.parent}: {link.used} used, {link.rejected} rejected\n"
        f"{link.reprojection_rms_px:.2f} px, spread {link.position_spread_m * 100:.1f} cm, "
        f"yaw {_yaw_std_deg(link):.2f} deg"
    )
    return marker


def _yaw_std_deg(link: CalibrationLink) -> float:
    return float(np.degrees(np.sqrt(max(link.covariance[15], 0.0))))


def marker_in_home(namespace: str, number: int, kind: int, color: ColorRGBA) -> Marker:
    """Makes a marker at home's origin, without a size."""
    marker = Marker(
        header=conversions.header(0.0, frames.HOME), ns=namespace, id=number, type=kind, color=color
    )
    marker.pose.orientation = Quaternion(0, 0, 0, 1)
    return marker
