# SPDX-License-Identifier: Apache-2.0
"""The control PC's tracker of thesis chapter 5: mocap_optitrack's poses and the vehicles' odometry
and IMU in, their odometry in one level frame and T_home_cam of every vehicle out, on the same
topics and frames as with others."""

import threading
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple

import message_filters
import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.mocap.rules import TrackerRules
from fcsv_tracking.mocap.system import CameraPose, MocapSystem
from fcsv_tracking.mocap.tracker import TrackedPose
from fcsv_tracking.ros.camera_message import camera_message
from fcsv_tracking.ros.ground_odometry import GroundOdometryPublisher
from fcsv_tracking.ros.home_service import HomeService
from fcsv_tracking.ros.static_frames import fixed_parts

_SAME_PACKET_S = 0.002


@dataclass(frozen=True)
class MocapTrackerParameters:
    """Parameters of the node. ``mocap_frame`` is mocap_optitrack's parent_frame_id."""

    vehicles: List[str]
    vehicles_dir: str
    rate_hz: float = 30.0
    mocap_frame: str = "mocap"
    rules: TrackerRules = field(default_factory=TrackerRules)

    def __post_init__(self):
        if not 1.0 <= self.rate_hz <= 200.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..200")


class MocapTrackerNode:
    """/mocap/NAME/pose, /NAME/tello/odom, /NAME/tello/imu -> /NAME/odometry/..., /NAME/camera_pose,
    tf, /home; services /calibrate and /set_home."""

    def __init__(self):
        self._parameters = parameters = node.parameters(MocapTrackerParameters)
        self._names = parameters.vehicles
        vehicles = node.vehicles(parameters.vehicles_dir, self._names)
        self._lock = threading.Lock()
        self._system = MocapSystem({n: v.T_body_cam for n, v in vehicles.items()}, parameters.rules)
        self._stamps_s: Dict[str, float] = dict.fromkeys(self._names, 0.0)
        self._health = Health(
            "mocap", {f"{n} {s}": 1.0 for n in self._names for s in ("mocap", "odometry", "pose")}
        )
        self._tf = tf2_ros.TransformBroadcaster()
        self._ground = GroundOdometryPublisher(self._names, parameters.mocap_frame)
        fixed = [t for v in vehicles.values() for t in fixed_parts(v)]
        self._cameras = {
            n: rospy.Publisher(f"/{n}/camera_pose", PoseWithCovarianceStamped, queue_size=5)
            for n in self._names
        }
        self._home = HomeService(self._names, parameters.mocap_frame, fixed, self._set_home)
        self._timer = node.every(1.0 / parameters.rate_hz, self._publish)
        self._slow_timer = node.every(1.0, self._report)
        self._pairs = [self._listen(n) for n in self._names]

    def _listen(self, name: str) -> message_filters.TimeSynchronizer:
        rospy.Subscriber(
            f"/mocap/{name}/pose",
            PoseStamped,
            self._on_mocap,
            name,
            queue_size=200,
            tcp_nodelay=True,
        )
        parts = [
            message_filters.Subscriber(
                f"/{name}/tello/odom", Odometry, queue_size=50, tcp_nodelay=True
            ),
            message_filters.Subscriber(f"/{name}/tello/imu", Imu, queue_size=50, tcp_nodelay=True),
        ]
        pair = message_filters.ApproximateTimeSynchronizer(
            parts, queue_size=50, slop=_SAME_PACKET_S
        )
        pair.registerCallback(self._on_packet, name)
        return pair

    def _on_mocap(self, message: PoseStamped, name: str) -> None:
        if message.header.frame_id != self._parameters.mocap_frame:
            self._health.drop(f"{name} mocap: wrong frame", message.header.frame_id)
            return
        p, q = message.pose.position, message.pose.orientation
        try:
            with self._lock:
                self._system.add_mocap(
                    name,
                    rospy.get_time(),
                    message.header.stamp.to_sec(),
                    (p.x, p.y, p.z),
                    (q.x, q.y, q.z, q.w),
                )
        except SampleRejected as error:
            rospy.logdebug("%s: %s", name, error)  # counted; Motive streams old poses for minutes
            return
        self._health.tick(f"{name} mocap")

    def _on_packet(self, odometry: Odometry, imu: Imu, name: str) -> None:
        expected = (frames.tello_odom(name), frames.base_link(name), frames.base_link(name))
        found = (odometry.header.frame_id, odometry.child_frame_id, imu.header.frame_id)
        if found != expected:
            self._health.drop(f"{name} odometry: wrong frames", f"{found}, expected {expected}")
            return
        p, q, v = (
            odometry.pose.pose.position,
            odometry.pose.pose.orientation,
            odometry.twist.twist.linear,
        )
        w, a = imu.angular_velocity, imu.linear_acceleration
        q_xyzw = np.array([q.x, q.y, q.z, q.w])
        try:
            with self._lock:
                self._system.add_vehicle(
                    name,
                    rospy.get_time(),
                    odometry.header.stamp.to_sec(),
                    (p.x, p.y, p.z),
                    q_xyzw,
                    (v.x, v.y, v.z),
                    (w.x, w.y, w.z),
                    (a.x, a.y, a.z),
                )
        except SampleRejected as error:
            rospy.logwarn_throttle(5.0, f"{name}: {error}")
            return
        self._health.tick(f"{name} odometry")

    def _publish(self, _event) -> None:
        now_s = rospy.get_time()
        if self._ground.T_tracker_level is None:
            self._find_level()
        for name in self._names:
            with self._lock:
                pose, camera = (
                    self._system.trackers[name].pose(now_s),
                    self._system.camera(name, now_s),
                )
            if pose is not None and pose.stamp_s > self._stamps_s[name]:
                self._stamps_s[name] = pose.stamp_s
                self._publish_pose(name, pose, camera)

    def _publish_pose(self, name: str, pose: TrackedPose, camera: Optional[CameraPose]) -> None:
        own, mocap = frames.tello_odom(name), self._parameters.mocap_frame
        self._tf.sendTransform(
            [
                conversions.transform_stamped(pose.T_M_O, pose.stamp_s, mocap, own),
                *self._ground.pose(name, pose.stamp_s, pose.T_M_D, pose.covariance),
            ]
        )
        self._health.tick(f"{name} pose")
        if camera is not None:
            self._cameras[name].publish(
                camera_message(camera.stamp_s, camera.T_home_cam, camera.covariance)
            )

    def _set_home(self, reference: str, now_s: float) -> Tuple[np.ndarray, np.ndarray]:
        self._ground.require_nobody_flies_by_it("a new home")
        T_M_odom = self._ground.require_level()
        with self._lock:
            self._system.set_home(reference, now_s, T_M_odom[:3, :3])
            T_home_M = self._system.T_home_mocap
        self._ground.home_set()
        return transforms.invert(T_home_M @ T_M_odom), T_home_M

    def _find_level(self) -> str:
        """The standard deviation of level (deg), in words."""
        try:
            with self._lock:
                R_M_W, sigma_rad = self._system.level()
        except GeometryError as error:
            return str(error)
        self._ground.level(R_M_W, sigma_rad)
        return f"{np.degrees(sigma_rad):.3f}"

    def _report(self, _event) -> None:
        """Counts and states for diagnostics: what was rejected and why there is no pose."""
        with self._lock:
            for name, tracker in self._system.trackers.items():
                for reason, count in tracker.counts.items():
                    self._health.value(f"{name} {reason}", count)
                self._health.value(f"{name} mocap streams an old pose", tracker.old_pose)
                missing = tracker.pose(rospy.get_time()) is None
                self._health.problem(
                    name, f"{name}: no pose, {tracker.absent_because}" if missing else ""
                )
                if tracker.filter is not None:
                    self._health.value(
                        f"{name} odometry delay [s]", f"{tracker.filter.state.delay_s:.3f}"
                    )
        self._health.value("level sigma [deg]", self._find_level())


def main() -> int:
    """Run the node."""
    return node.run("mocap_tracker", MocapTrackerNode)
