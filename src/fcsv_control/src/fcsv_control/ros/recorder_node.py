# SPDX-License-Identifier: Apache-2.0
"""Records a machine's part of a session to a local bag; a radio that fails costs nothing."""

import shutil
from pathlib import Path

import rospy
from std_msgs.msg import Bool

from fcsv_control.errors import SessionError
from fcsv_control.recording import RecorderParameters, keep_earlier, plan
from fcsv_control.ros.bag_writer import BagWriter
from fcsv_control.session import FILE, new_session, save_session, utc_now
from fcsv_geometry.mission import load_mission
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import RecorderStatus


class RecorderNode:
    """Messages stay serialized from the socket to the disk; pictures only while ``recorder/pictures`` is true."""

    def __init__(self):
        p = self._parameters = node.parameters(RecorderParameters)
        self._folder = _made(Path(p.folder).expanduser())
        if p.role == "control":
            self._describe_session()
        self._pictures_on = p.pictures_on
        self._health = Health(p.name)
        self._writer = _opened(self._folder / f"{p.name}.bag", p.most_waiting_mib << 20)
        rospy.on_shutdown(self._close)
        topics = plan(p)
        status = "recorder/status" if p.role == "vehicle" else f"/{p.name}/recorder/status"
        self._status = rospy.Publisher(status, RecorderStatus, queue_size=2)
        self._timer = node.every(1.0, self._publish_status)
        rospy.Subscriber("recorder/pictures", Bool, self._on_pictures, queue_size=1)
        for topic in topics.always:
            rospy.Subscriber(topic, rospy.AnyMsg, self._on_message, topic, queue_size=100, buff_size=1 << 20)
        for topic in topics.pictures:
            rospy.Subscriber(topic, rospy.AnyMsg, self._on_picture, topic, queue_size=5, buff_size=8 << 20)

    def _describe_session(self) -> None:
        p = self._parameters
        session = new_session(load_mission(p.mission), p.vehicles, utc_now(), p.seed)
        keep_earlier(self._folder / FILE)
        rospy.loginfo("%s written", save_session(self._folder, session))

    def _on_pictures(self, message: Bool) -> None:
        self._pictures_on = message.data

    def _on_picture(self, message: rospy.AnyMsg, topic: str) -> None:
        if self._pictures_on:
            self._on_message(message, topic)

    def _on_message(self, message: rospy.AnyMsg, topic: str) -> None:
        if not self._writer.put(topic, message, rospy.Time.now()):
            self._health.drop("message", self._writer.problem or "the disk is too slow")

    def _publish_status(self, _event) -> None:
        w, free_mib = self._writer, shutil.disk_usage(self._folder).free >> 20
        if free_mib < self._parameters.least_free_mib:
            least = self._parameters.least_free_mib
            w.fail(f"less than {least} MiB are free on the disk of {self._folder}; make room and start again")
        self._health.problem("disk", w.problem)
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
                problem=w.problem,
            )
        )

    def _close(self) -> None:
        closed = self._writer.close()
        log = rospy.loginfo if closed else rospy.logerr
        log(
            "%s %s", self._writer.path, "closed" if closed else f"not closed: {self._writer.problem or 'disk too slow'}"
        )


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SessionError(f"{folder}: cannot be made ({error.strerror}); choose another folder") from error
    return folder


def _opened(path: Path, most_waiting_bytes: int) -> BagWriter:
    try:
        return BagWriter(path, most_waiting_bytes)
    except OSError as error:
        raise SessionError(f"{path}: cannot be written ({error.strerror}); choose another folder") from error


def main() -> int:
    """Run the node."""
    return node.run("recorder", RecorderNode)
