# SPDX-License-Identifier: Apache-2.0
"""One gimbal of the tracker's node: its topics, and a thread that looks at its pictures."""

import threading
import time
from typing import Callable, Optional

import numpy as np
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image, JointState

from fcsv_geometry import frames
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.base_motion import BaseMotion
from fcsv_tracking.gimbal.config import Gimbal
from fcsv_tracking.gimbal.looking import look
from fcsv_tracking.gimbal.tracker import GimbalRules, GimbalTracker, GroundPose
from fcsv_tracking.ros import joint_messages
from fcsv_tracking.tags import TagDetector

_WAIT_FOR_ANGLES_S = 0.1
_COMMAND_HZ = 50.0


class GimbalChannel:
    """``on_tracker`` hears of a new tracker (a camera_info came), ``on_pose`` of every pose."""

    def __init__(
        self,
        gimbal: Gimbal,
        rules: GimbalRules,
        decimate: float,
        health: Health,
        on_tracker: Callable[[str, GimbalTracker], None],
        on_pose: Callable[[str, GroundPose], None],
    ):
        self.gimbal, self.name = gimbal, gimbal.vehicle
        self.tracker: Optional[GimbalTracker] = None
        self.lock = threading.Lock()
        self._rules, self._health = rules, health
        self._on_tracker, self._on_pose = on_tracker, on_pose
        self._base = BaseMotion()
        self._detector = TagDetector({t.id: t.size_m for t in gimbal.tags}, decimate)
        self._camera: Optional[PinholeCamera] = None
        self._picture: Optional[Image] = None
        self._picture_came, self._angles_came = threading.Condition(), threading.Condition()
        health.problem(
            f"{self.name} camera_info", f"{self.name}: its gimbal's camera sends no camera_info"
        )
        at = f"/{self.name}/gimbal"
        self._command = rospy.Publisher(f"{at}/command", JointState, queue_size=5, tcp_nodelay=True)
        rospy.Subscriber(
            f"{at}/joint_states", JointState, self._on_joints, queue_size=20, tcp_nodelay=True
        )
        rospy.Subscriber(f"{at}/camera/camera_info", CameraInfo, self._on_info, queue_size=1)
        rospy.Subscriber(
            f"{at}/camera/image_raw", Image, self._on_picture, queue_size=1, buff_size=8 << 20
        )
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()
        self._timer = node.every(1.0 / _COMMAND_HZ, self._follow)

    def base_moved(self, stamp_s: float, T_O_G: np.ndarray) -> None:
        """What the wheels below the gimbal say."""
        with self.lock:
            self._base.add(stamp_s, T_O_G)

    def _on_info(self, message: CameraInfo) -> None:
        try:
            camera = conversions.camera_from_info(message)
        except FcsvError as error:
            self._health.problem(f"{self.name} camera_info", f"{self.name}: {error}")
            return
        self._health.problem(f"{self.name} camera_info", "")
        if camera != self._camera:
            self._camera = camera
            with self.lock:
                g = self.gimbal
                self.tracker = GimbalTracker(
                    g.geometry, g.tags, camera, self._rules, g.start, self._base
                )
            self._on_tracker(self.name, self.tracker)

    def _on_joints(self, message: JointState) -> None:
        if self.tracker is None:
            return
        try:
            angles = joint_messages.from_message(message, frames.gimbal_base(self.name))
            with self.lock:
                self.tracker.add_angles(message.header.stamp.to_sec(), angles)
        except SampleRejected as error:
            self._health.drop(f"{self.name} joints: {error.reason}", str(error))
            return
        self._health.tick(f"{self.name} joints")
        with self._angles_came:
            self._angles_came.notify_all()

    def _on_picture(self, message: Image) -> None:
        if message.header.frame_id != frames.gimbal_optical(self.name):
            self._health.drop(f"{self.name} picture: wrong frame", message.header.frame_id)
            return
        with self._picture_came:
            self._picture = message
            self._picture_came.notify()

    def _look(self) -> None:
        """One picture after the other; of those that come meanwhile the newest."""
        while not rospy.is_shutdown():
            with self._picture_came:
                if self._picture is None:
                    self._picture_came.wait(0.2)
                message, self._picture = self._picture, None
            if message is None or self.tracker is None:
                continue
            try:
                self._process(message)
            except SampleRejected as error:
                rospy.logdebug("%s: %s", self.name, error)  # counted by the tracker
            except FcsvError as error:
                self._health.drop(f"{self.name} picture", str(error))
            # a defect costs one picture: a thread that died never finds the vehicle again
            except Exception as error:
                self._health.drop(f"{self.name} picture", node.defect(error))

    def _process(self, message: Image) -> None:
        stamp_s, tracker, camera = message.header.stamp.to_sec(), self.tracker, self._camera
        self._health.tick(f"{self.name} pictures")
        self._wait_for_angles(tracker, stamp_s)
        with self.lock:
            if tracker.turning(stamp_s):
                return
            window = tracker.window(stamp_s)
        begun_s = time.perf_counter()
        observations, _ = look(
            self._detector, conversions.image_to_array(message, "mono8"), camera, window
        )
        self._health.value(
            f"{self.name} looking [ms]", f"{(time.perf_counter() - begun_s) * 1e3:.0f}"
        )
        with self.lock:
            picture = tracker.begin(rospy.get_time(), stamp_s, observations)
        seen = tracker.find_body(picture)  # the longest part: readings and commands go on meanwhile
        with self.lock:
            pose = tracker.finish(picture, seen)
        self._on_pose(self.name, pose)

    def _wait_for_angles(self, tracker: GimbalTracker, stamp_s: float) -> None:
        """Readings that are still under way; without them there is no pose (counted)."""
        deadline = time.monotonic() + _WAIT_FOR_ANGLES_S
        with self._angles_came:
            while tracker.angles_until_s < stamp_s and time.monotonic() < deadline:
                self._angles_came.wait(0.01)

    def _follow(self, _event) -> None:
        if self.tracker is None:
            return
        now_s = rospy.get_time()
        with self.lock:
            goal = self.tracker.command(now_s)
        if goal is not None:
            self._command.publish(
                joint_messages.to_message(now_s, frames.gimbal_base(self.name), goal)
            )

    def report(self) -> None:
        """Counts and states for diagnostics."""
        with self.lock:
            tracker = self.tracker
            if tracker is None:
                return
            for reason, count in tracker.counts.items():
                self._health.value(f"{self.name} {reason}", count)
            for reason, count in self._detector.rejected.items():
                self._health.value(f"{self.name} tags rejected: {reason}", count)
            searching = tracker.follower.searching
        self._health.value(f"{self.name} searching", searching)
        self._health.problem(
            self.name, f"{self.name}: not seen, its gimbal searches" if searching else ""
        )


def body_message(name: str, pose: GroundPose) -> Odometry:
    """A vehicle as the robot has it at a picture's stamp."""
    header = conversions.header(pose.stamp_s, frames.GROUND_NOW)
    message = Odometry(header=header, child_frame_id=frames.base_link(name))
    message.pose.pose = conversions.transform_to_pose(pose.T_G_D)
    message.pose.covariance = pose.covariance.ravel().tolist()
    return message
