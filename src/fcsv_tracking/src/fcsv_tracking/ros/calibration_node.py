# SPDX-License-Identifier: Apache-2.0
"""The control PC's services /calibrate and /set_home, and what they find as latched topics."""

import threading
from typing import Dict, List

import numpy as np
import rospy
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.trajectory import Trajectory
from fcsv_geometry.vehicle import load_vehicles
from fcsv_msgs.msg import Calibration, Home, TagDetections
from fcsv_msgs.srv import Calibrate, CalibrateResponse, SetHome, SetHomeResponse
from fcsv_tracking.calibration import CalibrationRules, Link, calibrate_link
from fcsv_tracking.chain import home_of
from fcsv_tracking.detection import Detection
from fcsv_tracking.errors import CalibrationRefused, TrackingError
from fcsv_tracking.ros import link_messages

_OLDEST_ODOMETRY_S = 0.5


class CalibrationNode:
    """Listens always, collects while a calibration runs."""

    def __init__(self):
        self._names: List[str] = list(rospy.get_param("~vehicles"))
        self._vehicles = load_vehicles(rospy.get_param("~vehicles_dir"), self._names)
        self._rules = CalibrationRules(**rospy.get_param("~rules", {}))
        rospy.loginfo("calibration of %s: %s", self._names, self._rules)
        self._lock = threading.Lock()
        self._tracks: Dict[str, Trajectory] = {n: Trajectory(gap_s=0.15, keep_s=60.0) for n in self._names}
        self._collected: Dict[str, List[TagDetections]] = {}
        self._collecting = False
        self._calibrated: set = set()
        self._health = Health("control")
        self._calibration = rospy.Publisher("/calibration", Calibration, queue_size=1, latch=True)
        self._home = rospy.Publisher("/home", Home, queue_size=1, latch=True)
        rospy.Service("/calibrate", Calibrate, self._on_calibrate)
        rospy.Service("/set_home", SetHome, self._on_set_home)
        for name in self._names:
            rospy.Subscriber(f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=30)
            rospy.Subscriber(f"/{name}/tags/detections", TagDetections, self._on_tags, name, queue_size=30)

    def _on_odometry(self, message: Odometry, name: str) -> None:
        if message.header.frame_id != frames.odom(name):
            self._health.drop("odometry", f"{name} sends frame {message.header.frame_id}")
            return
        try:
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", str(error))
            return
        with self._lock:
            self._tracks[name].add(message.header.stamp.to_sec(), T_odom_body)

    def _on_tags(self, message: TagDetections, name: str) -> None:
        if message.vehicle != name:
            self._health.drop("detections", f"{name} sends those of '{message.vehicle}'")
            return
        with self._lock:
            if self._collecting:
                self._collected.setdefault(name, []).append(message)

    def _on_calibrate(self, request) -> CalibrateResponse:
        column = list(request.column) or self._names
        try:
            links = self._calibrate(column, request.duration_s or self._rules.duration_s)
        except FcsvError as error:
            rospy.logwarn("calibration refused: %s", error)
            return CalibrateResponse(False, str(error), Calibration())
        message = Calibration(header=conversions.header(rospy.get_time(), frames.odom(column[0])))
        message.links = [link_messages.to_message(link) for link in links]
        self._calibrated = set(column)
        self._calibration.publish(message)
        text = "; ".join(_in_words(link) for link in links)
        rospy.loginfo("calibrated: %s", text)
        return CalibrateResponse(True, text, message)

    def _calibrate(self, column: List[str], duration_s: float) -> List[Link]:
        unknown = [n for n in column if n not in self._vehicles]
        if unknown or len(column) < 2:
            raise TrackingError(f"a column needs two known vehicles or more, front first; got {column}")
        with self._lock:
            if self._collecting:
                raise TrackingError("a calibration is already running")
            self._collecting, self._collected = True, {}
        rospy.sleep(duration_s)
        with self._lock:
            self._collecting = False
            collected = self._collected
        return [
            calibrate_link(front, back, self._detections(front, back, collected.get(back, [])), self._rules)
            for front, back in zip(column, column[1:])
        ]

    def _detections(self, front: str, back: str, messages: List[TagDetections]) -> List[Detection]:
        tag_id, T_body_tag = self._vehicles[front].tag_id, self._vehicles[front].T_body_tag
        found, without_pose = [], 0
        for message in messages:
            for tag in message.detections:
                if tag.id != tag_id:
                    continue
                stamp_s = message.header.stamp.to_sec()
                try:
                    with self._lock:
                        T_odom_tag = self._tracks[front].at(stamp_s) @ T_body_tag
                    T_odom_cam = conversions.pose_to_transform(message.camera_in_odom)
                except FcsvError:
                    without_pose += 1
                    continue
                corners = np.array(tag.corners_normalized).reshape(4, 2)
                found.append(Detection(stamp_s, corners, tag.size_m, message.focal_px, T_odom_cam, T_odom_tag))
        if without_pose > len(found):
            raise CalibrationRefused(
                f"{without_pose} of {len(messages)} pictures of {back} have no pose of {front} at their stamp: "
                f"check the radio link and that the clocks agree (chrony)"
            )
        return found

    def _on_set_home(self, request) -> SetHomeResponse:
        reference = request.reference or self._names[0]
        try:
            home = self._home_message(reference)
        except FcsvError as error:
            return SetHomeResponse(False, str(error), Home())
        self._home.publish(home)
        text = f"home is where the camera of {reference} is now"
        rospy.loginfo("%s", text)
        return SetHomeResponse(True, text, home)

    def _home_message(self, reference: str) -> Home:
        if reference not in self._vehicles:
            raise TrackingError(f"'{reference}' is not a vehicle here; known: {', '.join(self._names)}")
        if reference not in self._calibrated:
            raise TrackingError(f"{reference} is not calibrated yet: calibrate the column first")
        with self._lock:
            stamp_s, T_odom_body = self._tracks[reference].latest()
        age_s = rospy.get_time() - stamp_s
        if age_s > _OLDEST_ODOMETRY_S:
            raise PoseUnavailable(
                f"the odometry of {reference} is {age_s:.1f} s old: check its link, then set home again"
            )
        T_odom_home = home_of(T_odom_body @ self._vehicles[reference].T_body_cam)
        home = Home(header=conversions.header(stamp_s, frames.odom(reference)), reference=reference)
        home.home_in_odom = conversions.transform_to_pose(T_odom_home)
        return home


def _in_words(link: Link) -> str:
    yaw_std_deg = np.degrees(np.sqrt(link.covariance[3, 3]))
    return (
        f"{link.child} against {link.parent}: {link.used} detections ({link.rejected} rejected), "
        f"spread {link.position_spread_m * 100:.1f} cm, yaw std {yaw_std_deg:.2f} deg"
    )


def main() -> None:
    """Run the node."""
    rospy.init_node("calibration")
    CalibrationNode()
    rospy.spin()
