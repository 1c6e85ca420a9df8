# SPDX-License-Identifier: Apache-2.0
"""What the control PC says of a session (/home, /calibration, /mission/capture), for bags and for live maps."""

from typing import Dict

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.ros import conversions
from fcsv_stereo.live import Window
from fcsv_stereo.result import Configuration


def odoms_in_home(home, calibration) -> Dict[str, np.ndarray]:
    """T_home_odom of every calibrated vehicle (6.3). Raises GeometryError where a pose in the messages is none."""
    T_home_odom = {home.reference: transforms.invert(conversions.pose_to_transform(home.home_in_odom))}
    links = {(k.parent, k.child): conversions.pose_to_transform(k.child_odom_in_parent_odom) for k in calibration.links}
    for _ in links:
        for (parent, child), T_parent_child in links.items():
            if parent in T_home_odom:
                T_home_odom.setdefault(child, T_home_odom[parent] @ T_parent_child)
            elif child in T_home_odom:
                T_home_odom[parent] = T_home_odom[child] @ transforms.invert(T_parent_child)
    return T_home_odom


def window_of(capture) -> Window:
    """A recording window from its message."""
    c = capture.configuration
    axis = "vertical" if c.axis == c.VERTICAL else "horizontal"
    configuration = Configuration(axis, c.baseline_m, c.tilt_rad, c.name)
    start_s, stop_s = capture.start.to_sec(), capture.stop.to_sec()
    return Window(capture.index, configuration, capture.reference, capture.vehicle, start_s, stop_s)
