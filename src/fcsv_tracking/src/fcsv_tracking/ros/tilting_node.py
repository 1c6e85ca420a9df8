# SPDX-License-Identifier: Apache-2.0
"""A tilting stereo camera by itself: its servos, the poses of its cameras, its pictures for the
live map."""

import threading
import time
from dataclasses import dataclass, field
from typing import Dict

import cv2
import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import Image, JointState, Range

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Calibration, CalibrationLink, CapturedPicture, Home
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.dynamixel import DynamixelBus
from fcsv_tracking.gimbal.servos import ServoError
from fcsv_tracking.ros import joint_messages
from fcsv_tracking.ros.camera_message import camera_message
from fcsv_tracking.tilting.aim import Aim, AimRules
from fcsv_tracking.tilting.poses import RigPoses, looked_at_m
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, load_rig
from fcsv_tracking.tilting.servos import TiltServos

_AGAIN_S = 1.0  # between attempts while a servo does not answer
_REFERENCE = "map/reference_optical"


@dataclass(frozen=True)
class TiltingParameters:
    """Parameters of the node. ``follow_map``: look at what the live map's depth has in its
    middle."""

    rig_file: str
    port: str = "/dev/ttyUSB0"
    baud: int = 1000000
    rate_hz: float = 50.0
    follow_map: bool = True
    jpeg_quality: int = 95
    aim: AimRules = field(default_factory=AimRules)

    def __post_init__(self):
        if not 10.0 <= self.rate_hz <= 200.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 10..200")
        if not 50 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality: {self.jpeg_quality} is not in 50..100")


