# SPDX-License-Identifier: Apache-2.0
"""T_home_cam as every tracker publishes it."""

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions


def camera_message(
    stamp_s: float, T_home_cam: np.ndarray, covariance: np.ndarray
) -> PoseWithCovarianceStamped:
    """Covariance (6,6) of position (m) and rotation (rad) about home's axes."""
    out = PoseWithCovarianceStamped(header=conversions.header(stamp_s, frames.HOME))
    out.pose.pose = conversions.transform_to_pose(T_home_cam)
    out.pose.covariance = covariance.ravel().tolist()
    return out
