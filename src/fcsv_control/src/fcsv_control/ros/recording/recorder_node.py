# SPDX-License-Identifier: Apache-2.0
"""Records a machine's part of a session to a local bag; a radio that fails costs nothing."""

import shutil
import threading
import time
from functools import partial
from pathlib import Path
from typing import Callable, Type

import rospy
from genpy import Message
from std_msgs.msg import Bool

from fcsv_control.disk import DiskWatch
from fcsv_control.errors import SessionError
from fcsv_control.recording import RecorderParameters, keep_earlier, plan
from fcsv_control.ros.recording.bag_writer import BagWriter
from fcsv_control.session import FILE, Session, new_session, save_session, utc_now, with_part
from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.mission import Mission, load_mission
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.streams.silence import Silence, in_steps
from fcsv_msgs.msg import RecorderStatus


class RecorderNode:
    """Messages stay serialized from the socket to the disk; pictures only while
    ``recorder/pictures`` is true."""

    def __init__(self):
        p = self._parameters = node.parameters(RecorderParameters)
        self._folder, self._listing = _made(Path(p.folder).expanduser()), threading.Lock()
        self._health, self._silence = Health(p.name), Silence(p.no_picture_s)
        self._want_pictures(p.pictures_on)
        self._disk = DiskWatch(p.least_free_mib << 20)
        mission = load_mission(p.mission) if p.role == "control" else None
        self._writer = _opened(self._folder, p)
        rospy.on_shutdown(self._close)
        self._session = None if mission is None else self._described(mission)
        topics = plan(p)
        status = "recorder/status" if p.role == "vehicle" else f"/{p.name}/recorder/status"
        self._status = rospy.Publisher(status, RecorderStatus, queue_size=2)
        self._timer = node.every(1.0, self._publish_status)
        rospy.Subscriber(
            "recorder/pictures", rospy.AnyMsg, self._taken(Bool, self._on_pictures), queue_size=1
        )
        for vehicle in p.vehicles if p.role == "control" else ():
            on_other = self._taken(RecorderStatus, partial(self._on_other, vehicle))
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
        self, kind: Type[Message], tell: Callable[[Message], None]
    ) -> Callable[[rospy.AnyMsg], None]:
        """What this node hears for itself comes serialized, too.

        In one process rospy gives all who hear a topic the class of the first of them: what is
        heard as messages cannot be recorded.
        """

        def take(message: rospy.AnyMsg) -> None:
            try:
                tell(decoded(message, kind))
            except SessionError as error:
                self._health.drop("message of another kind", str(error))

        return take

    def _on_other(self, vehicle: str, message: RecorderStatus) -> None:
        self._list(vehicle, Path(message.path).name)

    def _list(self, machine: str, bag: str) -> None:
        """A further part of a machine's recording belongs into session.yaml."""
        with self._listing:
            session = with_part(self._session, machine, bag)
            if session is self._session:
                return
            try:
                save_session(self._folder, session)
                self._session = session
            except SessionError as error:  # the bags go on; it is tried again
                rospy.logerr_throttle(10.0, f"{error}")

    def _on_pictures(self, message: Bool) -> None:
        self._want_pictures(message.data)

    def _want_pictures(self, wanted: bool) -> None:
        self._pictures_on = wanted
        self._silence.want(time.monotonic(), wanted)

    def _on_picture(self, message: rospy.AnyMsg, topic: str) -> None:
        if self._pictures_on:
            if topic.endswith("image_raw"):
                self._silence.came(time.monotonic())
            self._on_message(message, topic)

    def _on_message(self, message: rospy.AnyMsg, topic: str) -> None:
        if not self._writer.put(topic, message, rospy.Time.now()):
            self._health.drop("message", self._writer.problem or "the disk is too slow")

    def _publish_status(self, _event) -> None:
        w, least = self._writer, self._parameters.least_free_mib
        self._disk.see(time.monotonic(), w.bytes, shutil.disk_usage(self._folder).free)
        if self._disk.full:
            w.fail(
                f"less than {least} MiB are free on the disk of {self._folder}; make room and start again"
            )
        if self._session is not None:
            self._list(self._parameters.name, w.path.name)
        self._health.problem("disk", w.problem)
        lasts_s = in_steps(self._silence.lasts_s(time.monotonic()))
        self._health.problem(
            "pictures", f"{self._parameters.name}: no picture for {lasts_s} s" if lasts_s else ""
        )
        self._health.value("minutes left", f"{self._disk.minutes_left:.0f}")
        self._health.value("pictures", w.pictures)
        self._health.value("MB", w.bytes // 10**6)
        self._status.publish(
            RecorderStatus(
                header=conversions.header(rospy.get_time(), ""),
                path=str(w.path),
                pictures_on=self._pictures_on,
                pictures=w.pictures,
                bytes=w.bytes,
                dropped=w.dropped,
                minutes_left=self._disk.minutes_left,
                problem=w.problem,
            )
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
