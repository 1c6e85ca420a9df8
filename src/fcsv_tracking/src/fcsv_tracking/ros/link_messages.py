# SPDX-License-Identifier: Apache-2.0
"""Calibration links as messages and back."""

import numpy as np

from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicles import home_messages
from fcsv_msgs.msg import CalibrationLink
from fcsv_tracking.column.calibration import Link


def to_message(link: Link) -> CalibrationLink:
    return CalibrationLink(
        parent=link.parent,
        child=link.child,
        child_odom_in_parent_odom=conversions.transform_to_pose(link.T_parent_child),
        covariance=np.asarray(link.covariance).ravel().tolist(),
        position_spread_m=link.position_spread_m,
        yaw_spread_rad=link.yaw_spread_rad,
        reprojection_rms_px=link.reprojection_rms_px,
        used=link.used,
        rejected=link.rejected,
    )


def from_message(message: CalibrationLink) -> Link:
    """Raises GeometryError where the pose is none."""
    link = home_messages.link_from_message(message)
    return Link(
        link.parent,
        link.child,
        link.T_parent_child,
        link.covariance,
        message.position_spread_m,
        message.yaw_spread_rad,
        message.reprojection_rms_px,
        message.used,
        message.rejected,
    )
