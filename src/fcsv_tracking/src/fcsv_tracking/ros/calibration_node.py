# SPDX-License-Identifier: Apache-2.0
"""The control PC's services /calibrate and /set_home, and what they find as latched topics."""

import threading
import time
from dataclasses import dataclass, field, replace
from typing import Dict, List, Tuple

import numpy as np
import rospy
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_geometry.home import home_of
from fcsv_geometry.phases import BY_HOME
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.tracker import load_profile
from fcsv_geometry.trajectory import Trajectory
from fcsv_msgs.msg import Calibration, ClockOffset, Epochs, Home, MissionState, TagDetections
from fcsv_msgs.srv import Calibrate, CalibrateResponse, SetHome, SetHomeResponse
from fcsv_tracking.calibration import CalibrationRules, Link, calibrate_link
from fcsv_tracking.clocks import difference
from fcsv_tracking.detection import Detection
from fcsv_tracking.errors import CalibrationRefused, TrackingError
from fcsv_tracking.loops import merge_loops
from fcsv_tracking.ros import clock_node, epoch_watch, link_messages

_OLDEST_ODOMETRY_S = 0.5
_SET_BACK_S = 0.3
_PLENTY = 1.25  # times the least: a few are always refused
_SILENT_S = 4.0  # a link that shows no tag for so long will not get enough


@dataclass(frozen=True)
class CalibrationParameters:
    """Parameters of the node; the vehicles are a column, front first.

    ``tracker_profile``: config/trackers/NAME.yaml, in place of ``rules.tracker``.
    """

    vehicles: List[str]
    vehicles_dir: str
    rules: CalibrationRules = field(default_factory=CalibrationRules)
    tracker_profile: str = ""


