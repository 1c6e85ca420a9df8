# SPDX-License-Identifier: Apache-2.0
"""Previews that crossed the radio as JPEG, as pictures for rviz and whoever else looks on the
control PC."""

from dataclasses import dataclass
from typing import List

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import CompressedImage, Image

from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health


@dataclass(frozen=True)
class PreviewsParameters:
    """Parameters of the node."""

    vehicles: List[str]


class PreviewsNode:
    """NAME/camera/color/image_raw of every vehicle, unpacked only while somebody looks."""

    def __init__(self):
        self._health = Health("previews")
        for name in node.parameters(PreviewsParameters).vehicles:
            topic = f"/{name}/camera/color/image_raw"
            out = rospy.Publisher(topic, Image, queue_size=1)
            rospy.Subscriber(
                f"{topic}/compressed", CompressedImage, self._on_picture, (name, out), queue_size=1
            )

    def _on_picture(self, message: CompressedImage, to) -> None:
        name, out = to
        if out.get_num_connections() == 0:
            return
        bgr = (
            cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
            if message.data
            else None
        )
        if bgr is None:
            self._health.drop(
                "preview",
                f"{name}'s is no picture ({len(message.data)} octets of '{message.format}')",
            )
            return
        picture = conversions.array_to_image(bgr, "bgr8", 0.0, "")
        picture.header = message.header
        out.publish(picture)


def main() -> int:
    """Run the node."""
    return node.run("previews", PreviewsNode)
