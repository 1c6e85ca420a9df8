# SPDX-License-Identifier: Apache-2.0
"""Sessions of ROS 2, made of those of ROS 1 by the library's converter."""

import sqlite3
from pathlib import Path

from rosbags.convert.converter import convert
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from fcsv_geometry.bags.reading import DEFINITIONS

PLUGINS = {"mcap": ".mcap", "sqlite3": ".db3"}


def types_of_ros2():
    """ROS 2 Humble's, whose camera_info has its matrices in lower case, and fcsv_msgs."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {}
    for path in DEFINITIONS.glob("*.msg"):
        types.update(get_types_from_msg(path.read_text(), f"fcsv_msgs/msg/{path.stem}"))
    store.register(types)
    return store


def to_ros2(bags, target: Path, storage: str) -> Path:
    """One bag of ROS 2 (a folder with metadata.yaml) of several of ROS 1."""
    convert(list(bags), target, storage, 8, None, "file", None, types_of_ros2(), (), (), (), ())
    return target


def session_to_ros2(session: Path, target: Path, storage: str) -> Path:
    """Each bag of a session as one of ROS 2, listed in session.yaml."""
    target.mkdir()
    for bag in sorted(session.glob("*.bag")):
        to_ros2([bag], target / bag.stem, storage)
    names = ", ".join(f"{p.name}: {p.name}" for p in sorted(target.iterdir()))
    (target / "session.yaml").write_text(f"version: 1\nbags: {{{names}}}\n")
    return target


def without_definitions(bag: Path) -> Path:
    """As ROS 2 Humble and older write: no message is defined in the bag."""
    with sqlite3.connect(next(bag.glob("*.db3"))) as database:
        assert database.execute("DELETE FROM message_definitions").rowcount > 0
    return bag