class CalibrationNode:
    """Listens always, collects while a calibration runs."""

    def __init__(self):
        parameters = node.parameters(CalibrationParameters)
        self._names, self._rules = parameters.vehicles, parameters.rules
        if parameters.tracker_profile:
            self._rules = replace(self._rules, tracker=load_profile(parameters.tracker_profile))
        self._vehicles = node.vehicles(parameters.vehicles_dir, self._names)
        self._lock = threading.Lock()
        self._tracks: Dict[str, Trajectory] = {n: _new_track() for n in self._names}
        self._collected: Dict[str, List[TagDetections]] = {}
        self._collecting = False
        self._calibrated: set = set()
        self._tags_came_s: Dict[str, List[float]] = {}
        self._came_s: Dict[str, float] = {}  # the newest odometry, by the monotonic clock
        self._clocks: Dict[str, ClockOffset] = {}
        self._phase = ""  # the mission's
        self._health = Health("control")
        self._calibration = rospy.Publisher("/calibration", Calibration, queue_size=1, latch=True)
        self._home = rospy.Publisher("/home", Home, queue_size=1, latch=True)
        self._epochs = epoch_watch.EpochWatch(self._names)
        self._calibration_epochs = rospy.Publisher("/calibration_epochs", Epochs, queue_size=1, latch=True)
        self._home_epochs = rospy.Publisher("/home_epochs", Epochs, queue_size=1, latch=True)
        rospy.Service("/calibrate", Calibrate, self._on_calibrate)
        rospy.Service("/set_home", SetHome, self._on_set_home)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)
        for name in self._names:
            rospy.Subscriber(f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=30)
            rospy.Subscriber(f"/{name}/tags/detections", TagDetections, self._on_tags, name, queue_size=30)
            rospy.Subscriber(f"/{name}/clock/offset", ClockOffset, self._on_clock, name, queue_size=1)

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
            newer = self._track(name, message.header.stamp.to_sec()).add(message.header.stamp.to_sec(), T_odom_body)
            if newer:
                self._came_s[name] = time.monotonic()
        if not newer:
            self._health.drop("odometry", f"{name}'s stamp goes back")

    def _track(self, name: str, stamp_s: float) -> Trajectory:
        """A vehicle's track; a new one where its clock was set back."""
        try:
            back = stamp_s < self._tracks[name].latest()[0] - _SET_BACK_S
        except PoseUnavailable:
            back = False
        if back:
            self._tracks[name] = _new_track()
        return self._tracks[name]

    def _on_clock(self, message: ClockOffset, name: str) -> None:
        self._clocks[name] = clock_node.from_message(message)

    def _on_tags(self, message: TagDetections, name: str) -> None:
        if message.vehicle != name:
            self._health.drop("detections", f"{name} sends those of '{message.vehicle}'")
            return
        with self._lock:
            if self._collecting:
                self._collected.setdefault(name, []).append(message)
                self._tags_came_s.setdefault(name, []).append(time.monotonic())

    def _on_mission(self, message: MissionState) -> None:
        self._phase = message.phase_name

    def _require_nobody_flies_by_it(self, what: str) -> None:
        """Raises TrackingError from GUIDED on: another calibration or home would move every place that is flown to."""
        if self._phase in BY_HOME:
            raise TrackingError(f"{what} is refused while the mission flies the vehicles ({self._phase}): land first")

    def _on_calibrate(self, request) -> CalibrateResponse:
        column = list(request.column) or self._names
        epochs = self._epochs.now(column)
        try:
            self._require_nobody_flies_by_it("a calibration")
            stamp_s, links = self._calibrate(column, request.duration_s)
            self._epochs.require_same(epochs)
            self._require_nobody_flies_by_it("a calibration")
        except FcsvError as error:
            rospy.logwarn("calibration refused: %s", error)
            return CalibrateResponse(False, str(error), Calibration())
        message = Calibration(header=conversions.header(stamp_s, frames.odom(column[0])))
        message.links = [link_messages.to_message(link) for link in links]
        self._calibrated = set(column)
        self._calibration.publish(message)
        self._calibration_epochs.publish(epoch_watch.to_message(message.header.stamp, epochs))
        text = "; ".join(_in_words(link) for link in links)
        rospy.loginfo("calibrated: %s", text)
        return CalibrateResponse(True, text, message)

    def _calibrate(self, column: List[str], duration_s: float) -> Tuple[float, List[Link]]:
        """The links, and the stamp (s) that all hold for: what the vehicles fly after it adds to their errors."""
        unknown = [n for n in column if n not in self._vehicles]
        if unknown or len(column) < 2:
            raise TrackingError(f"a column needs two known vehicles or more, front first; got {column}")
        with self._lock:
            if self._collecting:
                raise TrackingError("a calibration is already running")
            self._collecting, self._collected, self._tags_came_s = True, {}, {}
        rospy.sleep(duration_s or self._rules.duration_s)
        if not duration_s:
            self._wait_for_enough(column, self._rules.longest_s - self._rules.duration_s)
        with self._lock:
            self._collecting = False
            collected = self._collected
        links, ends_s = [], []
        for front, back in zip(column, column[1:]):
            seen = self._seen(front, back, collected)
            links.append(calibrate_link(front, back, seen, self._rules))
            ends_s.append(max(d.stamp_s for d in seen))
        return min(ends_s), merge_loops(links, self._loops(column, collected))

    def _wait_for_enough(self, column: List[str], most_s: float) -> None:
        """Go on collecting while every link gets detections, until all have plenty or the time is over."""
        end_s, plenty = time.monotonic() + most_s, _PLENTY * self._rules.least_detections
        while time.monotonic() < end_s and not rospy.is_shutdown():
            with self._lock:
                seen = [self._seen_at_s(front, back) for front, back in zip(column, column[1:])]
            silent = [s for s in seen if not s or time.monotonic() - s[-1] > _SILENT_S]
            if silent or all(len(s) >= plenty for s in seen):
                return
            rospy.sleep(0.2)

    def _seen_at_s(self, front: str, back: str) -> List[float]:
        """When pictures of ``back`` came in which it sees ``front``, by the monotonic clock."""
        tag_id = self._vehicles[front].tag_id
        came = zip(self._tags_came_s.get(back, []), self._collected.get(back, []))
        return [came_s for came_s, m in came if any(tag.id == tag_id for tag in m.detections)]

    def _seen(self, front: str, back: str, collected: Dict[str, List[TagDetections]]) -> List[Detection]:
        self._require_one_time(front, back)
        return self._detections(front, back, collected.get(back, []))

    def _loops(self, column: List[str], collected: Dict[str, List[TagDetections]]) -> List[Link]:
        """What vehicles see of tags further ahead, where that is good enough; the column does not depend on it."""
        found = []
        for i, back in enumerate(column):
            for front in column[: max(i - 1, 0)]:
                try:
                    found.append(calibrate_link(front, back, self._seen(front, back, collected), self._rules))
                except CalibrationRefused as error:
                    rospy.logdebug("no loop from %s to %s: %s", front, back, error)
        return found

    def _require_one_time(self, front: str, back: str) -> None:
        apart = difference(self._clocks.get(front), self._clocks.get(back))
        if apart is not None and abs(apart[0]) - apart[1] > self._rules.most_clock_offset_s:
            raise CalibrationRefused(
                f"the clocks of {front} and {back} differ by {apart[0]:.3f} s (bound "
                f"{self._rules.most_clock_offset_s} s): start chrony on both, with the control PC as server"
            )

    def _detections(self, front: str, back: str, messages: List[TagDetections]) -> List[Detection]:
        tag_id, found, without_pose = self._vehicles[front].tag_id, [], 0
        for message in messages:
            seen = [tag for tag in message.detections if tag.id == tag_id]
            if len(seen) > 1:
                self._health.drop("detections", f"{back} sees {len(seen)} tags of {front}'s id {tag_id}")
                continue
            for tag in seen:
                try:
                    found.append(self._detection(front, message, tag))
                except CalibrationRefused:
                    raise
                except FcsvError:
                    without_pose += 1
        if without_pose > len(found):
            raise CalibrationRefused(
                f"{without_pose} of {len(messages)} pictures of {back} have no pose of {front} at their stamp: "
                f"check the radio link and that the clocks agree (chrony)"
            )
        return found

    def _detection(self, front: str, message: TagDetections, tag) -> Detection:
        """Raises PoseUnavailable, GeometryError, or TrackingError where the message is none that can be used."""
        vehicle, stamp_s = self._vehicles[front], message.header.stamp.to_sec()
        corners = np.array(tag.corners_normalized).reshape(4, 2)
        if not (np.isfinite(corners).all() and np.isfinite(message.focal_px) and message.focal_px > 0):
            raise TrackingError("corners or focal length are not finite")
        if not np.isclose(tag.size_m, vehicle.tag_size_m, rtol=1e-3):
            raise CalibrationRefused(
                f"{message.vehicle} takes {front}'s tag to be {tag.size_m:g} m wide, {front}'s file says "
                f"{vehicle.tag_size_m:g} m: give both machines the same files"
            )
        with self._lock:
            T_odom_tag = self._tracks[front].at(stamp_s) @ vehicle.T_body_tag
        T_odom_cam = conversions.pose_to_transform(message.camera_in_odom)
        return Detection(stamp_s, corners, tag.size_m, message.focal_px, T_odom_cam, T_odom_tag)

    def _on_set_home(self, request) -> SetHomeResponse:
        reference = request.reference or self._names[0]
        try:
            self._require_nobody_flies_by_it("a new home")
            home = self._home_message(reference)
        except FcsvError as error:
            return SetHomeResponse(False, str(error), Home())
        self._home.publish(home)
        self._home_epochs.publish(epoch_watch.to_message(home.header.stamp, self._epochs.now([reference])))
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
            age_s = time.monotonic() - self._came_s[reference]
        if age_s > _OLDEST_ODOMETRY_S:
            raise PoseUnavailable(
                f"the odometry of {reference} is {age_s:.1f} s old: check its link, then set home again"
            )
        T_odom_home = home_of(T_odom_body @ self._vehicles[reference].T_body_cam)
        home = Home(header=conversions.header(stamp_s, frames.odom(reference)), reference=reference)
        home.home_in_odom = conversions.transform_to_pose(T_odom_home)
        return home


def _new_track() -> Trajectory:
    return Trajectory(gap_s=0.15, keep_s=60.0)


def _in_words(link: Link) -> str:
    yaw_std_deg = np.degrees(np.sqrt(link.covariance[3, 3]))
    return (
        f"{link.child} against {link.parent}: {link.used} detections ({link.rejected} rejected), "
        f"spread {link.position_spread_m * 100:.1f} cm, yaw std {yaw_std_deg:.2f} deg"
    )


def main() -> int:
    """Run the node."""
    return node.run("calibration", CalibrationNode)
