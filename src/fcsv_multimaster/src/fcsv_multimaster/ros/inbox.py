# SPDX-License-Identifier: Apache-2.0
"""What comes from peers, published here under the type it has there; a thread of its own talks to
the master."""

import queue
import threading
import time
from dataclasses import dataclass
from typing import Callable, Dict, List, Optional

import roslib.message
import rospy

from fcsv_geometry.ros import node
from fcsv_multimaster.links import TF_TOPICS
from fcsv_multimaster.network import wire
from fcsv_multimaster.relay.parcel import Parcel
from fcsv_multimaster.relay.sent_times import SentTimes
from fcsv_multimaster.ros.pictures import PictureUnpacker
from fcsv_multimaster.ros.tf_merge import TfIn

_CONNECT_S = 1.0  # who subscribed before has connected by then, or is no more
_NO_MORE_S = 0.3  # after the last connection no other comes
_SETTLE_S = 0.01
_QUIET_S = 2.0  # a topic whose old type was silent for so long may have a new one


@dataclass
class _Entry:
    type: str
    md5: str
    cls: type
    publisher: rospy.Publisher
    used_s: float
    held: Optional[List[Parcel]] = None  # until who subscribed before is connected
    until_s: Optional[float] = None  # none: newest wins, nothing is lost that was worth keeping
    connections: int = 0

    def settled(self) -> bool:
        """Whether who subscribed before is connected. The master tells how many they are only in
        answer to another registration, after which a subscriber connects twice and loses what went
        by its first connection.
        """
        if self.until_s is None:
            return True
        connections, now_s = self.publisher.get_num_connections(), time.monotonic()
        if connections != self.connections:
            self.connections, self.until_s = connections, now_s + _NO_MORE_S
        return now_s > self.until_s


class Inbox:
    """``drop(reason, detail)``; ``definition(source, type)`` asks a peer for a type's text."""

    def __init__(
        self, drop: Callable[[str, str], None], definition: Callable[[str, str], Optional[str]]
    ):
        self._drop, self._definition = drop, definition
        self._lock = threading.Lock()
        self._entries: Dict[str, _Entry] = {}
        self.sent = SentTimes()
        self._pictures = PictureUnpacker()
        self._tf = {t: TfIn(static=t == "/tf_static") for t in TF_TOPICS}
        self._waiting: Dict[str, List[Parcel]] = {}
        self._new: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._advertise_all, name="advertise", daemon=True).start()

    def deliver(self, parcel: Parcel) -> bool:
        """Publish it; whether an H.264 stream needs a whole picture. Raises RelayError where it
        cannot be read."""
        with self._lock:
            entry = self._entries.get(parcel.topic)
            if entry is None or entry.md5 != parcel.md5 or entry.type != parcel.type:
                self._keep(entry, parcel)
                return False
            if entry.held is not None:
                _keep_in(entry.held, parcel)
                return False
        return self._publish(entry, parcel)

    def _keep(self, entry: Optional[_Entry], parcel: Parcel) -> None:
        """What has no publisher yet waits for it; another type's has to wait for the old one's
        silence."""
        if entry is not None and time.monotonic() - entry.used_s < _QUIET_S:
            self._drop(
                "message of another type",
                f"{parcel.topic} of {parcel.source} is {entry.type}, not {parcel.type}",
            )
            return
        new = parcel.topic not in self._waiting
        _keep_in(self._waiting.setdefault(parcel.topic, []), parcel)
        if new:
            self._new.put(parcel.topic)

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
        self.sent.came(parcel)
        try:
            entry.publisher.publish(message)
        except rospy.ROSException:
            pass  # shutting down
        return False

    def _advertise_all(self) -> None:
        unsettled: List[_Entry] = []
        while not rospy.is_shutdown():
            try:
                topic = self._new.get(timeout=_SETTLE_S if unsettled else 0.5)
            except queue.Empty:
                pass
            else:
                unsettled += self._begin(topic)
            for entry in [e for e in unsettled if e.settled()]:
                unsettled.remove(entry)
                self._publish_held(entry)

    def _begin(self, topic: str) -> List[_Entry]:
        """The publisher of a topic that messages wait for; none where it cannot be."""
        with self._lock:
            newest = self._waiting[topic][-1]
        try:
            entry = self._advertise(newest)
        except Exception as error:  # this thread serves all topics
            self._drop(
                "topic that cannot be published",
                f"{topic} of {newest.source}: {node.defect(error)}",
            )
            entry = None
        with self._lock:
            waiting = self._waiting.pop(topic)
            if entry is None:
                return []
            entry.held = [p for p in waiting if (p.type, p.md5) == (entry.type, entry.md5)]
            self._entries[topic] = entry
        return [entry]

    def _publish_held(self, entry: _Entry) -> None:
        with self._lock:  # what comes meanwhile comes after it
            for parcel in entry.held:
                if parcel.late(time.monotonic()):
                    self._drop("late message", f"{parcel.topic} of {parcel.source}")
                    continue
                try:
                    self._publish(entry, parcel)
                # one bad message must not end the thread that all topics need
                except Exception as error:
                    self._drop(
                        "message that cannot be read", f"{parcel.topic} of {parcel.source}: {error}"
                    )
            entry.held = None

    def _advertise(self, parcel: Parcel) -> Optional[_Entry]:
        installed = roslib.message.get_message_class(parcel.type)
        if installed is not None and installed._md5sum != parcel.md5:
            self._drop(
                "another message version",
                f"{parcel.source} has another {parcel.type} than this machine ({parcel.topic})",
            )
            return None
        text = (
            installed._full_text
            if installed is not None
            else self._definition(parcel.source, parcel.type)
        )
        if text is None:
            self._drop("unknown message type", f"{parcel.type} of {parcel.source} ({parcel.topic})")
            return None
        known = self._entries.pop(parcel.topic, None)
        if known is not None:
            known.publisher.unregister()
            rospy.logwarn(
                "%s of %s is %s now, it was %s",
                parcel.topic,
                parcel.source,
                parcel.type,
                known.type,
            )
        cls = _raw_class(parcel.type, parcel.md5, text)
        traffic, now_s = parcel.rule.traffic, time.monotonic()
        publisher = rospy.Publisher(
            parcel.topic,
            cls,
            queue_size=traffic.queue_size,
            latch=traffic.latched,
            tcp_nodelay=True,
        )
        until_s = now_s + _CONNECT_S if traffic.reliable and not traffic.latched else None
        return _Entry(parcel.type, parcel.md5, cls, publisher, now_s, until_s=until_s)


def _keep_in(kept: List[Parcel], parcel: Parcel) -> None:
    """Where every message counts all are kept, as many as fit; else the newest."""
    traffic = parcel.rule.traffic
    del kept[
        : len(kept)
        if not traffic.reliable or traffic.latched
        else max(0, len(kept) + 1 - traffic.queue_size)
    ]
    kept.append(parcel)


def _raw_class(type_name: str, md5: str, text: str) -> type:
    """A message class that passes bytes through."""
    return type(
        "Raw",
        (rospy.AnyMsg,),
        {"_type": type_name, "_md5sum": md5, "_full_text": text, "_has_header": False},
    )
