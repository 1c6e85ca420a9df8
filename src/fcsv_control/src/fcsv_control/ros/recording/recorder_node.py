# SPDX-License-Identifier: Apache-2.0
"""Records a machine's part of a session to a local bag; a radio that fails costs nothing."""

import shutil
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, Type

import rospy
from genpy import Message
from std_msgs.msg import Bool

from fcsv_control.agent.messages import Pictures
from fcsv_control.errors import SessionError
from fcsv_control.recorder_port import (
    EndRecording,
    PartWritten,
    PictureCame,
    RecorderPort,
    RecorderReport,
    SaveSession,
    SessionSaved,
    Written,
)
from fcsv_control.recording import RecorderParameters, keep_earlier, plan
from fcsv_control.ros.recording.bag_writer import BagWriter
from fcsv_control.session import FILE, Session, new_session, save_session, utc_now
from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.mission import Mission, load_mission
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.telemetry import Diagnosis
from fcsv_msgs.msg import RecorderStatus


class RecorderNode:
    """Messages stay serialized from the socket to the disk; pictures only while
    ``recorder/pictures`` is true."""

    def __init__(self):
        p = self._parameters = node.parameters(RecorderParameters)
        self._folder, self._lock = _made(Path(p.folder).expanduser()), threading.RLock()
        self._health = Health(p.name)
        mission = load_mission(p.mission) if p.role == "control" else None
        self._writer = _opened(self._folder, p)
        rospy.on_shutdown(self._close)
        session = None if mission is None else self._described(mission)
        self._port = RecorderPort(p, time.monotonic(), session)
        self._do: Dict[type, Callable[[Any], None]] = {
            PictureCame: lambda o: self._on_message(o.message, o.topic),
            SaveSession: self._save,
            EndRecording: lambda o: self._writer.fail(o.why),
            Diagnosis: self._health.diagnose,
            RecorderReport: self._publish,
        }
        topics = plan(p)
        status = "recorder/status" if p.role == "vehicle" else f"/{p.name}/recorder/status"
        self._status = rospy.Publisher(status, RecorderStatus, queue_size=2)
        self._timer = node.every(1.0, self._step)
        on_pictures = self._taken(Bool, lambda m: Pictures(m.data))
        rospy.Subscriber("recorder/pictures", rospy.AnyMsg, on_pictures, queue_size=1)
        for vehicle in p.vehicles if p.role == "control" else ():
            on_other = self._taken(
                RecorderStatus, lambda m, v=vehicle: PartWritten(v, Path(m.path).name)
            )
            rospy.Subscriber(f"/{vehicle}/recorder/status", rospy.AnyMsg, on_other, queue_size=5)
        for topic in topics.always:
            rospy.Subscriber(
                topic, rospy.AnyMsg, self._on_message, topic, queue_size=100, buff_size=1 << 20
            )
        for topic in topics.pictures:
            rospy.Subscriber(
                topic, rospy.AnyMsg, self._on_picture, topic, queue_size=5, buff_size=8 << 20
            )

    def _described(self, mission: Mission) -> Session:
        """session.yaml of this flight: a new one, or the one of the recorder that died."""
        p = self._parameters
        if self._writer.continues:
            try:
                return config.load(self._folder / FILE, Session)
            except ConfigError as error:
                rospy.logwarn("%s: another is written", error)
        session = new_session(mission, p.vehicles, utc_now(), p.seed)
        keep_earlier(self._folder / FILE)
        rospy.loginfo("%s written", save_session(self._folder, session))
        return session

    def _taken(
        self, kind: Type[Message], take: Callable[[Message], object]
    ) -> Callable[[rospy.AnyMsg], None]:
        """What this node hears for itself comes serialized, too.

        In one process rospy gives all who hear a topic the class of the first of them: what is
        heard as messages cannot be recorded.
        """

        def came(message: rospy.AnyMsg) -> None:
            try:
                data = take(decoded(message, kind))
            except SessionError as error:
                self._health.drop("message of another kind", str(error))
                return
            self._receive(data)

        return came

    def _receive(self, data: object) -> None:
        now_s = time.monotonic()
        with self._lock:
            self._port.receive(now_s, data)
            for output in self._port.step(now_s):
                self._do[type(output)](output)

    def _on_picture(self, message: rospy.AnyMsg, topic: str) -> None:
        self._receive(PictureCame(topic, message, topic.endswith("image_raw")))

    def _on_message(self, message: rospy.AnyMsg, topic: str) -> None:
        if not self._writer.put(topic, message, rospy.Time.now()):
            self._health.drop("message", self._writer.problem or "the disk is too slow")

    def _step(self, _event) -> None:
        w, free_bytes = self._writer, shutil.disk_usage(self._folder).free
        self._receive(Written(str(w.path), w.pictures, w.bytes, w.dropped, w.problem, free_bytes))

    def _save(self, output: SaveSession) -> None:
        try:
            save_session(self._folder, output.session)
            self._port.receive(time.monotonic(), SessionSaved(output.session))
        except SessionError as error:  # the bags go on; it is tried again
            rospy.logerr_throttle(10.0, f"{error}")

    def _publish(self, m: RecorderReport) -> None:
        self._status.publish(
            RecorderStatus(header=conversions.header(rospy.get_time(), ""), **vars(m))
        )

    def _close(self) -> None:
        closed = self._writer.close()
        log = rospy.loginfo if closed else rospy.logerr
        log(
            "%s %s",
            self._writer.path,
            "closed" if closed else f"not closed: {self._writer.problem or 'disk too slow'}",
        )


def decoded(message: rospy.AnyMsg, kind: Type[Message]) -> Message:
    """A message that came serialized. Raises SessionError where it is of another kind."""
    sent = message._connection_header
    if sent["md5sum"] != kind._md5sum:
        raise SessionError(f"{sent['type']} came, or another version of {kind._type}")
    return kind().deserialize(message._buff)


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SessionError(
            f"{folder}: cannot be made ({error.strerror}); choose another folder"
        ) from error
    return folder


def _opened(folder: Path, p: RecorderParameters) -> BagWriter:
    try:
        writer = BagWriter(folder, p.name, p.most_waiting_mib << 20, p.part_mib << 20)
    except OSError as error:
        raise SessionError(
            f"{folder}: cannot be recorded into ({error.strerror}); choose another folder"
        ) from error
    if writer.continues:
        rospy.logwarn("the recorder before was cut off: recording goes on in %s", writer.path)
    return writer


def main() -> int:
    """Run the node."""
    return node.run("recorder", RecorderNode)
