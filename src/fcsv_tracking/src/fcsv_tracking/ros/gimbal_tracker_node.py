# SPDX-License-Identifier: Apache-2.0
"""The tracker of thesis chapter 4 on the ground robot: pictures and joints of its gimbals in,
commands to them, odometry in one level frame and T_home_cam of every vehicle out, on the same
topics and frames as with others."""

import threading
from dataclasses import dataclass, field, replace
from typing import List, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_tracking.gimbal.base_motion import BaseMotion, BasePlace
from fcsv_tracking.gimbal.config import load_gimbals
from fcsv_tracking.gimbal.system import GimbalSystem
from fcsv_tracking.gimbal.tracker import GimbalRules, GimbalTracker, GroundPose
from fcsv_tracking.ros.camera_message import camera_message
from fcsv_tracking.ros.gimbal_channel import GimbalChannel, body_message
from fcsv_tracking.ros.ground_odometry import GroundOdometryPublisher
from fcsv_tracking.ros.home_service import HomeService
from fcsv_tracking.ros.static_frames import fixed_parts


@dataclass(frozen=True)
class GimbalTrackerParameters:
    """Parameters of the node. ``decimate`` shrinks pictures before quads are sought in them.
    ``base_odometry``: topic of the wheels below the gimbals; empty: they stand. ``base_pose``: topic
    of the robot's place in home (cooperative_place), by which vehicles keep their places while it
    drives; empty: their poses are the robot's frame's, and move with it."""

    vehicles: List[str]
    vehicles_dir: str
    robot_file: str
    base_odometry: str = ""
    base_pose: str = ""
    decimate: float = 2.0
    rules: GimbalRules = field(default_factory=GimbalRules)

    def __post_init__(self):
        if not 1.0 <= self.decimate <= 8.0:
            raise ValueError(f"decimate: {self.decimate} is not in 1..8")
        if self.base_pose and not self.base_odometry:
            raise ValueError("base_pose: needs base_odometry, for the way since the last place")


