# SPDX-License-Identifier: Apache-2.0
"""What topics bags hold: those that an import can use, and the words that name them."""

from pathlib import Path
from typing import Dict, List, Sequence

from fcsv_geometry.bags import reading
from fcsv_geometry.errors import BagError
from fcsv_stereo.errors import InputError
from fcsv_stereo.sessions import compressed

IMAGES = ("sensor_msgs/Image", compressed.TYPE)
INFO = "sensor_msgs/CameraInfo"
POSES = (
    "nav_msgs/Odometry",
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/TransformStamped",
)
TF = ("tf2_msgs/TFMessage", "tf/tfMessage")
_NAMED = 12  # topics that a message lists


def topics_of(bags: Sequence[Path]) -> Dict[str, str]:
    """Types by topic over all bags. Raises InputError naming a bag that cannot be read."""
    found: Dict[str, str] = {}
    for bag in bags:
        try:
            found.update(reading.topics(bag))
        except BagError as error:
            raise InputError(f"{error}; {_remedy(bag)}") from error
    return found


def _remedy(bag: Path) -> str:
    """How a cut bag of ROS 2 is mended; one of ROS 1 is repaired when it is opened."""
    if bag.suffix == ".mcap" or (bag.is_dir() and any(bag.glob("*.mcap"))):
        return "if it was cut: mcap recover FILE -o NEW.mcap"
    if reading.is_ros2(bag):
        return "if it was cut: sqlite3 FILE .recover, then ros2 bag reindex"
    return "is it whole?"


def listed(topics: Dict[str, str], kinds: Sequence[str]) -> str:
    """Topics of some types, with these.

    >>> listed({"/a": "sensor_msgs/Image", "/b": "std_msgs/String"}, IMAGES)
    '/a (sensor_msgs/Image)'
    """
    found = [f"{topic} ({kind})" for topic, kind in sorted(topics.items()) if kind in kinds]
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return (", ".join(found[:_NAMED]) + more) or "none"


def picture_topic(topic: str, topics: Dict[str, str]) -> str:
    """The topic of pictures, or its compressed twin. Raises InputError that lists what there is."""
    for name in (topic, topic + compressed.SUFFIX):
        if topics.get(name) in IMAGES:
            return name
    why = f"is of type {topics[topic]}" if topic in topics else "is not in the bag"
    raise InputError(f"--camera {topic}: {why}; topics of pictures there: {listed(topics, IMAGES)}")


def base_of(topic: str) -> str:
    """A topic of pictures without image_transport's ending.

    >>> base_of("/cam/image_raw/compressed")
    '/cam/image_raw'
    """
    return topic[: -len(compressed.SUFFIX)] if topic.endswith(compressed.SUFFIX) else topic


def info_topic(pictures: str, given: str, topics: Dict[str, str]) -> str:
    """The topic of camera_info, ``given`` or beside the pictures. Raises InputError that lists what
    there is.
    """
    name = given or base_of(pictures).rpartition("/")[0] + "/camera_info"
    if topics.get(name) == INFO:
        return name
    why = f"{name} is of type {topics[name]}" if name in topics else f"{name} is not in the bag"
    raise InputError(
        f"--camera {pictures}: no camera_info: {why}; name it by --info, there are: {listed(topics, [INFO])}"
    )


def foreign(topics: Dict[str, str], path: Path) -> str:
    """Words that tell a user of a bag with pictures, which is no session, how it is imported;
    empty: it has none.
    """
    pictures = [t for t, kind in sorted(topics.items()) if kind in IMAGES]
    if not pictures:
        return ""
    poses = [t for t, kind in sorted(topics.items()) if kind in POSES]
    tf = any(kind in TF for kind in topics.values())
    source = poses[0] if poses else "FRAME" if tf else "FILE"
    there: List[str] = [f"pictures {listed(topics, IMAGES)}", f"poses {listed(topics, POSES)}"]
    return (
        f"{path}: was not recorded by fcsv; fcsv import-bag {path} --camera {pictures[0]} --pose {source} --range-m M "
        f"-o PHOTOS makes photographs of it that map reads; it holds {', '.join(there)}{', tf' if tf else ''}"
    )
