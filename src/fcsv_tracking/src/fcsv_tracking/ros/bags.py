# SPDX-License-Identifier: Apache-2.0
"""What the desk commands read out of bags: grey pictures, cameras, odometry."""

from pathlib import Path
from typing import Callable, Dict, Iterable, Iterator, List, Sequence, Set, Tuple

import numpy as np

from fcsv_geometry.bags import reading
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import BagError, FcsvError, GeometryError
from fcsv_geometry.messages import seconds
from fcsv_geometry.ros import conversions
from fcsv_geometry.streams.stamps import in_order, stuck
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.errors import TrackingError


def messages(paths: Sequence[Path], topics: Iterable[str]) -> Iterator[Tuple[str, object]]:
    """(topic, message) of all bags, one after the other. Raises TrackingError naming bag and what
    to do."""
    wanted = set(topics)
    for path in paths:
        yield from _read(path, lambda topic, _kind: topic in wanted)


def topics_of(paths: Sequence[Path], kind: str) -> List[str]:
    """Topics of a type ("sensor_msgs/Image") in any of the bags. Raises TrackingError like
    messages."""
    found: Set[str] = set()

    def note(topic: str, its_kind: str) -> bool:
        found.update([topic] if its_kind == kind else [])
        return False

    for path in paths:
        for _ in _read(path, note):
            pass
    return sorted(found)


def _read(path: Path, wanted: Callable[[str, str], bool]) -> Iterator[Tuple[str, object]]:
    try:
        yield from reading.messages(path, wanted)
    except BagError as error:
        raise TrackingError(
            f"{error}; one that is cut or was not closed: rosrun fcsv_control repair_bag"
        ) from error


def gray_pictures(paths: Sequence[Path], topic: str) -> Iterator[Tuple[float, np.ndarray]]:
    """Stamp (s) and grey picture (HxW uint8) of an Image topic. Raises TrackingError where there is
    none."""
    count = 0
    for _, message in messages(paths, [topic]):
        count += 1
        try:
            yield seconds(message.header.stamp), conversions.image_to_array(message, "mono8")
        except GeometryError as error:
            raise TrackingError(f"topic {topic}: {error}") from error
    if not count:
        there = ", ".join(topics_of(paths, "sensor_msgs/Image")) or "none"
        raise TrackingError(f"{paths[0]}: no pictures on {topic}; topics with pictures: {there}")


def camera(paths: Sequence[Path], topic: str) -> PinholeCamera:
    """The camera of a CameraInfo topic. Raises TrackingError where it is missing, uncalibrated, or
    changes."""
    found: Dict[PinholeCamera, None] = {}
    for _, message in messages(paths, [topic]):
        try:
            found.setdefault(conversions.camera_from_info(message))
        except FcsvError as error:
            raise TrackingError(f"topic {topic}: {error}: run calibrate_camera first") from error
        if len(found) > 1:
            raise TrackingError(f"topic {topic}: two different cameras in one recording")
    if not found:
        raise TrackingError(
            f"{paths[0]}: topic {topic} is missing: record camera_info with the pictures"
        )
    return next(iter(found))


def odometry(paths: Sequence[Path], topic: str, gap_s: float = 0.1) -> Trajectory:
    """The track of an Odometry topic; what is no pose is an error, a wrong stamp costs its own
    message alone."""
    poses = []
    for _, message in messages(paths, [topic]):
        try:
            poses.append(
                (seconds(message.header.stamp), conversions.pose_to_transform(message.pose.pose))
            )
        except GeometryError as error:
            raise TrackingError(f"topic {topic}: {error}") from error
    if not poses:
        raise TrackingError(f"{paths[0]}: topic {topic} is missing")
    stamps_s = [s for s, _ in poses]
    if len(poses) > 1 and stuck(stamps_s):
        raise TrackingError(f"{paths[0]}: topic {topic}: all stamps {stuck(stamps_s)}")
    track = Trajectory(gap_s=gap_s)
    for i in in_order(stamps_s).kept:
        track.add(*poses[i])
    return track
