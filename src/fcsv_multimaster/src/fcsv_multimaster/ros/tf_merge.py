# SPDX-License-Identifier: Apache-2.0
"""/tf and /tf_static between machines: listed child frames, with their machine's prefix, merged
into one tree."""

import io
import struct
import threading
from typing import Dict, Iterable, List, Optional

import genpy
from tf2_msgs.msg import TFMessage

from fcsv_multimaster.errors import WireError

SHARED_FRAMES = ("home", "mocap", "map", "world", "earth")  # the same on every machine


def with_prefix(frame: str, machine: str) -> str:
    """``uav1/camera`` for ``camera`` on uav1; shared frames and those that have a prefix stay as
    they are."""
    frame = frame.lstrip("/")
    return frame if "/" in frame or frame in SHARED_FRAMES else f"{machine}/{frame}"


class TfOut:
    """What leaves for one peer: the newest transform of every listed child frame."""

    def __init__(self, machine: str, frames: Iterable[str], static: bool):
        self._machine, self._frames, self._static = machine, set(frames), static
        self._lock = threading.Lock()
        self._newest: Dict[str, object] = {}

    def add(self, data: bytes) -> bool:
        """A serialised TFMessage of this machine; whether something is to be sent. Raises
        WireError."""
        with self._lock:
            for t in read(data).transforms:
                t.child_frame_id = with_prefix(t.child_frame_id, self._machine)
                t.header.frame_id = with_prefix(t.header.frame_id, self._machine)
                if t.child_frame_id in self._frames:
                    self._newest[t.child_frame_id] = t
            return bool(self._newest)

    def drain(self) -> Optional[bytes]:
        """A serialised TFMessage: of /tf what is new since the last, of /tf_static all there is."""
        with self._lock:
            transforms = [self._newest[k] for k in sorted(self._newest)]
            if not self._static:
                self._newest.clear()
        return write(transforms) if transforms else None


class TfIn:
    """What comes from peers: of static transforms one latched message holds those of all peers."""

    def __init__(self, static: bool):
        self._static = static
        self._lock = threading.Lock()
        self._merged: Dict[str, object] = {}

    def merge(self, data: bytes, frames: Iterable[str]) -> Optional[bytes]:
        """The message to publish, with the listed child frames alone; None where none is. Raises
        WireError."""
        allowed = set(frames)
        transforms = [t for t in read(data).transforms if t.child_frame_id in allowed]
        if not transforms:
            return None
        if self._static:
            with self._lock:
                self._merged.update((t.child_frame_id, t) for t in transforms)
                transforms = [self._merged[k] for k in sorted(self._merged)]
        return write(transforms)


def read(data: bytes) -> TFMessage:
    """Raises WireError."""
    try:
        return TFMessage().deserialize(data)
    except (genpy.DeserializationError, struct.error, UnicodeDecodeError) as error:
        raise WireError(f"a tf message that cannot be read: {error}") from error


def write(transforms: List) -> bytes:
    buffer = io.BytesIO()
    TFMessage(transforms).serialize(buffer)
    return buffer.getvalue()