class TiltingNode:
    """NAME is the rig's. /NAME/distance, /NAME/command, /map/depth and /NAME_left,
    NAME_right/camera/image_raw -> servos, /NAME/joint_states, tf, and of each camera camera_pose
    and capture/picture; /home and /calibration, latched: home is the rig's frame."""

    def __init__(self):
        self._parameters = p = node.parameters(TiltingParameters)
        self._rig = rig = load_rig(p.rig_file)
        self._aim, self._poses, self._lock = Aim(rig, p.aim), RigPoses(rig), threading.Lock()
        self._waiting: Dict[str, Image] = {}
        self._silent_until_s = 0.0
        flows = {"joints": 0.5 * p.rate_hz, **{f"{s} pictures": 0.0 for s in SIDES}}
        self._health = Health(p.port, flows)
        self._bus = DynamixelBus(p.port, p.baud)
        self._servos = TiltServos(self._bus, rig, rospy.get_time, p.aim.speed_degps)
        self._tf, self._static = (
            tf2_ros.TransformBroadcaster(),
            tf2_ros.StaticTransformBroadcaster(),
        )
        self._joints = rospy.Publisher(
            f"/{rig.name}/joint_states", JointState, queue_size=20, tcp_nodelay=True
        )
        names = {side: rig.camera_name(side) for side in SIDES}
        self._pictures = {
            s: rospy.Publisher(f"/{n}/capture/picture", CapturedPicture, queue_size=2)
            for s, n in names.items()
        }
        self._camera_poses = {
            s: rospy.Publisher(f"/{n}/camera_pose", PoseWithCovarianceStamped, queue_size=5)
            for s, n in names.items()
        }
        latched = {"queue_size": 1, "latch": True}
        self._home = rospy.Publisher("/home", Home, **latched)
        self._calibration = rospy.Publisher("/calibration", Calibration, **latched)
        self._publish_home()
        rospy.Subscriber(f"/{rig.name}/command", JointState, self._on_command, queue_size=1)
        rospy.Subscriber(f"/{rig.name}/distance", Range, self._on_distance, queue_size=1)
        if p.follow_map:
            rospy.Subscriber("/map/depth", Image, self._on_depth, queue_size=1, buff_size=8 << 20)
        for side, n in names.items():
            rospy.Subscriber(
                f"/{n}/camera/image_raw",
                Image,
                self._on_picture,
                side,
                queue_size=1,
                buff_size=8 << 20,
            )

    def _publish_home(self) -> None:
        """Both cameras' odometry is the rig's frame, and so is home."""
        now_s, identity = rospy.get_time(), conversions.transform_to_pose(np.eye(4))
        left, right = (self._rig.camera_name(side) for side in SIDES)
        link = CalibrationLink(parent=left, child=right, child_odom_in_parent_odom=identity)
        self._calibration.publish(
            Calibration(header=conversions.header(now_s, frames.odom(left)), links=[link])
        )
        self._home.publish(
            Home(
                header=conversions.header(now_s, frames.odom(left)),
                reference=left,
                home_in_odom=identity,
            )
        )
        still = [
            conversions.transform_stamped(np.eye(4), now_s, frames.HOME, f)
            for f in (self._rig.frame, frames.odom(left), frames.odom(right))
        ]
        self._static.sendTransform(still)

    def _on_command(self, message: JointState) -> None:
        self._guarded(
            "command",
            lambda: self._aim.turn_to(
                TiltAngles(*joint_messages.values_of(message, self._rig.frame, SIDES))
            ),
        )

    def _on_distance(self, message: Range) -> None:
        self._guarded("distance", lambda: self._aim.look(message.range))

    def _on_depth(self, message: Image) -> None:
        def look() -> None:
            if message.header.frame_id != _REFERENCE:
                raise SampleRejected(
                    "wrong frame", f"depth is of frame '{message.header.frame_id}'"
                )
            T_rig_left = self._poses.at("left", message.header.stamp.to_sec()).T_rig_cam
            distance_m = looked_at_m(self._rig, T_rig_left, conversions.image_to_array(message))
            self._health.value("looks at [m]", f"{distance_m:.2f}")
            self._aim.look(distance_m)

        self._guarded("depth", look)

    def _guarded(self, what: str, do) -> None:
        """What is not good is counted and changes nothing."""
        try:
            with self._lock:
                do()
        except SampleRejected as error:
            self._health.drop(f"{what}: {error.reason}", str(error))
        except (FcsvError, ValueError) as error:
            self._health.drop(what, str(error))

    def _on_picture(self, message: Image, side: str) -> None:
        with self._lock:
            self._waiting[side] = message

    def spin(self) -> None:
        """Runs until ROS shuts the node down; then without torque."""
        rate, reported_s = rospy.Rate(self._parameters.rate_hz, reset=True), 0.0
        while not rospy.is_shutdown():
            if time.monotonic() >= self._silent_until_s:
                self._pass()
            if time.monotonic() - reported_s > 1.0:
                reported_s = time.monotonic()
                for name, value in self._servos.health().items():
                    self._health.value(name, value)
            try:
                rate.sleep()
            except rospy.ROSInterruptException:
                break
        self._servos.close()
        self._bus.close()

    def _pass(self) -> None:
        """One command, one reading, and the pictures whose angles are known by now."""
        with self._lock:
            told = self._aim.step(rospy.get_time())
        try:
            self._servos.turn(told)
            reading = self._servos.read()
        except ServoError as error:
            self._health.problem("servos", str(error))
            self._silent_until_s = time.monotonic() + _AGAIN_S
            return
        self._health.problem("servos", "")
        self._health.tick("joints")
        with self._lock:
            try:
                self._poses.add(reading)
            except SampleRejected as error:
                self._health.drop(error.reason, str(error))
                return
            ready = {
                s: m
                for s, m in self._waiting.items()
                if m.header.stamp.to_sec() <= self._poses.newest_s
            }
            for side in ready:
                del self._waiting[side]
            T = {side: self._poses.latest(side) for side in SIDES}
        self._joints.publish(
            joint_messages.to_message(reading.stamp_s, self._rig.frame, reading.angles, SIDES)
        )
        self._tf.sendTransform(
            [
                conversions.transform_stamped(
                    T[s],
                    reading.stamp_s,
                    self._rig.frame,
                    frames.camera_optical(self._rig.camera_name(s)),
                )
                for s in SIDES
            ]
        )
        for side, message in ready.items():
            self._send(side, message)

    def _send(self, side: str, message: Image) -> None:
        """A picture with its pose, and how well that is known, before it."""
        stamp_s, camera = message.header.stamp.to_sec(), getattr(self._rig, side).camera
        try:
            with self._lock:
                posed = self._poses.at(side, stamp_s)
            bgr = conversions.image_to_array(message, "bgr8")
        except SampleRejected as error:
            self._health.drop(f"{side} picture: {error.reason}", str(error))
            return
        except (PoseUnavailable, FcsvError) as error:
            self._health.drop(f"{side} picture", str(error))
            return
        if bgr.shape[:2] != (camera.height, camera.width):
            size = (
                f"{bgr.shape[1]}x{bgr.shape[0]}, the rig's file says {camera.width}x{camera.height}"
            )
            self._health.drop(f"{side} picture: wrong size", size)
            return
        name = self._rig.camera_name(side)
        optical = frames.camera_optical(name)
        self._camera_poses[side].publish(camera_message(stamp_s, posed.T_rig_cam, posed.covariance))
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, self._parameters.jpeg_quality])[
            1
        ].tobytes()
        out = CapturedPicture(vehicle=name, format="jpeg", data=jpeg)
        out.header = conversions.header(stamp_s, optical)
        out.camera = conversions.info_from_camera(camera, stamp_s, optical)
        out.camera_in_odom = conversions.transform_to_pose(posed.T_rig_cam)
        self._pictures[side].publish(out)
        self._health.tick(f"{side} pictures")


def main() -> int:
    """Run the node."""
    return node.run("tilting", TiltingNode)
