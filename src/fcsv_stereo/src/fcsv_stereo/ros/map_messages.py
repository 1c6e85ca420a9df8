# SPDX-License-Identifier: Apache-2.0
"""A map as messages for rviz and whoever else listens."""

from typing import Optional

import numpy as np
from sensor_msgs.msg import Image, PointCloud2, PointField

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_stereo.model import Cloud

#: Optical frame of the reference picture that depth belongs to, published as a static transform from home.
REFERENCE_FRAME = "map/reference_optical"
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4"), ("sigma", "<f4")])


def cloud_message(cloud: Cloud, stamp_s: float, chosen: Optional[np.ndarray] = None) -> PointCloud2:
    """Points of home with packed colour and sigma (m); ``chosen`` (N) bool of them, or all."""
    chosen = np.ones(len(cloud), bool) if chosen is None else chosen
    points = np.empty(int(chosen.sum()), _POINT)
    for i, axis in enumerate("xyz"):
        points[axis] = cloud.points_home_m[chosen, i]
    colors = cloud.colors[chosen].astype(np.uint32)
    points["rgb"] = colors[:, 0] << 16 | colors[:, 1] << 8 | colors[:, 2]
    points["sigma"] = cloud.sigma_m[chosen]
    message = PointCloud2(header=conversions.header(stamp_s, frames.HOME), height=1, width=len(points))
    kinds = {"<f4": PointField.FLOAT32, "<u4": PointField.FLOAT32}  # rgb travels in a float's bits
    message.fields = [PointField(n, _POINT.fields[n][1], kinds[_POINT[n].str], 1) for n in _POINT.names]
    message.point_step, message.row_step, message.is_dense = _POINT.itemsize, _POINT.itemsize * len(points), True
    message.data = points.tobytes()
    return message


def depth_message(depth: np.ndarray, stamp_s: float) -> Image:
    """32FC1, metres along the optical axis, NaN where there is none (REP 118)."""
    return conversions.array_to_image(depth.astype(np.float32), "32FC1", stamp_s, REFERENCE_FRAME)
