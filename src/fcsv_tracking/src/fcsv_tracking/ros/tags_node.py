# SPDX-License-Identifier: Apache-2.0
"""Tag detection on board: every picture's tags with the pose of the camera at that moment, and a
small preview."""

import threading
from dataclasses import dataclass, field
from typing import List, Optional

import cv2
import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry import frames
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.streams.flow import RateGate
from fcsv_msgs.msg import Epoch, SceneMotion, TagDetection, TagDetections
from fcsv_tracking.robot_tags import load_robot_tags
from fcsv_tracking.ros.body_odometry import BodyAtStamp
from fcsv_tracking.ros.picture_sender import PictureSender, SendingParameters
from fcsv_tracking.scene.scene_motion import SceneWatch
from fcsv_tracking.tags import ON_BOARD_DECIMATE, TagDetector, TagObservation

_GAP_S, _WAIT_FOR_ODOMETRY_S = 0.1, 0.15
_FOLLOW_S = 2.0  # how long after a tag was seen every picture is looked at


@dataclass(frozen=True)
class TagsParameters:
    """Parameters of the node. ``search_rate_hz`` counts while no picture shows a vehicle's tag:
    looking at a picture costs as much as all else on board together. ``decimate`` shrinks pictures
    before quads are sought in them. ``robot``: file of a robot on the ground whose tags are read,
    too; empty: none."""

    vehicle: str
    vehicles: List[str]
    vehicles_dir: str
    robot: str = ""
    rate_hz: float = 6.0
    search_rate_hz: float = 2.0
    scene_rate_hz: float = 3.0  # of the comparison of pictures with the tracker's motion
    decimate: float = ON_BOARD_DECIMATE
    sending: SendingParameters = field(default_factory=SendingParameters)

    def __post_init__(self):
        for name in ("rate_hz", "search_rate_hz", "scene_rate_hz"):
            if not 0.1 <= getattr(self, name) <= 60.0:
                raise ValueError(f"{name}: {getattr(self, name)} is not in 0.1..60")
        if not 1.0 <= self.decimate <= 4.0:
            raise ValueError(f"decimate: {self.decimate} is not in 1..4")


