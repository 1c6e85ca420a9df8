# SPDX-License-Identifier: Apache-2.0
"""The path from tracking camera to autopilot on a vehicle: T265 odometry in, gated body pose out."""

import rospy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicle import load_vehicles
from fcsv_tracking.errors import OdometryRejected
from fcsv_tracking.odometry import BodyOdometry, OdometryGate, quaternion_xyzw


class OdometryNode:
    """Publishes odometry/body with every sample, odometry/state and the vision pose at 30 Hz."""

    def __init__(self):
        self._name = rospy.get_param("~vehicle")
        vehicle = load_vehicles(rospy.get_param("~vehicles_dir"), [self._name])[self._name]
        gate = OdometryGate(**rospy.get_param("~gate", {}))
        self._period_s = 1.0 / rospy.get_param("~state_rate_hz", 30.0)
        self._R_body_t265 = vehicle.T_body_t265[:3, :3]
        self._core = BodyOdometry(vehicle.T_body_t265, gate)
        self._next_state_s = 0.0
        self._expected_frame = f"{self._name}/t265_odom_frame"
        self._health = Health(self._name, {"odometry": 50.0})
        rospy.loginfo("odometry of %s: %s", self._name, gate)
        self._body = rospy.Publisher("odometry/body", Odometry, queue_size=50)
        self._state = rospy.Publisher("odometry/state", Odometry, queue_size=5)
        self._vision = rospy.Publisher("mavros/vision_pose/pose", PoseStamped, queue_size=1)
        rospy.Subscriber("t265/odom/sample", Odometry, self._on_sample, queue_size=50, tcp_nodelay=True)

    def _on_sample(self, message: Odometry) -> None:
        if message.header.frame_id != self._expected_frame:
            self._health.drop("wrong frame", f"{message.header.frame_id} is not {self._expected_frame}")
            return
        p, q = message.pose.pose.position, message.pose.pose.orientation
        stamp_s = message.header.stamp.to_sec()
        jumps = self._core.jumps
        try:
            T_odom_body = self._core.body_pose(stamp_s, (p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
        except OdometryRejected as error:
            self._health.drop("rejected sample", str(error))
            return
        if self._core.jumps > jumps:
            text = f"{self._name}: odometry jumped by {self._core.last_jump_m:.2f} m; taken back. Calibrate again"
            self._health.problem("jump", text)
        self._health.tick("odometry")
        self._publish(message, stamp_s, T_odom_body)

    def _publish(self, sample: Odometry, stamp_s: float, T_odom_body) -> None:
        out = Odometry(header=sample.header)
        out.header.frame_id, out.child_frame_id = frames.odom(self._name), frames.base_link(self._name)
        out.pose.pose = Pose(Point(*T_odom_body[:3, 3]), Quaternion(*quaternion_xyzw(T_odom_body)))
        v, w = sample.twist.twist.linear, sample.twist.twist.angular
        out.twist.twist.linear = Vector3(*(self._R_body_t265 @ (v.x, v.y, v.z)))
        out.twist.twist.angular = Vector3(*(self._R_body_t265 @ (w.x, w.y, w.z)))
        out.pose.covariance, out.twist.covariance = sample.pose.covariance, sample.twist.covariance
        self._body.publish(out)
        if stamp_s >= self._next_state_s:
            self._next_state_s = max(self._next_state_s + self._period_s, stamp_s)
            self._state.publish(out)
            self._vision.publish(PoseStamped(out.header, out.pose.pose))


def main() -> None:
    """Run the node."""
    rospy.init_node("odometry")
    OdometryNode()
    rospy.spin()
