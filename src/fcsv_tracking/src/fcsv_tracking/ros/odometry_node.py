# SPDX-License-Identifier: Apache-2.0
"""Tracking camera to body odometry, at 200 Hz, and at 30 Hz to the autopilot and the radio."""

import math
import time
from dataclasses import dataclass, field
from typing import Optional

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.streams.flow import RateGate
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_msgs.msg import Calibration, Epoch
from fcsv_tracking.errors import OdometryRejected
from fcsv_tracking.odometry import BodyOdometry, BodyPose, EpochBegan, GateParameters, Rebase


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
        self._parameters = node.parameters(OdometryParameters)
        name = self._parameters.vehicle
        geometry = node.vehicles(self._parameters.vehicles_dir, [name])[name]
        tracker = load_profile(self._parameters.tracker_profile)
        self._expected = (tracker.odom_frame(name), tracker.pose_frame(name))
        self._odom, self._body = frames.odom(name), frames.base_link(name)
        # the re-basing outlives a restart of this node, or a restart would undo it: a jump
        self._rebase_param = rospy.get_namespace() + "odometry_rebase"
        self._epoch_param = rospy.get_namespace() + "odometry_epoch"
        self._core = BodyOdometry(
            geometry.T_body_t265, self._parameters.gate, self._stored_rebase(), tracker, self._next_epoch()
        )
        self._jumps_stored = 0
        self._state_gate = RateGate.bursting(self._parameters.state_rate_hz)
        self._received_s: Optional[float] = None
        self._received = self._received_before = 0
        self._calibrated_s: Optional[float] = None
        self._updater = Updater()
        self._updater.setHardwareID(name)
        self._updater.add("odometry", self._diagnose)
        self._body_publisher = rospy.Publisher("odometry/body", Odometry, queue_size=50, tcp_nodelay=True)
        self._state_publisher = rospy.Publisher("odometry/state", Odometry, queue_size=10, tcp_nodelay=True)
        self._vision_publisher = rospy.Publisher(
            "mavros/vision_pose/pose", PoseStamped, queue_size=10, tcp_nodelay=True
        )
        self._epoch_publisher = rospy.Publisher("odometry/epoch", Epoch, queue_size=2, latch=True, tcp_nodelay=True)
        self._epoch: Optional[EpochBegan] = None
        self._tell_epoch()
        self._timer = node.every(1.0, lambda _: self._updater.force_update())
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        rospy.Subscriber("t265/odom/sample", Odometry, self._on_sample, queue_size=50, tcp_nodelay=True)

    def _on_sample(self, message: Odometry) -> None:
        self._received += 1
        self._received_s = rospy.get_time()
        try:
            pose = self._convert_and_feed(message)
        except OdometryRejected as error:
            rospy.logwarn_throttle(2.0, f"{self._odom}: {error}")
            self._updater.update()
            return
        if self._core.epoch != self._epoch:
            self._tell_epoch()
        self._publish(pose, message.pose.covariance)
        if self._core.status.jumps != self._jumps_stored:
            self._store_jump()

    def _convert_and_feed(self, message: Odometry) -> BodyPose:
        found = (message.header.frame_id, message.child_frame_id)
        if found != self._expected:
            raise self._core.reject("frames", f"odometry has frames {found}, expected {self._expected}")
        p, q = message.pose.pose.position, message.pose.pose.orientation
        v, w = message.twist.twist.linear, message.twist.twist.angular
        return self._core.feed(
            message.header.stamp.to_sec(), (p.x, p.y, p.z), (q.x, q.y, q.z, q.w), (v.x, v.y, v.z), (w.x, w.y, w.z),
            time.monotonic(),
        )  # fmt: skip

    def _publish(self, body: BodyPose, covariance) -> None:
        message = Odometry()
        message.header.stamp = rospy.Time.from_sec(body.stamp_s)
        message.header.frame_id, message.child_frame_id = self._odom, self._body
        message.pose.pose = Pose(Point(*body.p_odom_body), Quaternion(*body.q_odom_body_xyzw))
        message.twist.twist = Twist(Vector3(*body.linear_mps), Vector3(*body.angular_radps))
        message.pose.covariance = covariance
        self._body_publisher.publish(message)
        if self._state_gate.passes(body.stamp_s):
            self._state_publisher.publish(message)
            self._vision_publisher.publish(PoseStamped(message.header, message.pose.pose))

    def _stored_rebase(self) -> Rebase:
        stored = rospy.get_param(self._rebase_param, None)
        return Rebase(float(stored["yaw_rad"]), tuple(stored["p_m"])) if stored else Rebase()

    def _next_epoch(self) -> EpochBegan:
        """A start of this node begins an epoch, because nobody watched before; no number comes again after a reboot."""
        before = int(rospy.get_param(self._epoch_param, 0))
        return EpochBegan(max(before + 1, int(rospy.get_time()) % 2**31), "the odometry was started")

    def _tell_epoch(self) -> None:
        epoch = self._epoch = self._core.epoch
        self._epoch_publisher.publish(Epoch(conversions.header(rospy.get_time(), ""), epoch.number, epoch.reason))
        rospy.set_param(self._epoch_param, epoch.number)
        rospy.logwarn("%s: epoch %d of its odometry: %s", self._odom, epoch.number, epoch.reason)

    def _store_jump(self) -> None:
        self._jumps_stored = self._core.status.jumps
        rebase = self._core.rebase
        rospy.set_param(self._rebase_param, {"yaw_rad": rebase.yaw_rad, "p_m": list(rebase.p_m)})
        rospy.logerr(
            f"{self._odom}: odometry jumped (number {self._jumps_stored}, largest "
            f"{self._core.status.largest_jump_m:.2f} m); undone for the autopilot, calibrate again"
        )
        self._updater.force_update()

    def _on_calibration(self, message: Calibration) -> None:
        if any(self._parameters.vehicle in (link.parent, link.child) for link in message.links):
            self._calibrated_s = message.header.stamp.to_sec()

    def _diagnose(self, status):
        core = self._core.status
        age_s = math.inf if self._received_s is None else rospy.get_time() - self._received_s
        if age_s > self._parameters.stale_s:
            status.summary(DiagnosticStatus.ERROR, "no odometry from the tracking camera")
        elif core.lost:
            status.summary(DiagnosticStatus.ERROR, "tracker lost: it jumps again and again, pose withheld")
        elif core.last_jump_stamp_s and (self._calibrated_s or 0.0) < core.last_jump_stamp_s:
            status.summary(DiagnosticStatus.ERROR, "odometry jumped: calibrate again")
        elif core.rejected:
            status.summary(DiagnosticStatus.WARN, "odometry samples were rejected")
        else:
            status.summary(DiagnosticStatus.OK, "odometry is passed on")
        status.add("samples in the last period", self._received - self._received_before)
        self._received_before = self._received
        status.add("passed", core.passed)
        status.add("jumps", core.jumps)
        status.add("largest jump (m)", f"{core.largest_jump_m:.3f}")
        status.add("largest jump (deg)", f"{math.degrees(core.largest_jump_rad):.1f}")
        for reason, count in sorted(core.rejected.items()):
            status.add(f"rejected: {reason}", count)
        return status


def main() -> int:
    """Run the node."""
    return node.run("odometry", OdometryNode)
