# SPDX-License-Identifier: Apache-2.0
"""The mission's memory on disk, with the calibration and home that it flies by, and their return
after a restart."""

import base64
import dataclasses
import io
import threading
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

import genpy
import rospy

from fcsv_control.errors import SessionError
from fcsv_control.mission import memory as memories
from fcsv_control.mission.memory import Memory
from fcsv_control.ros.mission.memory_file import read, set_aside, unfinished, write
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Calibration, Home

KINDS = {"calibration": Calibration, "home": Home}


class MissionMemory:
    """``folder`` empty: nothing is kept. Writes in a thread of its own: a slow disk does not delay
    the mission."""

    def __init__(self, folder: str, mission: Mission, vehicles: Sequence[str], health: Health):
        self._path = Path(folder).expanduser() / memories.FILE if folder else None
        self._mission, self._vehicles, self._health = mission, list(vehicles), health
        self._messages: Dict[str, Any] = {}
        # configurations that an earlier flight left, after ``load``
        self.unfinished: List[int] = []
        self._next: Optional[Memory] = None
        self._wake = threading.Condition()
        if self._path is not None:
            threading.Thread(target=self._write_always, name="memory", daemon=True).start()

    def load(self) -> Optional[Memory]:
        """What the last run left; a file that is refused is set aside and named in the log."""
        if self._path is None:
            return None
        self.unfinished = unfinished(self._path, self._mission, self._vehicles)
        try:
            memory = read(self._path, self._mission, self._vehicles, time.time())
            if memory is not None:
                for kind in KINDS:
                    message_of(memory, kind)
            return memory
        except SessionError as error:
            try:
                rospy.logerr("%s. Begins anew; the file is now %s", error, set_aside(self._path))
            except SessionError as failed:
                rospy.logerr("%s. %s", error, failed)
            return None

    def remember(self, kind: str, message) -> None:
        """This calibration or home is flown by from now on."""
        self._messages[kind] = _packed(message)

    def forget(self) -> None:
        """No calibration and no home are flown by."""
        self._messages = {}

    def keep(self, memory: Memory) -> None:
        """Write it, with the calibration and home that were heard."""
        if self._path is not None:
            with self._wake:
                self._next = dataclasses.replace(memory, **self._messages)
                self._wake.notify()

    def _write_always(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._next is not None)
                memory, self._next = self._next, None
            try:
                write(self._path, dataclasses.replace(memory, saved_s=time.time()))
                self._health.problem("memory", "")
            except SessionError as error:
                self._health.problem("memory", str(error))


class Restored:
    """Calibration and home of before the restart, latched again unless their node still lives and
    tells them itself."""

    def __init__(self, memory: Memory):
        found = {kind: message_of(memory, kind) for kind in KINDS}
        self.messages = {kind: message for kind, message in found.items() if message is not None}
        self._publishers: Dict[str, rospy.Publisher] = {}

    def publish(self) -> None:
        """Tell them, each once, where nobody else did."""
        for kind, message in self.messages.items():
            self._publishers[kind] = rospy.Publisher(
                f"/{kind}", KINDS[kind], queue_size=1, latch=True
            )
            self._publishers[kind].publish(message)
        self.messages = {}

    def published_by(self, kind: str, node: str) -> bool:
        """Somebody published this kind: whether it was another node. Then ours is not latched (any
        longer)."""
        if node == rospy.get_name():
            return False
        self.messages.pop(kind, None)
        publisher = self._publishers.pop(kind, None)
        if publisher is not None:
            publisher.unregister()
        return True


def message_of(memory: Memory, kind: str):
    """The calibration or home in a memory, None where there is none. Raises SessionError where it
    is damaged."""
    packed = getattr(memory, kind)
    if packed is None:
        return None
    message = KINDS[kind]()
    try:
        if packed["md5"] != message._md5sum:
            raise SessionError(f"{memories.FILE}: its {kind} is of another version of fcsv_msgs")
        return message.deserialize(base64.b64decode(packed["data"], validate=True))
    except (TypeError, KeyError, ValueError, genpy.DeserializationError) as error:
        raise SessionError(f"{memories.FILE}: its {kind} is damaged ({error})") from error


def _packed(message) -> Dict[str, str]:
    """A message to the last bit, as JSON can hold it."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return {
        "type": message._type,
        "md5": message._md5sum,
        "data": base64.b64encode(buffer.getvalue()).decode(),
    }
