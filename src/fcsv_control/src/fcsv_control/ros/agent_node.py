# SPDX-License-Identifier: Apache-2.0
"""The agent on board: the only one that commands the flight link; holds when nobody tells it more."""

import queue
import threading
from typing import Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Bool

from fcsv_control.agent import EXECUTE, EXPIRED, REPEAT, Answer, CommandLog, checked_target
from fcsv_control.errors import CommandRefused, ControlError
from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Command, CommandAck, State, StatusText
from fcsv_msgs.srv import CommandBool, CommandTOL, SetMode

_SERVICE_TIMEOUT_S = 3.0


class AgentNode:
    """Commands run in a worker, so that a slow service never blocks the radio's callbacks."""

    def __init__(self):
        self._name = rospy.get_param("~vehicle")
        self._furthest_m = rospy.get_param("~furthest_target_m", 60.0)
        self._log = CommandLog(self._name)
        self._lock = threading.Lock()
        self._target: Optional[np.ndarray] = None
        self._here: Optional[np.ndarray] = None
        self._mode = ""
        self._reason = ""
        self._jobs: queue.Queue[Command] = queue.Queue()
        self._health = Health(self._name)
        self._acks = rospy.Publisher("command_ack", CommandAck, queue_size=20)
        self._set_points = rospy.Publisher("mavros/setpoint_position/local", PoseStamped, queue_size=1)
        self._pictures = rospy.Publisher("recorder/pictures", Bool, queue_size=1, latch=True)
        self._set_mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
        self._arming = rospy.ServiceProxy("mavros/cmd/arming", CommandBool)
        self._takeoff = rospy.ServiceProxy("mavros/cmd/takeoff", CommandTOL)
        threading.Thread(target=self._work, name="commands", daemon=True).start()
        self._timer = rospy.Timer(rospy.Duration(0.1), self._stream)
        rospy.Subscriber("mavros/state", State, self._on_state, queue_size=5)
        rospy.Subscriber("mavros/statustext/recv", StatusText, self._on_text, queue_size=5)
        rospy.Subscriber("mavros/local_position/pose", PoseStamped, self._on_pose, queue_size=1)
        rospy.Subscriber("command", Command, self._on_command, queue_size=20)

    def _on_state(self, message: State) -> None:
        with self._lock:
            if message.mode == "GUIDED" and self._mode != "GUIDED":
                self._target = None if self._here is None else transforms.level(self._here)
            elif message.mode != "GUIDED":
                self._target = None
            self._mode = message.mode

    def _on_pose(self, message: PoseStamped) -> None:
        with self._lock:
            self._here = conversions.pose_to_transform(message.pose)

    def _on_text(self, message: StatusText) -> None:
        self._reason = message.text

    def _stream(self, _event) -> None:
        """The last target again and again, with nobody else needed."""
        with self._lock:
            target = self._target if self._mode == "GUIDED" else None
        if target is not None:
            self._set_points.publish(conversions.pose_stamped(target, rospy.get_time(), frames.odom(self._name)))

    def _on_command(self, c: Command) -> None:
        verdict, answer = self._log.judge(rospy.get_time(), c.vehicle, c.sender, c.number, c.expires.to_sec())
        if verdict == EXECUTE:
            self._jobs.put(c)
        elif verdict == EXPIRED:
            self._answer(c, CommandAck.EXPIRED, "came too late")
        elif verdict == REPEAT:
            self._publish(c, answer)

    def _work(self) -> None:
        while not rospy.is_shutdown():
            try:
                command = self._jobs.get(timeout=0.2)
            except queue.Empty:
                continue
            try:
                self._execute(command)
                self._answer(command, CommandAck.DONE, "")
            except (FcsvError, rospy.ServiceException, rospy.ROSException) as error:
                self._answer(command, CommandAck.REFUSED, str(error))

    def _execute(self, c: Command) -> None:
        if c.kind == Command.SET_MODE:
            self._call(self._set_mode, lambda s: s(0, c.mode).mode_sent)
        elif c.kind == Command.LAND:
            self._call(self._set_mode, lambda s: s(0, "LAND").mode_sent)
        elif c.kind == Command.ARM:
            self._call(self._arming, lambda s: s(c.flag).success)
        elif c.kind == Command.TAKEOFF:
            self._call(self._takeoff, lambda s: s(0, 0, 0, 0, c.altitude_m).success)
        elif c.kind == Command.RECORD:
            self._pictures.publish(Bool(c.flag))
        elif c.kind in (Command.GOTO, Command.HOLD):
            self._move(c)
        else:
            raise CommandRefused(f"command kind {c.kind} is not known")

    def _move(self, c: Command) -> None:
        with self._lock:
            if self._mode != "GUIDED":
                raise CommandRefused(f"{self._name} is in {self._mode or 'no mode yet'}, not in GUIDED")
            if self._here is None:
                raise CommandRefused(f"{self._name} does not know where it is")
            if c.kind == Command.HOLD:
                self._target = transforms.level(self._here)
                return
            T = conversions.pose_to_transform(c.target.pose)
            odom = frames.odom(self._name)
            self._target = checked_target(T, c.target.header.frame_id, odom, self._here[:3, 3], self._furthest_m)

    def _call(self, service, ask) -> None:
        self._reason = ""
        rospy.wait_for_service(service.resolved_name, timeout=_SERVICE_TIMEOUT_S)
        if not ask(service):
            raise ControlError(self._reason or "the flight link refused")

    def _answer(self, c: Command, result: int, reason: str) -> None:
        answer = Answer(result, reason)
        self._log.answered(c.sender, c.number, answer)
        if result != CommandAck.DONE:
            self._health.drop("command", f"{c.kind}: {reason}")
        self._publish(c, answer)

    def _publish(self, c: Command, answer: Answer) -> None:
        self._acks.publish(
            CommandAck(
                conversions.header(rospy.get_time(), ""), self._name, c.sender, c.number, answer.result, answer.reason
            )
        )


def main() -> None:
    """Run the node."""
    rospy.init_node("agent")
    AgentNode()
    rospy.spin()
