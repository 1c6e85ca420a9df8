# SPDX-License-Identifier: Apache-2.0
"""A map on its topics, as it grows: points, depth with sigma, kind and camera, reference picture
and its place."""

import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import RefinedCameras
from fcsv_stereo.model import Cloud, MapResult
from fcsv_stereo.ros.baseline_topics import BaselineTopics
from fcsv_stereo.ros.map_messages import (
    REFERENCE_FRAME,
    WATCH_FRAME,
    cloud_message,
    depth_message,
    refined_message,
)


class MapTopics:
    """All latched: who begins to listen gets the newest."""

    def __init__(self):
        latched = {"queue_size": 1, "latch": True}
        self._points = rospy.Publisher("/map/points", PointCloud2, **latched)
        self._site = rospy.Publisher("/map/site", PointCloud2, **latched)
        self._by_baseline = BaselineTopics()
        self._depth = rospy.Publisher("/map/depth", Image, **latched)
        self._sigma = rospy.Publisher("/map/sigma", Image, **latched)
        self._kind = rospy.Publisher("/map/kind", Image, **latched)
        self._info = rospy.Publisher("/map/camera_info", CameraInfo, **latched)
        self._reference = rospy.Publisher("/map/reference", Image, **latched)
        self._refined = rospy.Publisher("/map/refined", RefinedCameras, **latched)
        self._static = tf2_ros.StaticTransformBroadcaster()
        self._places = {}  # of both cameras: what is latched is the last message alone
        self._watch = {
            name: rospy.Publisher(f"/map/watch/{name}", kind, queue_size=2)
            for name, kind in (
                ("depth", Image),
                ("sigma", Image),
                ("kind", Image),
                ("camera_info", CameraInfo),
            )
        }

    def _send_place(self, T_home_cam: np.ndarray, stamp_s: float, frame: str) -> None:
        T = conversions.transform_stamped(T_home_cam, stamp_s, frames.HOME, frame)
        self._places[frame] = T
        self._static.sendTransform(list(self._places.values()))

    def publish_watch(self, result: MapResult) -> None:
        """What vehicles see now, beside the map."""
        reference, stamp_s = result.reference, result.reference.stamp_s
        self._send_place(reference.T_home_cam, stamp_s, WATCH_FRAME)
        kind = result.kind.astype("uint8")
        for name, message in (
            ("depth", depth_message(result.depth, stamp_s, WATCH_FRAME)),
            ("sigma", depth_message(result.sigma, stamp_s, WATCH_FRAME)),
            ("kind", conversions.array_to_image(kind, "mono8", stamp_s, WATCH_FRAME)),
            ("camera_info", conversions.info_from_camera(reference.camera, stamp_s, WATCH_FRAME)),
        ):
            self._watch[name].publish(message)

    def publish_refined(self, result: MapResult) -> None:
        """The poses that a map refined."""
        images = [image for image in result.images if image.refined]
        if images:
            self._refined.publish(refined_message(images, result.reference.stamp_s))

    def publish_site(self, cloud: Cloud) -> None:
        """The joined maps of several stations and headings."""
        self._site.publish(cloud_message(cloud, rospy.get_time()))

    def publish(self, result: MapResult) -> None:
        """A new map in place of the last one."""
        reference, stamp_s = result.reference, result.reference.stamp_s
        self._send_place(reference.T_home_cam, stamp_s, REFERENCE_FRAME)
        self._points.publish(cloud_message(result.cloud, stamp_s))
        baselines = [(p.configuration.axis.value, p.configuration.baseline_m) for p in result.pairs]
        self._by_baseline.show(result.cloud, baselines, stamp_s)
        self._depth.publish(depth_message(result.depth, stamp_s))
        self._sigma.publish(depth_message(result.sigma, stamp_s))
        self._kind.publish(
            conversions.array_to_image(
                result.kind.astype("uint8"), "mono8", stamp_s, REFERENCE_FRAME
            )
        )
        self._info.publish(conversions.info_from_camera(reference.camera, stamp_s, REFERENCE_FRAME))
        self._reference.publish(
            conversions.array_to_image(reference.image, "rgb8", stamp_s, REFERENCE_FRAME)
        )
