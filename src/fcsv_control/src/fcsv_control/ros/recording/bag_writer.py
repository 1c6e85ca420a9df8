# SPDX-License-Identifier: Apache-2.0
"""Serialized messages into the parts of a recording by a thread of its own; a bag gets its name
when it is whole."""

import contextlib
import fcntl
import os
import queue
import threading
import time
from pathlib import Path
from typing import Dict, Optional, Tuple

import rosbag
import rospy

from fcsv_control.recording import begin
from fcsv_geometry.bags.parts import part_name
from fcsv_geometry.bags.repair import ACTIVE

_CHUNK_BYTES = 1 << 20
# what a process that is killed costs at most, and the disk's own delay where the power is cut
_FLUSH_S = 0.25
_Item = Tuple[str, rospy.AnyMsg, rospy.Time]


class BagWriter:
    """``put`` never blocks: what a slow disk cannot take is dropped and counted. Raises OSError at
    the start.

    Latched messages stand in every part, so that each can be read without the ones before.
    """

    def __init__(self, folder: Path, name: str, most_waiting_bytes: int, part_bytes: int):
        self._folder, self._first, self._part_bytes = folder, f"{name}.bag", part_bytes
        self.part, kept = begin(folder, self._first, time.time())
        for earlier in kept:
            rospy.logwarn("a bag of an earlier flight is kept as %s", earlier)
        self.continues = self.part > 0  # the recorder before died in this flight
        self.dropped = self.pictures = self.bytes = 0
        self.problem = ""
        self._most_waiting_bytes = most_waiting_bytes
        self._waiting_bytes = 0
        self._latched: Dict[Tuple[str, str], _Item] = {}
        self._lock = threading.Lock()
        self._queue: queue.Queue[Optional[_Item]] = queue.Queue()
        self._unsynced, self._ended = threading.Event(), False
        self._open()
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()
        threading.Thread(target=self._sync, name="bag to the disk", daemon=True).start()

    @property
    def path(self) -> Path:
        """The part that is written, by the name that it will have."""
        return self._folder / part_name(self._first, self.part)

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
        """Nothing more is written; what is there is closed."""
        self.problem = self.problem or problem

    def close(self, timeout_s: float = 20.0) -> bool:
        """Write what is queued, index the bag, give it its name; False where that did not work."""
        self._queue.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive() and self.path.exists()

    # ---- the writer's thread ---------------------------------------------------------------------

    def _open(self) -> None:
        self._active = self.path.with_name(self.path.name + ACTIVE)
        self._file = self._active.open("w+b")
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # nobody repairs it meanwhile
        self._sync_folder()
        self._bag = rosbag.Bag(self._file, "w", chunk_threshold=_CHUNK_BYTES)

    def _run(self) -> None:
        flush_s = time.monotonic() + _FLUSH_S
        while True:
            try:
                item = self._queue.get(timeout=max(flush_s - time.monotonic(), 0.0))
            except queue.Empty:
                item = ()
            if item is None:
                break
            if item:
                self._guarded(self._store, item)
                with self._lock:
                    self._waiting_bytes -= len(item[1]._buff)
            if time.monotonic() >= flush_s:
                self._guarded(self._flush)
                flush_s = time.monotonic() + _FLUSH_S
            if self.problem and self._bag is not None:
                self._guarded(self._finish)
        self._guarded(self._finish)
        self._ended = True
        self._unsynced.set()

    def _guarded(self, work, *arguments) -> None:
        """A disk that refuses ends the recording; the open bag stays as it is, for the repair."""
        if self._bag is None:
            self.dropped += bool(arguments)
            return
        try:
            work(*arguments)
        except (OSError, ValueError, rosbag.ROSBagException) as error:
            why = getattr(error, "strerror", error)
            self.fail(
                f"{self._active}: {why}; make room and start again (it is repaired when opened)"
            )
            self._bag = None

    def _store(self, item: _Item) -> None:
        topic, message, _ = item
        if (
            self._file.tell() + len(message._buff) > self._part_bytes
            and self._file.tell() > _CHUNK_BYTES
        ):
            self._finish()
            self.part += 1
            self._open()
            for (latched_topic, _sender), (_topic, latched, _t) in list(self._latched.items()):
                self._write(latched_topic, latched, item[2])
        self._write(*item)
        h = message._connection_header
        if h.get("latching") == "1":
            self._latched[topic, h.get("callerid", "")] = item

    def _write(self, topic: str, message: rospy.AnyMsg, received: rospy.Time) -> None:
        h = message._connection_header
        header = {k: h[k] for k in ("type", "md5sum", "message_definition")}
        header.update(topic=topic, latching=h.get("latching", "0"))
        # rosbag asks a class for its md5sum, and nothing else
        kind = type("Raw", (), {"_md5sum": h["md5sum"]})
        self._bag.write(
            topic, (h["type"], message._buff, h["md5sum"], kind), received, True, header
        )
        self.bytes += len(message._buff)
        self.pictures += topic.endswith("/image_raw")

    def _flush(self) -> None:
        self._bag.flush()
        self._file.flush()
        self._unsynced.set()

    def _finish(self) -> None:
        """Index, disk, name."""
        bag, self._bag = self._bag, None
        bag.flush()
        keep = os.dup(self._file.fileno())
        try:
            bag.close()
            os.fsync(keep)
        finally:
            os.close(keep)
        os.replace(self._active, self.path)
        self._sync_folder()

    def _sync_folder(self) -> None:
        """A name that the folder on the disk does not hold is gone after a power cut, and the file
        with it."""
        with contextlib.suppress(OSError):  # a file system whose folders cannot be synced
            folder = os.open(self._folder, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def _sync(self) -> None:
        """A thread of its own: while a slow disk takes what is flushed, messages are still
        written."""
        while not self._ended:
            self._unsynced.wait()
            self._unsynced.clear()
            with contextlib.suppress(OSError, ValueError):  # closed meanwhile
                os.fsync(self._file.fileno())
