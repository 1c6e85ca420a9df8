# SPDX-License-Identifier: Apache-2.0
"""Serialized messages into a bag by a thread of its own; the bag gets its name when it is whole."""

import os
import queue
import threading
from pathlib import Path
from typing import Optional, Tuple

import rosbag
import rospy

from fcsv_control.recording import keep_earlier

_CHUNK_BYTES = 1 << 20  # what a crash may cost at most


class BagWriter:
    """``put`` never blocks: what a slow disk cannot take is dropped and counted. Raises OSError at the start."""

    def __init__(self, path: Path, most_waiting_bytes: int):
        self.path = path
        self._active = path.with_name(path.name + ".active")
        for earlier in (path, self._active):
            kept = keep_earlier(earlier)
            if kept is not None:
                rospy.logwarn("%s is of an earlier flight; kept as %s", earlier, kept.name)
        self.dropped = self.pictures = self.bytes = 0
        self.problem = ""
        self._most_waiting_bytes = most_waiting_bytes
        self._waiting_bytes = 0
        self._lock = threading.Lock()
        self._queue: queue.Queue[Optional[Tuple[str, rospy.AnyMsg, rospy.Time]]] = queue.Queue()
        self._bag = rosbag.Bag(str(self._active), "w", chunk_threshold=_CHUNK_BYTES)
        self._thread = threading.Thread(target=self._run, name="bag writer")
        self._thread.start()

    def put(self, topic: str, message: rospy.AnyMsg, received: rospy.Time) -> bool:
        """Queue a message; False where it was dropped."""
        size = len(message._buff)
        with self._lock:
            taken = not self.problem and self._waiting_bytes + size <= self._most_waiting_bytes
            self._waiting_bytes += size if taken else 0
            self.dropped += not taken
        if taken:
            self._queue.put((topic, message, received))
        return taken

    def fail(self, problem: str) -> None:
        """Nothing more is written; what is on the disk is kept whole."""
        self.problem = self.problem or problem

    def close(self, timeout_s: float = 20.0) -> bool:
        """Write what is queued, index the bag, give it its name; False where that did not work."""
        self._queue.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive() and self.path.exists()

    def _run(self) -> None:
        while True:
            item = self._queue.get()
            if item is None:
                break
            self._write(*item)
            with self._lock:
                self._waiting_bytes -= len(item[1]._buff)
        try:
            self._bag.close()
            os.replace(self._active, self.path)
        except OSError as error:
            self.fail(f"{self._active}: {error.strerror}; 'rosbag reindex' makes it readable")

    def _write(self, topic: str, message: rospy.AnyMsg, received: rospy.Time) -> None:
        if self.problem:
            self.dropped += 1
            return
        h = message._connection_header
        header = {k: h[k] for k in ("type", "md5sum", "message_definition")}
        header.update(topic=topic, latching=h.get("latching", "0"))
        kind = type("Raw", (), {"_md5sum": h["md5sum"]})  # rosbag asks a class for its md5sum, and nothing else
        try:
            self._bag.write(topic, (h["type"], message._buff, h["md5sum"], kind), received, True, header)
        except OSError as error:
            self.fail(f"{self._active}: {error.strerror}")
            return
        self.bytes += len(message._buff)
        self.pictures += topic.endswith("/image_raw")
