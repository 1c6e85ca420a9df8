# SPDX-License-Identifier: Apache-2.0
"""From calibration links and home to every odometry frame in home (thesis 6.3)."""

from typing import Dict, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_tracking.calibration import Link


def odoms_in_home(links: Sequence[Link], reference: str, T_odom_home: np.ndarray) -> Dict[str, np.ndarray]:
    """T_home_odom of every vehicle that the links connect to the reference, whose T_odom_home is given."""
    T_home_odom = {reference: transforms.invert(T_odom_home)}
    left = list(links)
    while left:
        known = [k for k in left if k.parent in T_home_odom or k.child in T_home_odom]
        if not known:
            return T_home_odom
        for link in known:
            left.remove(link)
            if link.child not in T_home_odom:
                T_home_odom[link.child] = T_home_odom[link.parent] @ link.T_parent_child
            elif link.parent not in T_home_odom:
                T_home_odom[link.parent] = T_home_odom[link.child] @ transforms.invert(link.T_parent_child)
    return T_home_odom


def home_of(T_odom_cam: np.ndarray) -> np.ndarray:
    """T_odom_home: the camera's position, level, x along the camera's view (design, "Frames")."""
    forward = T_odom_cam[:3, 2]
    return transforms.from_xyz_yaw(T_odom_cam[:3, 3], float(np.arctan2(forward[1], forward[0])))