class GimbalTrackerNode:
    """/NAME/gimbal/{camera,joint_states} -> /NAME/gimbal/command, /NAME/odometry/...,
    /NAME/gimbal/body, /NAME/camera_pose, tf, /home; services /calibrate and /set_home.

    A vehicle's odometry frame is the ground robot's, which stands level: there is no other. Where
    the robot drives it is the frame in which it stood when home was set; gimbal/body is always as
    the robot has it now.
    """

    def __init__(self):
        p = node.parameters(GimbalTrackerParameters)
        self._names, self._lock = p.vehicles, threading.Lock()
        vehicles = node.vehicles(p.vehicles_dir, p.vehicles)
        gimbals = load_gimbals(p.robot_file, p.vehicles)
        self._system = GimbalSystem({}, {n: v.T_body_cam for n, v in vehicles.items()})
        flows = {
            f"{n} {what}": least
            for n in p.vehicles
            for what, least in (("joints", 20.0), ("pictures", 5.0), ("pose", 1.0))
        }
        self._health = Health("gimbals", flows)
        self._tf = tf2_ros.TransformBroadcaster()
        self._ground = GroundOdometryPublisher(p.vehicles, frames.GROUND)
        self._ground.level(np.eye(3), 0.0)
        fixed = [t for v in vehicles.values() for t in fixed_parts(v)]
        self._cameras = {
            n: rospy.Publisher(f"/{n}/camera_pose", PoseWithCovarianceStamped, queue_size=5)
            for n in p.vehicles
        }
        self._home = HomeService(p.vehicles, frames.GROUND, fixed, self._set_home)
        self._bodies = {
            n: rospy.Publisher(f"/{n}/gimbal/body", Odometry, queue_size=10, tcp_nodelay=True)
            for n in p.vehicles
        }
        self._motion = BaseMotion()
        self._base = BasePlace(self._motion) if p.base_pose else None
        self._channels = [
            GimbalChannel(
                gimbals[n], p.rules, p.decimate, self._health, self._on_tracker, self._on_pose
            )
            for n in p.vehicles
        ]
        if p.base_odometry:
            rospy.Subscriber(
                p.base_odometry, Odometry, self._on_base, queue_size=20, tcp_nodelay=True
            )
        if p.base_pose:
            rospy.Subscriber(
                p.base_pose,
                PoseWithCovarianceStamped,
                self._on_base_pose,
                queue_size=20,
                tcp_nodelay=True,
            )
        self._view_timer = node.every(0.1, self._publish_gimbals)
        self._slow_timer = node.every(1.0, self._report)

    def _on_tracker(self, name: str, tracker: GimbalTracker) -> None:
        with self._lock:
            self._system.trackers[name] = tracker

    def _on_base(self, message: Odometry) -> None:
        try:
            T_O_G = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("base odometry", str(error))
            return
        with self._lock:
            self._motion.add(message.header.stamp.to_sec(), T_O_G)
        for channel in self._channels:
            channel.base_moved(message.header.stamp.to_sec(), T_O_G)

    def _on_base_pose(self, message: PoseWithCovarianceStamped) -> None:
        if message.header.frame_id != frames.HOME:
            self._health.drop("base pose: wrong frame", message.header.frame_id)
            return
        try:
            T_home_ground = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("base pose", str(error))
            return
        covariance = np.reshape(message.pose.covariance, (6, 6))
        with self._lock:
            self._base.add(message.header.stamp.to_sec(), T_home_ground, covariance)

    def _on_pose(self, name: str, pose: GroundPose) -> None:
        self._bodies[name].publish(body_message(name, pose))
        try:
            with self._lock:
                pose = self._standing(pose)
                camera = self._system.add(name, pose)
        except PoseUnavailable as error:
            self._health.drop(f"{name}: where the robot was", str(error))
            return
        self._tf.sendTransform(self._ground.pose(name, pose.stamp_s, pose.T_G_D, pose.covariance))
        self._health.tick(f"{name} pose")
        if camera is not None:
            self._cameras[name].publish(
                camera_message(camera.stamp_s, camera.T_home_cam, camera.covariance)
            )

    def _standing(self, pose: GroundPose) -> GroundPose:
        """The pose in the frame that stands while the robot drives."""
        if self._base is None:
            return pose
        T, covariance = self._base.standing(pose.stamp_s, pose.T_G_D, pose.covariance)
        return replace(pose, T_G_D=T, covariance=covariance)

    def _set_home(self, reference: str, now_s: float) -> Tuple[np.ndarray, np.ndarray]:
        self._ground.require_nobody_flies_by_it("a new home")
        with self._lock:  # the odometry frame is the ground robot's
            found = self._system.set_home(reference, now_s), self._system.T_home_ground
            if self._base is not None:
                self._base.set_home(self._system.T_home_ground)
        self._ground.home_set()
        return found

    def _report(self, _event) -> None:
        for channel in self._channels:
            channel.report()

    def _publish_gimbals(self, _event) -> None:
        """Where the gimbals look and the robot is, for rviz."""
        parent = frames.GROUND
        if self._base is not None:
            now_s, parent = rospy.get_time(), frames.GROUND_NOW
            try:
                with self._lock:
                    T_S_G = self._base.at(now_s)
            except PoseUnavailable:
                return
            self._tf.sendTransform(
                conversions.transform_stamped(T_S_G, now_s, frames.GROUND, parent)
            )
        for name, channel in zip(self._names, self._channels):
            if channel.tracker is None:
                continue
            try:
                with channel.lock:
                    T_G_C, stamp_s = channel.tracker.camera_now(), channel.tracker.angles_until_s
            except PoseUnavailable:
                continue  # no reading yet
            optical = frames.gimbal_optical(name)
            self._tf.sendTransform(conversions.transform_stamped(T_G_C, stamp_s, parent, optical))


def main() -> int:
    """Run the node."""
    return node.run("gimbal_tracker", GimbalTrackerNode)
