# SPDX-License-Identifier: Apache-2.0
"""Vehicles, what their cameras see, and their tags, as markers for rviz."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, PoseWithCovarianceStamped, Quaternion, Vector3
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from fcsv_geometry import frames
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_msgs.msg import Calibration
from fcsv_tracking.ros.tracking_markers import gimbal_views, mocap_view, tracking_markers, view

_COLORS = ((0.95, 0.35, 0.2), (0.2, 0.55, 0.95), (0.3, 0.8, 0.3), (0.9, 0.75, 0.2))
_FRUSTUM_M = 2.0
_HALF_VIEW = (np.tan(np.radians(28.0)), np.tan(np.radians(21.7)))  # 56 x 43.5 degrees


@dataclass(frozen=True)
class FleetParameters:
    """Parameters of the node; the vehicles are a column, front first."""

    vehicles: List[str]
    vehicles_dir: str
    mocap_fov_deg: Optional[Tuple[float, float]] = None  # across and up; none: there is no mocap to be drawn
    mocap_frame: str = "mocap"

    def __post_init__(self):
        if self.mocap_fov_deg and not all(0.0 < a < 170.0 for a in self.mocap_fov_deg):
            raise ValueError(f"mocap_fov_deg: {self.mocap_fov_deg} must both be in 0..170 degrees")


def vehicle_markers(vehicle: VehicleGeometry, color) -> MarkerArray:
    """Body, frustum and tag of one vehicle, fixed in its own frames."""
    n = vehicle.name
    rgba = ColorRGBA(*color, 1.0)
    body = _marker(n, 0, Marker.CUBE, frames.base_link(n), ColorRGBA(*color, 0.9))
    body.scale = Vector3(0.36, 0.30, 0.12)
    tag = _marker(n, 1, Marker.CUBE, frames.tag(n), ColorRGBA(1, 1, 1, 1))
    tag.scale = Vector3(vehicle.tag_size_m, vehicle.tag_size_m, 0.005)
    sight = view(n, 2, frames.camera_optical(n), _HALF_VIEW, _FRUSTUM_M, rgba)
    label = _marker(n, 3, Marker.TEXT_VIEW_FACING, frames.base_link(n), rgba)
    label.pose.position.z, label.scale.z, label.text = 0.5, 0.4, n
    return MarkerArray([body, tag, sight, label])


def _marker(vehicle: str, number: int, kind: int, frame: str, color: ColorRGBA) -> Marker:
    marker = Marker(header=conversions.header(0.0, frame), ns=vehicle, id=number, type=kind, color=color)
    marker.pose, marker.frame_locked = Pose(Point(), Quaternion(0, 0, 0, 1)), True
    return marker


class MarkersNode:
    """Publishes once a second; rviz keeps the vehicles' markers locked to their frames. Ellipsoids and the
    calibration's residuals are in home, on /tracking/markers; there too what gimbals see, from their camera_info on,
    and the mocap."""

    def __init__(self):
        parameters = node.parameters(FleetParameters)
        vehicles = node.vehicles(parameters.vehicles_dir, parameters.vehicles)
        self._markers = [vehicle_markers(v, _COLORS[i % len(_COLORS)]) for i, v in enumerate(vehicles.values())]
        self._publishers = [rospy.Publisher(f"/{n}/markers", MarkerArray, queue_size=1, latch=True) for n in vehicles]
        self._cameras: Dict[str, PoseWithCovarianceStamped] = {}
        self._gimbals: Dict[str, PinholeCamera] = {}
        self._fixed = [mocap_view(parameters.mocap_frame, parameters.mocap_fov_deg)] if parameters.mocap_fov_deg else []
        self._calibration: Optional[Calibration] = None
        self._tracking = rospy.Publisher("/tracking/markers", MarkerArray, queue_size=1, latch=True)
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        for name in vehicles:
            topic = f"/{name}/camera_pose"
            rospy.Subscriber(topic, PoseWithCovarianceStamped, self._on_camera, name, queue_size=1)
            rospy.Subscriber(f"/{name}/gimbal/camera/camera_info", CameraInfo, self._on_gimbal, name, queue_size=1)
        self._timer = node.every(1.0, self._publish)

    def _on_calibration(self, message: Calibration) -> None:
        self._calibration = message

    def _on_camera(self, message: PoseWithCovarianceStamped, name: str) -> None:
        self._cameras[name] = message

    def _on_gimbal(self, message: CameraInfo, name: str) -> None:
        try:
            self._gimbals[name] = conversions.camera_from_info(message)
        except GeometryError as error:
            rospy.logwarn_throttle(30.0, f"{name}: its gimbal's view is not drawn: {error}")

    def _publish(self, _event) -> None:
        markers = tracking_markers(dict(self._cameras), self._calibration)
        markers.markers += [*gimbal_views(dict(self._gimbals)), *self._fixed]
        self._tracking.publish(markers)
        for publisher, markers in zip(self._publishers, self._markers):
            publisher.publish(markers)


def main() -> int:
    """Run the node."""
    return node.run("markers", MarkersNode)
