# SPDX-License-Identifier: Apache-2.0
"""What comes from peers, published here under the type it has there; a thread of its own talks to the master."""

import queue
import threading
import time
from dataclasses import dataclass
from typing import Callable, Dict, Optional

import roslib.message
import rospy

from fcsv_multimaster import wire
from fcsv_multimaster.links import TF_TOPICS
from fcsv_multimaster.parcel import Parcel
from fcsv_multimaster.ros.pictures import PictureUnpacker
from fcsv_multimaster.ros.tf_merge import TfIn

_QUIET_S = 2.0  # a topic whose old type was silent for so long may have a new one


@dataclass
class _Entry:
    type: str
    md5: str
    cls: type
    publisher: rospy.Publisher
    used_s: float


class Inbox:
    """``drop(reason, detail)``; ``definition(source, type)`` asks a peer for a type's text."""

    def __init__(self, drop: Callable[[str, str], None], definition: Callable[[str, str], Optional[str]]):
        self._drop, self._definition = drop, definition
        self._entries: Dict[str, _Entry] = {}
        self._pictures = PictureUnpacker()
        self._tf = {t: TfIn(static=t == "/tf_static") for t in TF_TOPICS}
        self._waiting: Dict[str, Parcel] = {}
        self._new: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._advertise_all, name="advertise", daemon=True).start()

    def deliver(self, parcel: Parcel) -> bool:
        """Publish it; whether an H.264 stream needs a whole picture. Raises RelayError where it cannot be read."""
        entry = self._entries.get(parcel.topic)
        if entry is None or entry.md5 != parcel.md5 or entry.type != parcel.type:
            if entry is not None and time.monotonic() - entry.used_s < _QUIET_S:
                self._drop(
                    "message of another type", f"{parcel.topic} of {parcel.source} is {entry.type}, not {parcel.type}"
                )
                return False
            first = parcel.topic not in self._waiting
            self._waiting[parcel.topic] = parcel
            if first:
                self._new.put(parcel.topic)
            return False
        return self._publish(entry, parcel)

    def _publish(self, entry: _Entry, parcel: Parcel) -> bool:
        data = parcel.data
        if parcel.packing != wire.RAW:
            data = self._pictures.unpack(parcel)
        elif parcel.topic in self._tf:
            data = self._tf[parcel.topic].merge(data, parcel.rule.frames)
        if data is None:
            return parcel.packing == wire.H264
        message = entry.cls()
        message._buff = data
        entry.used_s = time.monotonic()
        try:
            entry.publisher.publish(message)
        except rospy.ROSException:
            pass  # shutting down
        return False

    def _advertise_all(self) -> None:
        while not rospy.is_shutdown():
            try:
                topic = self._new.get(timeout=0.5)
            except queue.Empty:
                continue
            entry = self._advertise(self._waiting[topic])
            parcel = self._waiting.pop(topic)
            if entry is None:
                continue
            self._entries[topic] = entry
            try:
                self._publish(entry, parcel)
            except Exception as error:  # one bad message must not end the thread that all topics need
                self._drop("message that cannot be read", f"{topic} of {parcel.source}: {error}")

    def _advertise(self, parcel: Parcel) -> Optional[_Entry]:
        installed = roslib.message.get_message_class(parcel.type)
        if installed is not None and installed._md5sum != parcel.md5:
            self._drop(
                "another message version",
                f"{parcel.source} has another {parcel.type} than this machine ({parcel.topic})",
            )
            return None
        text = installed._full_text if installed is not None else self._definition(parcel.source, parcel.type)
        if text is None:
            self._drop("unknown message type", f"{parcel.type} of {parcel.source} ({parcel.topic})")
            return None
        known = self._entries.pop(parcel.topic, None)
        if known is not None:
            known.publisher.unregister()
            rospy.logwarn("%s of %s is %s now, it was %s", parcel.topic, parcel.source, parcel.type, known.type)
        cls = _raw_class(parcel.type, parcel.md5, text)
        publisher = rospy.Publisher(
            parcel.topic, cls, queue_size=20, latch=parcel.rule.traffic.latched, tcp_nodelay=True
        )
        return _Entry(parcel.type, parcel.md5, cls, publisher, time.monotonic())


def _raw_class(type_name: str, md5: str, text: str) -> type:
    """A message class that passes bytes through."""
    return type("Raw", (rospy.AnyMsg,), {"_type": type_name, "_md5sum": md5, "_full_text": text, "_has_header": False})
