# SPDX-License-Identifier: Apache-2.0
"""What does not move on a vehicle, for tf2: the same whichever tracker runs."""

from typing import List

import numpy as np
import rospy
from geometry_msgs.msg import TransformStamped

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_geometry.vehicles.vehicle import VehicleGeometry


def fixed_parts(
    vehicle: VehicleGeometry, tracker: TrackerProfile = T265_PROFILE
) -> List[TransformStamped]:
    """Static transforms of one vehicle; the driver's optical frame is ours by definition."""
    n = vehicle.name
    optical = frames.camera_optical(n)
    parts = {
        optical: (frames.base_link(n), vehicle.T_body_cam),
        frames.tag(n): (frames.base_link(n), vehicle.T_body_tag),
        tracker.pose_frame(n): (frames.base_link(n), vehicle.T_body_t265),
        f"{n}/camera_color_optical_frame": (optical, np.eye(4)),
    }
    return [conversions.transform_stamped(T, rospy.get_time(), a, b) for b, (a, T) in parts.items()]
