# SPDX-License-Identifier: Apache-2.0
"""Tracking camera to body odometry, at 200 Hz, and at 30 Hz to the autopilot and the radio."""

import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Dict

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros import telemetry_messages as telemetry
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_msgs.msg import Calibration, Epoch
from fcsv_tracking.odometry import EpochBegan, GateParameters, Rebase
from fcsv_tracking.odometry_port import BodySample, OdometryPort, TrackerSample


@dataclass(frozen=True)
class OdometryParameters:
    """Parameters of the node."""

    vehicle: str
    vehicles_dir: str
    state_rate_hz: float = 30.0
    stale_s: float = 0.3  # silence that diagnostics call an error
    gate: GateParameters = field(default_factory=GateParameters)
    tracker_profile: str = ""  # config/trackers/NAME.yaml; empty: the T265 as TrackerProfile has it

    def __post_init__(self):
        if not 0 < self.state_rate_hz <= 200:
            raise ValueError(f"state_rate_hz: {self.state_rate_hz} is not in (0, 200]")


class OdometryNode:
    """t265/odom/sample -> odometry/body, odometry/state, mavros/vision_pose/pose."""

    def __init__(self):
        self._parameters = p = node.parameters(OdometryParameters)
        geometry = node.vehicles(p.vehicles_dir, [p.vehicle])[p.vehicle]
        self._odom, self._body = frames.odom(p.vehicle), frames.base_link(p.vehicle)
        # the re-basing outlives a restart of this node, or a restart would undo it: a jump
        self._rebase_param = rospy.get_namespace() + "odometry_rebase"
        self._epoch_param = rospy.get_namespace() + "odometry_epoch"
        self._lock = threading.RLock()
        self._port = OdometryPort(
            p.vehicle,
            geometry.T_body_t265,
            load_profile(p.tracker_profile),
            p.state_rate_hz,
            p.gate,
            self._stored_rebase(),
            self._next_epoch(),
        )
        self._updater = Updater()
        self._updater.setHardwareID(p.vehicle)
        self._updater.add("odometry", self._diagnose)
        self._body_publisher = rospy.Publisher(
            "odometry/body", Odometry, queue_size=50, tcp_nodelay=True
        )
        self._state_publisher = rospy.Publisher(
            "odometry/state", Odometry, queue_size=10, tcp_nodelay=True
        )
        self._vision_publisher = rospy.Publisher(
            "mavros/vision_pose/pose", PoseStamped, queue_size=10, tcp_nodelay=True
        )
        self._epoch_publisher = rospy.Publisher(
            "odometry/epoch", Epoch, queue_size=2, latch=True, tcp_nodelay=True
        )
        self._send: Dict[type, Callable[[Any], None]] = {
            BodySample: self._publish,
            Rebase: self._store_rebase,
            tm.Dropped: self._rejected,
            tm.OdometryEpoch: self._publish_epoch,
        }
        self._step()
        self._timer = node.every(1.0, lambda _: self._updater.force_update())
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        rospy.Subscriber(
            "t265/odom/sample", Odometry, self._on_sample, queue_size=50, tcp_nodelay=True
        )

    def _on_sample(self, m: Odometry) -> None:
        p, q, v, w = (
            m.pose.pose.position,
            m.pose.pose.orientation,
            m.twist.twist.linear,
            m.twist.twist.angular,
        )
        sample = TrackerSample(
            (m.header.frame_id, m.child_frame_id),
            m.header.stamp.to_sec(),
            (p.x, p.y, p.z),
            (q.x, q.y, q.z, q.w),
            (v.x, v.y, v.z),
            (w.x, w.y, w.z),
            m.pose.covariance,
        )
        self._receive(sample)

    def _on_calibration(self, message: Calibration) -> None:
        try:
            self._receive(telemetry.calibration_of(message))
        except FcsvError as error:
            rospy.logwarn_throttle(2.0, f"{self._odom}: calibration: {error}")

    def _receive(self, message: object) -> None:
        with self._lock:
            self._port.receive(time.monotonic(), message)
            self._step()

    def _step(self) -> None:
        with self._lock:
            for output in self._port.step(time.monotonic()):
                self._send[type(output)](output)

    def _publish(self, sample: BodySample) -> None:
        body, message = sample.pose, Odometry()
        message.header.stamp = rospy.Time.from_sec(body.stamp_s)
        message.header.frame_id, message.child_frame_id = self._odom, self._body
        message.pose.pose = Pose(Point(*body.p_odom_body), Quaternion(*body.q_odom_body_xyzw))
        message.twist.twist = Twist(Vector3(*body.linear_mps), Vector3(*body.angular_radps))
        message.pose.covariance = sample.covariance
        self._body_publisher.publish(message)
        if sample.goes_on:
            self._state_publisher.publish(message)
            self._vision_publisher.publish(PoseStamped(message.header, message.pose.pose))

    def _rejected(self, dropped: tm.Dropped) -> None:
        rospy.logwarn_throttle(2.0, f"{self._odom}: {dropped.why}")
        self._updater.update()

    def _stored_rebase(self) -> Rebase:
        stored = rospy.get_param(self._rebase_param, None)
        return Rebase(float(stored["yaw_rad"]), tuple(stored["p_m"])) if stored else Rebase()

    def _next_epoch(self) -> EpochBegan:
        """A start of this node begins an epoch, because nobody watched before; no number comes
        again after a reboot."""
        before = int(rospy.get_param(self._epoch_param, 0))
        return EpochBegan(
            max(before + 1, int(rospy.get_time()) % 2**31), "the odometry was started"
        )

    def _publish_epoch(self, epoch: tm.OdometryEpoch) -> None:
        self._epoch_publisher.publish(
            Epoch(conversions.header(rospy.get_time(), ""), epoch.number, epoch.reason)
        )
        rospy.set_param(self._epoch_param, epoch.number)
        rospy.logwarn("%s: epoch %d of its odometry: %s", self._odom, epoch.number, epoch.reason)

    def _store_rebase(self, rebase: Rebase) -> None:
        rospy.set_param(self._rebase_param, {"yaw_rad": rebase.yaw_rad, "p_m": list(rebase.p_m)})
        self._updater.force_update()

    def _diagnose(self, status):
        health = self._port.health(time.monotonic(), self._parameters.stale_s)
        level = DiagnosticStatus.WARN if health.warning else DiagnosticStatus.OK
        level = DiagnosticStatus.ERROR if health.error else level
        status.summary(level, health.error or health.warning or "odometry is passed on")
        for name, value in health.values:
            status.add(name, value)
        return status


def main() -> int:
    """Run the node."""
    return node.run("odometry", OdometryNode)
