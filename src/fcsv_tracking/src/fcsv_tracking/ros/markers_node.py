# SPDX-License-Identifier: Apache-2.0
"""Vehicles, what their cameras see, their tags, and what tracking knows, as markers for rviz."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from fcsv_geometry import frames
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import ConfigError, GeometryError
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Calibration, MissionState
from fcsv_tracking.mission_view import read_mission
from fcsv_tracking.ros.mission_markers import mission_markers
from fcsv_tracking.ros.static_frames import fixed_parts
from fcsv_tracking.ros.tracking_markers import gimbal_views, mocap_view, tracking_markers
from fcsv_tracking.ros.vehicle_markers import HALF_VIEW, assumed_place, vehicle_markers

_PERIOD_S = 0.5
#: A child of home, so that home is a frame before anything is known in it: rviz opens with it as
#: its fixed frame.
_EYE = "view"


@dataclass(frozen=True)
class FleetParameters:
    """Parameters of the node; the vehicles are a column, front first."""

    vehicles: List[str]
    vehicles_dir: str
    # across and up; none: there is no mocap to be drawn
    mocap_fov_deg: Optional[Tuple[float, float]] = None
    mocap_frame: str = "mocap"
    # tell where cameras and tags sit, too: a bag that is played told it before rviz listened
    fixed_parts: bool = False
    # before home is set, vehicles are drawn so far below it, and up from there
    home_height_m: float = 8.0

    def __post_init__(self):
        if not 0.0 <= self.home_height_m <= 500.0:
            raise ValueError(f"home_height_m: {self.home_height_m} is not in 0..500 m")
        if self.mocap_fov_deg and not all(0.0 < a < 170.0 for a in self.mocap_fov_deg):
            raise ValueError(f"mocap_fov_deg: {self.mocap_fov_deg} must both be in 0..170 degrees")


class MarkersNode:
    """Publishes twice a second; rviz keeps what is locked to its frame there. Vehicles are on
    /tracking/vehicles. On /tracking/markers are ellipsoids and the calibration's residuals in home,
    and once home is set what gimbals see, from their camera_info on, and the mocap. On
    /tracking/mission are home, fence and planned places of /mission/file, and what the cameras both
    see."""

    def __init__(self):
        self._parameters = node.parameters(FleetParameters)
        p = self._parameters
        self._fleet = node.vehicles(p.vehicles_dir, p.vehicles)
        self._cameras: Dict[str, PoseWithCovarianceStamped] = {}
        self._odometry: Dict[str, np.ndarray] = {}
        self._gimbals: Dict[str, PinholeCamera] = {}
        self._fixed = [mocap_view(p.mocap_frame, p.mocap_fov_deg)] if p.mocap_fov_deg else []
        self._calibration: Optional[Calibration] = None
        self._mission: Optional[Mission] = None
        self._running: Optional[int] = None
        self._health = Health("markers", {"camera poses": 0.0})
        self._static = tf2_ros.StaticTransformBroadcaster()
        fixed = [conversions.transform_stamped(np.eye(4), rospy.get_time(), frames.HOME, _EYE)]
        if p.fixed_parts:
            fixed += [part for vehicle in self._fleet.values() for part in fixed_parts(vehicle)]
        self._static.sendTransform(fixed)
        self._vehicles = rospy.Publisher(
            "/tracking/vehicles", MarkerArray, queue_size=1, latch=True
        )
        self._tracking = rospy.Publisher("/tracking/markers", MarkerArray, queue_size=1, latch=True)
        self._planned = rospy.Publisher("/tracking/mission", MarkerArray, queue_size=1, latch=True)
        rospy.Subscriber("/mission/file", String, self._on_mission, queue_size=1)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission_state, queue_size=1)
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        for name in self._fleet:
            topic = f"/{name}/camera_pose"
            rospy.Subscriber(topic, PoseWithCovarianceStamped, self._on_camera, name, queue_size=1)
            rospy.Subscriber(
                f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=1
            )
            rospy.Subscriber(
                f"/{name}/gimbal/camera/camera_info",
                CameraInfo,
                self._on_gimbal,
                name,
                queue_size=1,
            )
        self._timer = node.every(_PERIOD_S, self._publish)

    def _on_calibration(self, message: Calibration) -> None:
        self._calibration = message

    def _on_mission(self, message: String) -> None:
        try:
            self._mission = read_mission(message.data)
            self._health.problem("mission", "")
        except ConfigError as error:
            self._mission = None
            self._health.problem("mission", f"its fence and places are not drawn: {error}")

    def _on_mission_state(self, message: MissionState) -> None:
        self._running = (
            message.configuration if message.phase == MissionState.CONFIGURATIONS else None
        )

    def _on_camera(self, message: PoseWithCovarianceStamped, name: str) -> None:
        try:
            conversions.pose_to_transform(message.pose.pose)
        except GeometryError as error:
            self._health.drop(f"camera pose of {name}", str(error))
            return
        self._health.tick("camera poses")
        self._cameras[name] = message

    def _on_gimbal(self, message: CameraInfo, name: str) -> None:
        try:
            self._gimbals[name] = conversions.camera_from_info(message)
        except GeometryError as error:
            self._health.drop(f"gimbal's camera_info of {name}", str(error))

    def _on_odometry(self, message: Odometry, name: str) -> None:
        try:
            self._odometry[name] = conversions.pose_to_transform(message.pose.pose)
        except GeometryError as error:
            self._health.drop(f"odometry of {name}", str(error))

    def _publish(self, _event) -> None:
        cameras = dict(self._cameras)
        markers = tracking_markers(cameras, self._calibration)
        if cameras:  # before, their frames stand in no relation to home
            markers.markers += [*gimbal_views(dict(self._gimbals)), *self._fixed]
        self._tracking.publish(markers)
        drawn = []
        for number, (name, vehicle) in enumerate(self._fleet.items()):
            height_m, T_odom_body = self._parameters.home_height_m, self._odometry.get(name)
            assumed = None if name in cameras else assumed_place(number, height_m, T_odom_body)
            drawn += vehicle_markers(vehicle, number, assumed)
        self._vehicles.publish(MarkerArray(drawn))
        self._planned.publish(mission_markers(self._mission, self._running, cameras, HALF_VIEW))


def main() -> int:
    """Run the node."""
    return node.run("markers", MarkersNode)
