# SPDX-License-Identifier: Apache-2.0
"""What the desk commands read out of bags: grey pictures, cameras, odometry."""

from pathlib import Path
from typing import Dict, Iterable, Iterator, List, Sequence, Tuple

import numpy as np
import rosbag
from rosbag.bag import ROSBagException, ROSBagUnindexedException

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import FcsvError, GeometryError
from fcsv_geometry.ros import conversions
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.errors import TrackingError


def messages(paths: Sequence[Path], topics: Iterable[str]) -> Iterator[Tuple[str, object]]:
    """(topic, message) of all bags, one after the other. Raises TrackingError naming bag and what to do."""
    for path in paths:
        try:
            with rosbag.Bag(str(path)) as bag:
                for topic, message, _ in bag.read_messages(topics=list(topics)):
                    yield topic, message
        except ROSBagUnindexedException as error:
            raise TrackingError(f"{path}: is cut or was not closed: run 'rosrun fcsv_control repair_bag'") from error
        except (ROSBagException, EOFError, OSError, AssertionError) as error:
            raise TrackingError(f"{path}: cannot be read as a bag ({error})") from error


def topics_of(paths: Sequence[Path], kind: str) -> List[str]:
    """Topics of a type ("sensor_msgs/Image") in any of the bags."""
    found = set()
    for path in paths:
        try:
            with rosbag.Bag(str(path)) as bag:
                found |= {t for t, info in bag.get_type_and_topic_info().topics.items() if info.msg_type == kind}
        except (ROSBagException, EOFError, OSError, AssertionError) as error:
            remedy = "'rosrun fcsv_control repair_bag' may help"
            raise TrackingError(f"{path}: cannot be read as a bag ({error}); {remedy}") from error
    return sorted(found)


def gray_pictures(paths: Sequence[Path], topic: str) -> Iterator[Tuple[float, np.ndarray]]:
    """Stamp (s) and grey picture (HxW uint8) of an Image topic. Raises TrackingError where there is none."""
    count = 0
    for _, message in messages(paths, [topic]):
        count += 1
        try:
            yield message.header.stamp.to_sec(), conversions.image_to_array(message, "mono8")
        except GeometryError as error:
            raise TrackingError(f"topic {topic}: {error}") from error
    if not count:
        there = ", ".join(topics_of(paths, "sensor_msgs/Image")) or "none"
        raise TrackingError(f"{paths[0]}: no pictures on {topic}; topics with pictures: {there}")


def camera(paths: Sequence[Path], topic: str) -> PinholeCamera:
    """The camera of a CameraInfo topic. Raises TrackingError where it is missing, uncalibrated, or changes."""
    found: Dict[PinholeCamera, None] = {}
    for _, message in messages(paths, [topic]):
        try:
            found.setdefault(conversions.camera_from_info(message))
        except FcsvError as error:
            raise TrackingError(f"topic {topic}: {error}: run calibrate_camera first") from error
        if len(found) > 1:
            raise TrackingError(f"topic {topic}: two different cameras in one recording")
    if not found:
        raise TrackingError(f"{paths[0]}: topic {topic} is missing: record camera_info with the pictures")
    return next(iter(found))


def odometry(paths: Sequence[Path], topic: str, gap_s: float = 0.1) -> Trajectory:
    """The track of an Odometry topic; what is no pose is an error, what goes back in time is passed over."""
    track = Trajectory(gap_s=gap_s)
    for _, message in messages(paths, [topic]):
        try:
            track.add(message.header.stamp.to_sec(), conversions.pose_to_transform(message.pose.pose))
        except GeometryError as error:
            raise TrackingError(f"topic {topic}: {error}") from error
    if not len(track):
        raise TrackingError(f"{paths[0]}: topic {topic} is missing")
    return track
