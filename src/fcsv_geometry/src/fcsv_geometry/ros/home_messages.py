# SPDX-License-Identifier: Apache-2.0
"""/calibration and /home as what fcsv_geometry.home composes."""

from typing import List

import numpy as np

from fcsv_geometry.home import HomeFrames, OdomLink
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Calibration, CalibrationLink, Home


def link_from_message(message: CalibrationLink) -> OdomLink:
    """Raises GeometryError where the pose is none."""
    T_parent_child = conversions.pose_to_transform(message.child_odom_in_parent_odom)
    return OdomLink(message.parent, message.child, T_parent_child, np.array(message.covariance).reshape(4, 4))


def links_from_message(message: Calibration) -> List[OdomLink]:
    """Raises GeometryError where a pose is none."""
    return [link_from_message(link) for link in message.links]


def take_calibration(frames: HomeFrames, message: Calibration) -> None:
    """Compose with a new calibration. Raises GeometryError where a pose is none; the frames are then as before."""
    frames.calibrate(links_from_message(message))


def take_home(frames: HomeFrames, message: Home) -> None:
    """Compose with a new home. Raises GeometryError where the pose is none; the frames are then as before."""
    frames.set_home(message.reference, conversions.pose_to_transform(message.home_in_odom))
