# SPDX-License-Identifier: Apache-2.0
"""Messages of a bag of ROS 1 or ROS 2, without ROS: by the library rosbags, which the wheel brings.

The definitions of messages come from the bag. Where it holds none (ROS 2 before Iron, sqlite3) they
are ROS 2 Humble's and, for fcsv_msgs, those of ``definitions/``.
"""

from functools import lru_cache
from pathlib import Path
from typing import Callable, Dict, Iterator, Optional, Tuple

from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from fcsv_geometry.errors import BagError, FcsvError

ROS2_FILES = (".mcap", ".db3")
METADATA = "metadata.yaml"  # what makes a folder a bag of ROS 2
DEFINITIONS = Path(__file__).resolve().parent / "definitions"
_IDL_LINE = "=" * 80 + "\nIDL: "


def is_ros2(path: Path) -> bool:
    """Whether a path looks like a bag of ROS 2: a folder with metadata.yaml, or one of its
    files."""
    return path.suffix in ROS2_FILES or (path / METADATA).is_file()


def messages(
    path: Path,
    wanted: Callable[[str, str], bool],
    broken: Optional[Callable[[str, float, str], None]] = None,
) -> Iterator[Tuple[str, object]]:
    """(topic, message) of a bag in order of time, of topics for which ``wanted(topic, type)``.

    Types are named as in ROS 1 ("nav_msgs/Odometry"). ``broken(topic, time, why)`` is told of a
    message whose bytes are not its type's, with the time at which it was recorded (s); the others
    follow. Raises BagError where the bag cannot be read (on), or where nobody wants to be told,
    naming it.
    """
    for topic, _, message in timed_messages(path, wanted, broken):
        yield topic, message


def topics(path: Path) -> Dict[str, str]:
    """Types by topic, named as in ROS 1. Raises BagError like messages()."""
    found: Dict[str, str] = {}
    # it returns None: nothing is wanted
    for _ in messages(path, lambda topic, kind: found.update({topic: kind})):
        pass
    return found


def timed_messages(
    path: Path,
    wanted: Callable[[str, str], bool],
    broken: Optional[Callable[[str, float, str], None]] = None,
) -> Iterator[Tuple[str, float, object]]:
    """(topic, time at which it was recorded (s), message), else as messages()."""
    try:
        with (Reader2 if is_ros2(path) else Reader1)(path) as reader:
            chosen = [c for c in reader.connections if wanted(c.topic, _ros1_name(c.msgtype))]
            if not chosen:
                return
            read = {c.id: _deserializer(c.msgtype, *_definition(c), is_ros2(path)) for c in chosen}
            for connection, recorded_ns, data in reader.messages(connections=chosen):
                try:
                    message = read[connection.id](data, connection.msgtype)
                # whatever the library's code for this type meets in these bytes
                except Exception as error:
                    if broken is None:
                        raise
                    broken(connection.topic, recorded_ns / 1e9, _words(error))
                else:
                    yield connection.topic, recorded_ns / 1e9, message
    except FcsvError:  # of who asked
        raise
    # a damaged bag: the library's errors, and those of sqlite, zstd, lz4, struct below it
    except Exception as error:
        raise BagError(f"{path}: cannot be read as a bag ({_words(error)})") from error


def _ros1_name(kind: str) -> str:
    """
    >>> _ros1_name("nav_msgs/msg/Odometry")
    'nav_msgs/Odometry'
    """
    return kind.replace("/msg/", "/", 1)


def _words(error: Exception) -> str:
    """One line; some of the library's errors have no words, or are a key that was not found."""
    words = " ".join(str(error).split())
    return words if " " in words else f"{type(error).__name__} {words}".strip()


def _definition(connection) -> Tuple[str, str]:
    """Format ("MSG", "IDL", "NONE") and text; releases of the library before 0.10 know the first
    alone."""
    found = connection.msgdef
    if isinstance(found, str):
        return ("MSG" if found else "NONE"), found
    return found.format.name, found.data


@lru_cache(maxsize=None)  # the bags of a session repeat their types
def _deserializer(kind: str, form: str, text: str, ros2: bool) -> Callable[[bytes, str], object]:
    if form == "NONE":
        store = _known_types()
    else:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(text, kind) if form == "MSG" else _types_from_idl(text))
    if kind not in store.types:
        raise ValueError(f"it does not define {_ros1_name(kind)}, which is not known here either")
    return store.deserialize_cdr if ros2 else store.deserialize_ros1


def _types_from_idl(text: str) -> Dict:
    types: Dict = {}
    for part in text.split(_IDL_LINE)[1:] if _IDL_LINE in text else ["\n" + text]:
        types.update(get_types_from_idl(part.partition("\n")[2]))
    return types


@lru_cache(maxsize=1)
def _known_types():
    """ROS 2 Humble's types, and fcsv_msgs from the .msg files that the catkin package has too."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Dict = {}
    for path in sorted(DEFINITIONS.glob("*.msg")):
        types.update(get_types_from_msg(path.read_text(), f"fcsv_msgs/msg/{path.stem}"))
    store.register(types)
    return store