class TagsNode:
    """The newest picture wins; pictures beyond the rate are left alone. What is sent over the radio
    goes through here, too: one process on board that takes pictures in."""

    def __init__(self):
        parameters = node.parameters(TagsParameters)
        self._name = parameters.vehicle
        vehicles = node.vehicles(parameters.vehicles_dir, [*parameters.vehicles, self._name])
        self._T_body_cam = vehicles[self._name].T_body_cam
        self._rate_hz, self._search_rate_hz = parameters.rate_hz, parameters.search_rate_hz
        self._gate, self._seen_s = RateGate(parameters.search_rate_hz), 0.0
        self._scene_gate, self._scene = RateGate(parameters.scene_rate_hz), SceneWatch()
        self._epoch = self._scene_epoch = 0  # of the odometry
        self._health = Health(self._name, {"pictures": 1.0})
        self._sender = PictureSender(self._name, parameters.sending, self._health)
        self._others = [n for n in vehicles if n != self._name]
        sizes_m = {v.tag_id: v.tag_size_m for n, v in vehicles.items() if n != self._name}
        self._column_ids = set(sizes_m)
        if parameters.robot:
            tags = load_robot_tags(parameters.robot, vehicles)
            sizes_m.update({i: t.size_m for i, t in tags.items()})
        self._detector = TagDetector(sizes_m, parameters.decimate, sharp=True)
        self._track = BodyAtStamp(self._name, self._health, _GAP_S, _WAIT_FOR_ODOMETRY_S)
        self._camera: Optional[PinholeCamera] = None
        self._info: Optional[CameraInfo] = None
        self._picture: Optional[Image] = None
        self._picture_came = threading.Condition()
        self._health.problem(
            "camera_info", f"{self._name}: no camera_info yet; pictures cannot be used"
        )
        self._detections = rospy.Publisher("tags/detections", TagDetections, queue_size=5)
        self._scene_motion = rospy.Publisher(
            "tags/scene_motion", SceneMotion, queue_size=2, tcp_nodelay=True
        )
        rospy.Subscriber(
            "odometry/epoch", Epoch, lambda m: setattr(self, "_epoch", m.epoch), queue_size=1
        )
        rospy.Subscriber("camera/color/camera_info", CameraInfo, self._on_info, queue_size=1)
        rospy.Subscriber(
            "camera/color/image_raw", Image, self._on_picture, queue_size=1, buff_size=4 << 20
        )

    def _on_info(self, message: CameraInfo) -> None:
        try:
            if self._info is None or _intrinsics(message) != _intrinsics(self._info):
                self._camera = conversions.camera_from_info(message)
            self._info = message
        except FcsvError as error:
            self._health.problem("camera_info", f"{self._name}: {error}")
            return
        self._health.problem("camera_info", "")

    def _on_picture(self, message: Image) -> None:
        if any(message.header.frame_id.startswith(f"{other}/") for other in self._others):
            self._health.drop(
                "picture", f"is of frame {message.header.frame_id}, another vehicle's"
            )
            return
        with self._picture_came:
            self._picture = message
            self._picture_came.notify()

    def spin(self) -> None:
        """Processes one picture after the other; of those that come meanwhile only the newest."""
        while not rospy.is_shutdown():
            with self._picture_came:
                if self._picture is None:
                    self._picture_came.wait(0.2)
                message, self._picture = self._picture, None
            if message is None or self._camera is None:
                continue
            try:
                self._process(message)
            except FcsvError as error:
                self._health.drop("picture", str(error))

    def _process(self, message: Image) -> None:
        stamp_s = message.header.stamp.to_sec()
        look, compare = self._gate.due(stamp_s), self._scene_gate.passes(stamp_s)
        send = self._sender.wants_capture(message)
        if not (look or compare or send):
            return
        picture = conversions.image_to_array(message, "bgr8")
        try:
            grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if look or compare else None
            if look:
                observations = self._detect(grey, stamp_s)
            T_odom_cam = self._track.at(stamp_s) @ self._T_body_cam
            if look:
                self._publish(observations, T_odom_cam, stamp_s)
            if compare:
                self._compare(grey, T_odom_cam, stamp_s)
        finally:
            self._sender.preview(message, picture)  # last: nobody flies by it
        if send:
            self._sender.capture(message, picture, self._info, T_odom_cam)

    def _detect(self, grey, stamp_s: float) -> List[TagObservation]:
        observations = self._detector.detect(grey, self._camera)
        for reason, count in self._detector.rejected.items():
            self._health.value(f"tags rejected: {reason}", count)
        if any(o.id in self._column_ids for o in observations):
            self._seen_s = stamp_s
        following = stamp_s - self._seen_s < _FOLLOW_S
        self._gate.admit(stamp_s, self._rate_hz if following else self._search_rate_hz)
        return observations

    def _publish(self, observations: List[TagObservation], T_odom_cam, stamp_s: float) -> None:
        out = TagDetections(header=conversions.header(stamp_s, frames.camera_optical(self._name)))
        out.vehicle, out.focal_px = self._name, (self._camera.fx + self._camera.fy) / 2.0
        out.camera_in_odom = conversions.transform_to_pose(T_odom_cam)
        out.detections = [_message(o) for o in observations]
        self._detections.publish(out)
        self._health.tick("pictures")

    def _compare(self, grey, T_odom_cam, stamp_s: float) -> None:
        """The picture against the tracker's motion: what the flight link believes the tracker
        by."""
        if self._scene_epoch != self._epoch:
            self._scene_epoch = self._epoch
            self._scene.begin_again()
        seen = self._scene.observe(stamp_s, grey, self._camera, T_odom_cam)
        if seen is not None:
            header = conversions.header(stamp_s, frames.camera_optical(self._name))
            look = (seen.span_s, seen.off_rad, seen.turn_rad, seen.points, seen.one_way)
            self._scene_motion.publish(SceneMotion(header, *look))


def _intrinsics(info: CameraInfo) -> tuple:
    return info.width, info.height, info.distortion_model, info.K, info.D


def _message(o: TagObservation) -> TagDetection:
    return TagDetection(
        id=o.id,
        size_m=o.size_m,
        corners_px=o.corners_px.ravel().tolist(),
        corners_normalized=o.corners_normalized.ravel().tolist(),
        decision_margin=o.decision_margin,
        hamming=o.hamming,
        tag_in_camera=conversions.transform_to_pose(o.T_cam_tag),
        reprojection_rms_px=o.reprojection_rms_px,
    )


def main() -> int:
    """Run the node."""
    return node.run("tags", TagsNode)
