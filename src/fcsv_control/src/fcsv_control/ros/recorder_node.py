# SPDX-License-Identifier: Apache-2.0
"""Records a machine's part of a session to a local bag; a radio that fails costs nothing."""

import os
import queue
import shutil
import threading
import time
from pathlib import Path

import rosbag
import rospy
from std_msgs.msg import Bool

from fcsv_control.recording import plan
from fcsv_control.session import write_session
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import RecorderStatus

_QUEUE = 400
_LEAST_FREE_BYTES = 500 << 20


class RecorderNode:
    """Raw messages through a bounded queue to one writing thread; the bag gets its name when it is whole."""

    def __init__(self):
        role, self._name = rospy.get_param("~role"), rospy.get_param("~name")
        folder = Path(rospy.get_param("~folder")).expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        vehicles = list(rospy.get_param("~vehicles", []))
        topics = plan(role, self._name, vehicles)
        self._path = folder / f"{self._name}.bag"
        self._active = folder / f"{self._name}.bag.active"
        self._bag = rosbag.Bag(str(self._active), "w", chunk_threshold=4 << 20)
        self._queue: queue.Queue = queue.Queue(_QUEUE)
        self._pictures_on = False
        self._pictures = self._dropped = 0
        self._problem = ""
        self._health = Health(self._name)
        if role == "control":
            created = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
            write_session(folder, vehicles, rospy.get_param("~mission"), created, rospy.get_param("~seed", None))
        self._writer = threading.Thread(target=self._write, name="writer")
        self._writer.start()
        rospy.on_shutdown(self._close)
        self._status = rospy.Publisher(self._status_topic(role), RecorderStatus, queue_size=2)
        self._timer = rospy.Timer(rospy.Duration(1.0), self._publish_status)
        rospy.Subscriber("recorder/pictures", Bool, self._on_pictures, queue_size=1)
        for topic in topics.always:
            rospy.Subscriber(topic, rospy.AnyMsg, self._on_message, (topic, False), queue_size=100)
        for topic in topics.pictures:
            rospy.Subscriber(topic, rospy.AnyMsg, self._on_message, (topic, True), queue_size=5, buff_size=8 << 20)

    def _status_topic(self, role: str) -> str:
        return "recorder/status" if role == "vehicle" else f"/{self._name}/recorder/status"

    def _on_pictures(self, message: Bool) -> None:
        self._pictures_on = message.data

    def _on_message(self, message: rospy.AnyMsg, topic_and_kind) -> None:
        topic, is_picture = topic_and_kind
        if is_picture and not self._pictures_on:
            return
        try:
            self._queue.put_nowait((topic, message, rospy.Time.now()))
        except queue.Full:
            self._dropped += 1
            self._health.drop("message", "the disk is too slow")

    def _write(self) -> None:
        while True:
            item = self._queue.get()
            if item is None:
                break
            topic, message, stamp = item
            if self._problem:
                self._dropped += 1
                continue
            h = message._connection_header
            header = {k: h[k] for k in ("type", "md5sum", "message_definition")}
            header.update(topic=topic, latching=h.get("latching", "0"))
            raw = (h["type"], message._buff, h["md5sum"], _Raw)
            _Raw._md5sum = h["md5sum"]
            try:
                self._bag.write(topic, raw, stamp, raw=True, connection_header=header)
                self._pictures += topic.endswith("image_raw")
            except OSError as error:
                self._problem = f"{self._active}: {error}"
                self._health.problem("disk", self._problem)
        self._bag.close()
        os.replace(self._active, self._path)

    def _publish_status(self, _event) -> None:
        free = shutil.disk_usage(self._path.parent).free
        if free < _LEAST_FREE_BYTES:
            self._problem = f"only {free >> 20} MiB left on the disk of {self._path.parent}"
            self._health.problem("disk", f"{self._name}: {self._problem}")
        self._status.publish(
            RecorderStatus(
                header=conversions.header(rospy.get_time(), ""),
                path=str(self._path),
                pictures_on=self._pictures_on,
                pictures=self._pictures,
                bytes=self._bag.size if self._bag._file else 0,
                dropped=self._dropped,
                problem=self._problem,
            )
        )

    def _close(self) -> None:
        """Write what is queued, index the bag, give it its name."""
        self._queue.put(None)
        self._writer.join(20.0)


class _Raw:
    """Stands for a message class that need not be known: rosbag asks for its md5sum only."""

    _md5sum = "*"


def main() -> int:
    """Run the node."""
    rospy.init_node("recorder")
    try:
        RecorderNode()
    except (FcsvError, OSError, ValueError) as error:
        rospy.logfatal("recorder: %s", error)
        return 2
    rospy.spin()
    return 0
