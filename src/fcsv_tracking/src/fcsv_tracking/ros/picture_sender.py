# SPDX-License-Identifier: Apache-2.0
"""Pictures that leave the vehicle over the radio: small previews always, good ones with their pose
while recording."""

from dataclasses import dataclass

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Bool

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.streams.flow import PhaseGate
from fcsv_msgs.msg import CapturedPicture, ClockOffset
from fcsv_tracking.devices.clocks import in_words
from fcsv_tracking.ros import clock_node


@dataclass(frozen=True)
class SendingParameters:
    """Rates (Hz; 0: never) and JPEG qualities. ``capture_always``: not only while the recorder
    takes pictures."""

    preview_rate_hz: float = 1.0
    preview_quality: int = 70
    capture_rate_hz: float = 2.0
    capture_quality: int = 95
    capture_always: bool = False
    # a picture by a clock that is further off is not sent for a map
    most_clock_offset_s: float = 0.05

    def __post_init__(self):
        for name in ("preview_rate_hz", "capture_rate_hz"):
            if not 0.0 <= getattr(self, name) <= 30.0:
                raise ValueError(f"{name}: {getattr(self, name)} is not in 0..30")
        if not self.most_clock_offset_s > 0:
            raise ValueError(f"most_clock_offset_s: {self.most_clock_offset_s} must be positive")
        for name in ("preview_quality", "capture_quality"):
            if not 10 <= getattr(self, name) <= 100:
                raise ValueError(f"{name}: {getattr(self, name)} is not in 10..100")


class PictureSender:
    """Publishes camera/color/image_raw/compressed and capture/picture, where somebody listens.

    Of cameras in phase all vehicles send the pictures of the same moments.
    """

    def __init__(self, vehicle: str, parameters: SendingParameters, health: Health):
        self._vehicle, self._parameters, self._health = vehicle, parameters, health
        self._clock_off = False
        self._recording = parameters.capture_always
        self._preview = rospy.Publisher(
            "camera/color/image_raw/compressed", CompressedImage, queue_size=1
        )
        self._capture = rospy.Publisher("capture/picture", CapturedPicture, queue_size=3)
        rates_hz = {
            self._preview: parameters.preview_rate_hz,
            self._capture: parameters.capture_rate_hz,
        }
        self._gates = {publisher: PhaseGate(hz) for publisher, hz in rates_hz.items() if hz}
        rospy.Subscriber("clock/offset", ClockOffset, self._on_clock, queue_size=1)
        rospy.Subscriber("recorder/pictures", Bool, self._on_recording, queue_size=1)

    def _on_recording(self, message: Bool) -> None:
        self._recording = message.data or self._parameters.capture_always

    def _on_clock(self, message: ClockOffset) -> None:
        offset = clock_node.from_message(message)
        self._clock_off = offset.beyond(self._parameters.most_clock_offset_s)
        self._health.problem("clock", in_words(self._vehicle, offset) if self._clock_off else "")

    def preview(self, message: Image, bgr: np.ndarray) -> None:
        """Sends a preview for people."""
        if self._due(self._preview, message):
            jpeg = _jpeg(bgr, self._parameters.preview_quality)
            self._preview.publish(CompressedImage(header=message.header, format="jpeg", data=jpeg))

    def wants_capture(self, message: Image) -> bool:
        """Whether this picture is to be sent with its pose. By a clock that is off it would be
        placed wrongly."""
        if not (self._recording and self._due(self._capture, message)):
            return False
        if self._clock_off:
            self._health.drop("picture for the map", "this machine's clock is off")
        return not self._clock_off

    def capture(
        self, message: Image, bgr: np.ndarray, info: CameraInfo, T_odom_cam: np.ndarray
    ) -> None:
        """Sends a picture for a map made in flight."""
        out = CapturedPicture(vehicle=self._vehicle, camera=info, format="jpeg")
        out.header = conversions.header(
            message.header.stamp.to_sec(), frames.camera_optical(self._vehicle)
        )
        out.header.stamp = message.header.stamp
        out.camera_in_odom = conversions.transform_to_pose(T_odom_cam)
        out.data = _jpeg(bgr, self._parameters.capture_quality)
        self._capture.publish(out)

    def _due(self, publisher: rospy.Publisher, message: Image) -> bool:
        gate = self._gates.get(publisher)
        return (
            gate is not None
            and publisher.get_num_connections() > 0
            and gate.passes(message.header.stamp.to_sec())
        )


def _jpeg(bgr: np.ndarray, quality: int) -> bytes:
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()
