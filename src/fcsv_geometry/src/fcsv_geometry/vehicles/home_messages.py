# SPDX-License-Identifier: Apache-2.0
"""/calibration and /home (fcsv_msgs/Calibration, Home) as what fcsv_geometry.home composes. No ROS
is needed."""

from typing import List

import numpy as np

from fcsv_geometry.home import HomeFrames, OdomLink
from fcsv_geometry.messages import pose_to_transform, seconds


def link_from_message(message) -> OdomLink:
    """Raises GeometryError where the pose is none."""
    T_parent_child = pose_to_transform(message.child_odom_in_parent_odom)
    return OdomLink(
        message.parent, message.child, T_parent_child, np.array(message.covariance).reshape(4, 4)
    )


def links_from_message(message) -> List[OdomLink]:
    """Raises GeometryError where a pose is none."""
    return [link_from_message(link) for link in message.links]


def apply_calibration(frames: HomeFrames, message) -> None:
    """Compose with a new calibration, for what comes after its stamp. Raises GeometryError where a
    pose is none; the frames are then as before."""
    frames.calibrate(links_from_message(message), seconds(message.header.stamp))


def apply_home(frames: HomeFrames, message) -> None:
    """Compose with a new home. Raises GeometryError where the pose is none; the frames are then as
    before."""
    frames.set_home(message.reference, pose_to_transform(message.home_in_odom))
