# SPDX-License-Identifier: Apache-2.0
"""Shows a finished map in rviz: the fused cloud, one cloud per baseline, the reference picture."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import Image, PointCloud2

from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_stereo.map_files.output import read_ply, read_ply_origin
from fcsv_stereo.ros.baseline_topics import BaselineTopics
from fcsv_stereo.ros.map_messages import LOCAL_FRAME, cloud_message


def publish_map(out: Path) -> list:
    """Publishers of everything in OUT, which also serve who comes later; keep them. Raises
    FcsvError and OSError, and ValueError or KeyError where the report is not of a map.

    A map far from home's origin is in LOCAL_FRAME, whose static transform from home has the shift
    in float64.
    """
    cloud, origin_m = read_ply(out / "map.ply"), read_ply_origin(out / "map.ply")
    frame = LOCAL_FRAME if origin_m.any() else frames.HOME
    document = json.loads((out / "report.json").read_text())
    publishers: list = [rospy.Publisher("/map/points", PointCloud2, queue_size=1, latch=True)]
    publishers[0].publish(cloud_message(cloud, 0.0, frame=frame))
    rospy.loginfo("%d points", len(cloud))
    if frame == LOCAL_FRAME:
        broadcaster = tf2_ros.StaticTransformBroadcaster()
        T_home_local = transforms.transform(np.eye(3), origin_m)
        broadcaster.sendTransform(
            conversions.transform_stamped(T_home_local, 0.0, frames.HOME, frame)
        )
        publishers.append(broadcaster)
        rospy.loginfo("the map is far from home's origin: choose %s as rviz's fixed frame", frame)
    by_baseline = BaselineTopics(frame)
    by_baseline.show(cloud, [(c["axis"], c["baseline_m"]) for c in document["configurations"]], 0.0)
    publishers.append(by_baseline)
    reference = cv2.imread(str(out / "reference.png"))
    if reference is not None:
        publisher = rospy.Publisher("/map/reference", Image, queue_size=1, latch=True)
        publisher.publish(conversions.array_to_image(reference, "bgr8", 0.0, frames.HOME))
        publishers.append(publisher)
    return publishers


def main() -> int:
    """Publish the map in the folder given as argument or parameter ~out, and stay."""
    node.begin("show_map")
    words = rospy.myargv(sys.argv)[1:]
    out = Path(words[0] if words else rospy.get_param("~out"))
    health = Health("map")
    health.value("map", out)
    try:
        publishers = publish_map(out)
    except (FcsvError, OSError, ValueError, KeyError) as error:
        rospy.logfatal("show_map: %s", error)
        return 2
    rospy.spin()
    return 0 if publishers else 1
