# SPDX-License-Identifier: Apache-2.0
"""A map as messages for rviz and whoever else listens."""

from typing import Optional, Sequence

import numpy as np
import rospy
from sensor_msgs.msg import Image, PointCloud2, PointField

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import RefinedCameras
from fcsv_stereo.model import Cloud
from fcsv_stereo.model.results import ImageEntry

#: Optical frame of the reference picture that depth belongs to, published as a static transform
#: from home.
REFERENCE_FRAME = "map/reference_optical"
#: The same of the picture by which vehicles watch the place.
WATCH_FRAME = "map/watch_optical"
#: Frame of a map that is far from home's origin: its points plus the shift are in home.
LOCAL_FRAME = "map/local"
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4"), ("sigma", "<f4")])
_OF_BASELINES = np.dtype([*_POINT.descr, ("baseline_m", "<f4")])


def cloud_message(
    cloud: Cloud,
    stamp_s: float,
    chosen: Optional[np.ndarray] = None,
    lengths_m: Optional[np.ndarray] = None,
    frame: str = frames.HOME,
) -> PointCloud2:
    """Points of home (or of another ``frame``) with packed colour and sigma (m); ``chosen``:
    indices of them, or all. With ``lengths_m`` (of each pair) every chosen point has the length of
    its baseline, too."""
    chosen = np.arange(len(cloud)) if chosen is None else chosen
    kind = _POINT if lengths_m is None else _OF_BASELINES
    points = np.empty(len(chosen), kind)
    for i, axis in enumerate("xyz"):
        points[axis] = cloud.points_home_m[chosen, i]
    colors = cloud.colors[chosen].astype(np.uint32)
    points["rgb"] = colors[:, 0] << 16 | colors[:, 1] << 8 | colors[:, 2]
    points["sigma"] = cloud.sigma_m[chosen]
    if lengths_m is not None:
        points["baseline_m"] = lengths_m[cloud.baseline_index[chosen]] if len(chosen) else 0.0
    message = PointCloud2(header=conversions.header(stamp_s, frame), height=1, width=len(points))
    kinds = {"<f4": PointField.FLOAT32, "<u4": PointField.FLOAT32}  # rgb travels in a float's bits
    message.fields = [PointField(n, kind.fields[n][1], kinds[kind[n].str], 1) for n in kind.names]
    message.point_step, message.row_step, message.is_dense = (
        kind.itemsize,
        kind.itemsize * len(points),
        True,
    )
    message.data = points.tobytes()
    return message


def depth_message(depth: np.ndarray, stamp_s: float, frame: str = REFERENCE_FRAME) -> Image:
    """32FC1, metres along the optical axis, NaN where there is none (REP 118); sigma likewise."""
    return conversions.array_to_image(depth.astype(np.float32), "32FC1", stamp_s, frame)


def refined_message(images: Sequence[ImageEntry], stamp_s: float) -> RefinedCameras:
    """What a map with its reference's ``stamp_s`` found of its pictures' poses."""
    return RefinedCameras(
        conversions.header(stamp_s, frames.HOME),
        [image.vehicle for image in images],
        [rospy.Time.from_sec(image.stamp_s) for image in images],
        [conversions.transform_to_pose(image.prior_T_home_cam) for image in images],
        [conversions.transform_to_pose(image.T_home_cam) for image in images],
    )
