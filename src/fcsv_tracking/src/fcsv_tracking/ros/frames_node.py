# SPDX-License-Identifier: Apache-2.0
"""tf2 on every machine, and the pose of every camera in home, from what this machine hears."""

import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List

import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros import telemetry_messages as telemetry
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_msgs.msg import Calibration, Home
from fcsv_tracking.column.camera_covariance import AgeRules
from fcsv_tracking.errors import TrackingError
from fcsv_tracking.frames_port import BodyAt, CameraAt, FramesPort, OdometryCame, OdomsInHome
from fcsv_tracking.ros.camera_message import camera_message
from fcsv_tracking.ros.static_frames import fixed_parts


@dataclass(frozen=True)
class FramesParameters:
    """Parameters of the node. ``rate_hz`` is for people and rviz: what needs every pose hears the
    odometry itself."""

    vehicles: List[str]
    vehicles_dir: str
    rate_hz: float = 15.0
    tracker_profile: str = ""  # config/trackers/NAME.yaml; empty: the T265 as TrackerProfile has it
    age: AgeRules = field(default_factory=AgeRules)

    def __post_init__(self):
        if not 1.0 <= self.rate_hz <= 200.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..200")


class FramesNode:
    """Poses in, tf2 and cameras out."""

    def __init__(self):
        p = node.parameters(FramesParameters)
        vehicles, tracker = (
            node.vehicles(p.vehicles_dir, p.vehicles),
            load_profile(p.tracker_profile),
        )
        self._port, self._lock = FramesPort(vehicles, tracker, p.rate_hz, p.age), threading.RLock()
        self._health = Health("frames", {f"odometry of {n}": 1.0 for n in p.vehicles})
        self._tf = tf2_ros.TransformBroadcaster()
        self._static = tf2_ros.StaticTransformBroadcaster()
        self._static.sendTransform([t for v in vehicles.values() for t in fixed_parts(v, tracker)])
        self._cameras = {
            n: rospy.Publisher(f"/{n}/camera_pose", PoseWithCovarianceStamped, queue_size=5)
            for n in p.vehicles
        }
        self._publish: Dict[type, Callable[[Any], None]] = {
            BodyAt: self._body,
            CameraAt: self._camera,
            OdomsInHome: self._odoms,
            tm.Diagnosis: self._health.diagnose,
            tm.Dropped: lambda m: self._health.drop(m.what, m.why),
        }
        self._timer = node.every(0.1, lambda _event: self._step())
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        rospy.Subscriber("/home", Home, self._on_home, queue_size=1)
        for name in p.vehicles:
            rospy.Subscriber(
                f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=5
            )

    def _on_calibration(self, message: Calibration) -> None:
        self._receive("calibration", lambda: telemetry.calibration_of(message))

    def _on_home(self, message: Home) -> None:
        self._receive("home", lambda: telemetry.home_of(message))

    def _on_odometry(self, message: Odometry, name: str) -> None:
        self._receive("odometry", lambda: odometry_of(name, message))

    def _receive(self, what: str, take: Callable[[], object]) -> None:
        try:
            data = take()
        except FcsvError as error:
            self._health.drop(what, str(error))
            return
        with self._lock:
            self._port.receive(time.monotonic(), data)
            self._step()

    def _step(self) -> None:
        with self._lock:
            for output in self._port.step(time.monotonic()):
                self._publish[type(output)](output)

    def _body(self, m: BodyAt) -> None:
        self._health.tick(f"odometry of {m.vehicle}")
        odom, body = frames.odom(m.vehicle), frames.base_link(m.vehicle)
        self._tf.sendTransform(conversions.transform_stamped(m.T_odom_body, m.stamp_s, odom, body))

    def _camera(self, m: CameraAt) -> None:
        self._cameras[m.vehicle].publish(camera_message(m.stamp_s, m.T_home_cam, m.covariance))

    def _odoms(self, m: OdomsInHome) -> None:
        stamp_s = rospy.get_time()
        self._tf.sendTransform(
            [
                conversions.transform_stamped(T, stamp_s, frames.HOME, frames.odom(n))
                for n, T in m.T_home_odom.items()
            ]
        )


def odometry_of(name: str, m: Odometry) -> OdometryCame:
    """Raises FcsvError, naming the vehicle, where the pose is none."""
    try:
        T_odom_body = conversions.pose_to_transform(m.pose.pose)
    except FcsvError as error:
        raise TrackingError(f"{name}: {error}") from error
    named = (m.header.frame_id, m.child_frame_id)
    return OdometryCame(name, named, m.header.stamp.to_sec(), T_odom_body, m.pose.covariance)


def main() -> int:
    """Run the node."""
    return node.run("frames", FramesNode)
