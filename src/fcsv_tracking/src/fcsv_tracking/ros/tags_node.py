# SPDX-License-Identifier: Apache-2.0
"""Tag detection on board: every picture's tags with the pose of the camera at that moment, and a small preview."""

import threading
import time
from typing import Optional

import cv2
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from fcsv_geometry import frames
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.trajectory import Trajectory
from fcsv_geometry.vehicle import load_vehicles
from fcsv_msgs.msg import TagDetection, TagDetections
from fcsv_tracking.tags import TagDetector, TagObservation

_WAIT_FOR_ODOMETRY_S = 0.15


class TagsNode:
    """The newest picture wins; pictures beyond rate_hz are left alone."""

    def __init__(self):
        self._name = rospy.get_param("~vehicle")
        names = list(rospy.get_param("~vehicles"))
        vehicles = load_vehicles(rospy.get_param("~vehicles_dir"), names)
        self._T_body_cam = vehicles[self._name].T_body_cam
        self._period_s = 1.0 / rospy.get_param("~rate_hz", 6.0)
        self._preview_period_s = 1.0 / rospy.get_param("~preview_rate_hz", 1.0)
        sizes_m = {v.tag_id: v.tag_size_m for n, v in vehicles.items() if n != self._name}
        self._detector = TagDetector(sizes_m, rospy.get_param("~decimate", 1.0))
        self._track = Trajectory(gap_s=0.1, keep_s=3.0)
        self._track_grew = threading.Condition()
        self._camera: Optional[PinholeCamera] = None
        self._picture: Optional[Image] = None
        self._picture_came = threading.Condition()
        self._next_preview_s = 0.0
        self._health = Health(self._name, {"pictures": 1.0})
        self._health.problem("camera_info", f"{self._name}: no camera_info yet; pictures cannot be used")
        self._detections = rospy.Publisher("tags/detections", TagDetections, queue_size=5)
        self._preview = rospy.Publisher("camera/color/image_raw/compressed", CompressedImage, queue_size=1)
        rospy.Subscriber("odometry/body", Odometry, self._on_odometry, queue_size=50, tcp_nodelay=True)
        rospy.Subscriber("camera/color/camera_info", CameraInfo, self._on_info, queue_size=1)
        rospy.Subscriber("camera/color/image_raw", Image, self._on_picture, queue_size=1, buff_size=4 << 20)

    def _on_odometry(self, message: Odometry) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", str(error))
            return
        with self._track_grew:
            self._track.add(message.header.stamp.to_sec(), T_odom_body)
            self._track_grew.notify_all()

    def _on_info(self, message: CameraInfo) -> None:
        try:
            self._camera = conversions.camera_from_info(message)
        except FcsvError as error:
            self._health.problem("camera_info", f"{self._name}: {error}")
            return
        self._health.problem("camera_info", "")

    def _on_picture(self, message: Image) -> None:
        with self._picture_came:
            self._picture = message
            self._picture_came.notify()

    def spin(self) -> None:
        """Detect in the newest picture, at most at the configured rate."""
        next_s = 0.0
        while not rospy.is_shutdown():
            with self._picture_came:
                if self._picture is None:
                    self._picture_came.wait(0.2)
                message, self._picture = self._picture, None
            if message is None or self._camera is None or message.header.stamp.to_sec() < next_s:
                continue
            next_s = message.header.stamp.to_sec() + 0.9 * self._period_s
            try:
                self._process(message)
            except FcsvError as error:
                self._health.drop("picture", str(error))

    def _process(self, message: Image) -> None:
        stamp_s = message.header.stamp.to_sec()
        picture = conversions.image_to_array(message, "bgr8")
        gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        observations = self._detector.detect(gray, self._camera)
        self._publish_preview(message, picture, stamp_s)
        T_odom_cam = self._body_at(stamp_s) @ self._T_body_cam
        out = TagDetections(header=conversions.header(stamp_s, frames.camera_optical(self._name)))
        out.vehicle, out.focal_px = self._name, (self._camera.fx + self._camera.fy) / 2.0
        out.camera_in_odom = conversions.transform_to_pose(T_odom_cam)
        out.detections = [_message(o) for o in observations]
        self._detections.publish(out)
        self._health.tick("pictures")

    def _body_at(self, stamp_s: float):
        """T_odom_body at a picture's stamp; odometry that is still under way is waited for."""
        deadline = time.monotonic() + _WAIT_FOR_ODOMETRY_S
        with self._track_grew:
            while len(self._track) == 0 or self._track.span_s[1] < stamp_s:
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    raise PoseUnavailable("no odometry at the picture's stamp")
                self._track_grew.wait(left_s)
            return self._track.at(stamp_s)

    def _publish_preview(self, message: Image, picture, stamp_s: float) -> None:
        if stamp_s < self._next_preview_s or self._preview.get_num_connections() == 0:
            return
        self._next_preview_s = stamp_s + self._preview_period_s
        _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 70])
        self._preview.publish(CompressedImage(header=message.header, format="jpeg", data=jpeg.tobytes()))


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


def main() -> None:
    """Run the node."""
    rospy.init_node("tags")
    TagsNode().spin()
