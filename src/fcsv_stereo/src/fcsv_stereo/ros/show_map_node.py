# SPDX-License-Identifier: Apache-2.0
"""Shows a finished map in rviz: the fused cloud, one cloud per baseline, the reference picture."""

import json
import re
import sys
from pathlib import Path

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import Image, PointCloud2

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_stereo.output import read_ply
from fcsv_stereo.ros.map_messages import cloud_message


def publish_map(out: Path) -> list:
    """Latched publishers of everything in OUT; keep them."""
    cloud = read_ply(out / "map.ply")
    document = json.loads((out / "report.json").read_text())
    clouds = {"/map/points": np.ones(len(cloud), bool)}
    for i, c in enumerate(document["configurations"]):
        name = re.sub(r"\W+", "_", f"{c['axis']}_{c['baseline_m']:g}m")
        clouds[f"/map/baselines/{name}"] = cloud.baseline_index == i
    publishers = []
    for topic, chosen in clouds.items():
        publisher = rospy.Publisher(topic, PointCloud2, queue_size=1, latch=True)
        publisher.publish(cloud_message(cloud, 0.0, chosen))
        publishers.append(publisher)
        rospy.loginfo("%s: %d points", topic, chosen.sum())
    reference = cv2.imread(str(out / "reference.png"))
    if reference is not None:
        publisher = rospy.Publisher("/map/reference", Image, queue_size=1, latch=True)
        publisher.publish(conversions.array_to_image(reference, "bgr8", 0.0, frames.HOME))
        publishers.append(publisher)
    return publishers


def main() -> int:
    """Publish the map in the folder given as argument or parameter ~out, and stay."""
    rospy.init_node("show_map")
    words = rospy.myargv(sys.argv)[1:]
    out = Path(words[0] if words else rospy.get_param("~out"))
    try:
        publishers = publish_map(out)
    except (FcsvError, OSError, ValueError) as error:
        rospy.logfatal("show_map: %s", error)
        return 2
    rospy.spin()
    return 0 if publishers else 1
