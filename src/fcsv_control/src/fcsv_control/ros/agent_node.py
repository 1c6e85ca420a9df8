# SPDX-License-Identifier: Apache-2.0
"""The agent on board: the only one that commands the flight link. It holds when no command comes."""

import queue
import threading
import time
from dataclasses import dataclass, field
from typing import Callable, Dict, List, Tuple

import rospy
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Bool

from fcsv_control.agent import Answer, CommandLog, Holder, Limits, LinkLoss, Verdict
from fcsv_control.errors import CommandRefused, ControlError
from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Command, CommandAck, MissionState, Refusal, State, StatusText
from fcsv_msgs.srv import CommandBool, CommandTOL, SetMode

_REASON_WAIT_S = 0.5  # the reason and the service's answer come by different ways
_QUIET_S = 0.15  # set-points on their way arrive before the take-off that they would replace
_STOPPING_MODES = {"LAND", "BRAKE"}
_MISSION_MODES = {"GUIDED", *_STOPPING_MODES}  # what a mission needs; any other mode is a pilot's


@dataclass(frozen=True)
class AgentParameters:
    """Parameters of the node. ``link_loss_land_s`` 0: hold for ever when the control PC is silent."""

    vehicle: str
    set_point_rate_hz: float = 10.0
    link_loss_land_s: float = 0.0
    service_timeout_s: float = 3.0
    maintenance: bool = False  # commands may ask for any mode; never in a flight with people about
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self):
        if not 2.0 <= self.set_point_rate_hz <= 50.0:
            raise ValueError(f"set_point_rate_hz: {self.set_point_rate_hz} is not in 2..50")
        if self.link_loss_land_s != 0.0 and not self.link_loss_land_s >= 1.0:
            raise ValueError(f"link_loss_land_s: {self.link_loss_land_s} is neither 0 (never) nor at least 1")
        if not 0.1 <= self.service_timeout_s <= 30.0:
            raise ValueError(f"service_timeout_s: {self.service_timeout_s} is not in 0.1..30")


class AgentNode:
    """Commands run in workers, so that a slow service never blocks the radio's callbacks; stopping never queues."""

    def __init__(self):
        self._parameters = node.parameters(AgentParameters)
        self._name = self._parameters.vehicle
        self._log = CommandLog(self._name)
        self._holder = Holder(frames.odom(self._name), self._parameters.limits)
        self._link_loss = LinkLoss(self._parameters.link_loss_land_s)
        self._lock = threading.Lock()
        self._texts: List[Tuple[float, str]] = []
        self._refusals: List[Tuple[float, str]] = []
        self._jobs: queue.Queue[Command] = queue.Queue()
        self._stops: queue.Queue[Command] = queue.Queue()
        self._health = Health(self._name)
        self._acks = rospy.Publisher("command_ack", CommandAck, queue_size=20)
        self._set_points = rospy.Publisher(
            "mavros/setpoint_position/local", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._pictures = rospy.Publisher("recorder/pictures", Bool, queue_size=1, latch=True)
        self._set_mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
        self._arming = rospy.ServiceProxy("mavros/cmd/arming", CommandBool)
        self._takeoff = rospy.ServiceProxy("mavros/cmd/takeoff", CommandTOL)
        self._actions: Dict[int, Callable[[Command], None]] = {
            Command.SET_MODE: self._command_mode,
            Command.GOTO: self._go_to,
            Command.HOLD: self._hold,
            Command.RECORD: lambda c: self._pictures.publish(Bool(c.flag)),
            Command.LAND: lambda c: self._change_mode("LAND"),
            Command.ARM: lambda c: self._call(self._arming, lambda s: s(c.flag).success),
            Command.TAKEOFF: self._take_off,
        }
        for waiting in (self._jobs, self._stops):
            threading.Thread(target=self._work, args=(waiting,), name="commands", daemon=True).start()
        self._timer = node.every(1.0 / self._parameters.set_point_rate_hz, self._stream)
        rospy.Subscriber("mavros/state", State, self._on_state, queue_size=5)
        rospy.Subscriber("mavros/statustext/recv", StatusText, self._on_text, queue_size=20)
        rospy.Subscriber("flight_link/refusal", Refusal, self._on_refusal, queue_size=5)
        rospy.Subscriber("mavros/local_position/pose", PoseStamped, self._on_pose, queue_size=5, tcp_nodelay=True)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)
        rospy.Subscriber("command", Command, self._on_command, queue_size=20)

    # ---- what is heard -------------------------------------------------------------------------------------

    def _on_state(self, message: State) -> None:
        with self._lock:
            self._holder.state(message.mode, message.armed)
        self._health.problem("link", "" if message.connected else f"{self._name}: no autopilot")

    def _on_pose(self, message: PoseStamped) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose)
        except FcsvError as error:
            self._health.drop("local position", str(error))
            return
        with self._lock:
            moved_m = self._holder.pose(message.header.stamp.to_sec(), T_odom_body)
        if moved_m:
            rospy.logerr("%s: the autopilot's estimate jumped by %.1f m; the target moves along", self._name, moved_m)
            self._health.drop("jump of the estimate", f"{moved_m:.1f} m")

    def _on_text(self, message: StatusText) -> None:
        if message.severity <= StatusText.WARNING:
            self._texts = [*self._texts[-10:], (time.monotonic(), message.text)]

    def _on_refusal(self, message: Refusal) -> None:
        self._refusals = [*self._refusals[-10:], (time.monotonic(), message.reason)]

    def _on_mission(self, _message: MissionState) -> None:
        with self._lock:
            self._link_loss.heard(time.monotonic())

    def _on_command(self, c: Command) -> None:
        moves, expires_s, stops = c.kind != Command.RECORD, c.expires.to_sec(), _stops(c)
        verdict, answer = self._log.judge(rospy.get_time(), c.vehicle, c.sender, c.number, moves, expires_s, stops)
        if verdict is Verdict.EXECUTE:
            self._enqueue(c)
        elif verdict is Verdict.EXPIRED:
            self._answer(c, CommandAck.EXPIRED, "came too late, or after a newer one")
        elif verdict is Verdict.REPEAT:
            self._publish(c, answer)

    def _enqueue(self, c: Command) -> None:
        """A stop is done before queued commands, and these are dropped."""
        if not _stops(c):
            self._jobs.put(c)
            return
        recording = []
        while True:
            try:
                waiting = self._jobs.get_nowait()
            except queue.Empty:
                break
            if waiting.kind == Command.RECORD:
                recording.append(waiting)
            else:
                self._answer(waiting, CommandAck.REFUSED, "overtaken by a command to stop")
        for waiting in recording:
            self._jobs.put(waiting)
        if c.kind == Command.HOLD:  # needs no service: at once
            self._attempt(c)
        else:
            self._stops.put(c)

    # ---- what is done --------------------------------------------------------------------------------------

    def _stream(self, _event) -> None:
        """Repeats the last target; needs no other machine."""
        with self._lock:
            target = self._holder.target
            alone = self._link_loss.land(time.monotonic(), self._holder.mode, self._holder.armed)
        if target is not None:
            self._set_points.publish(conversions.pose_stamped(target, rospy.get_time(), frames.odom(self._name)))
        if alone:
            rospy.logerr("%s: nothing from the control PC for too long, landing", self._name)
            soon = rospy.Time.from_sec(rospy.get_time() + 5.0)
            self._stops.put(Command(vehicle=self._name, sender="agent", kind=Command.LAND, expires=soon))

    def _work(self, waiting: "queue.Queue[Command]") -> None:
        while not rospy.is_shutdown():
            try:
                command = waiting.get(timeout=0.2)
            except queue.Empty:
                continue
            if rospy.get_time() > command.expires.to_sec() and not _stops(command):
                self._answer(command, CommandAck.EXPIRED, "waited too long for the command before it")
            else:
                self._attempt(command)

    def _attempt(self, c: Command) -> None:
        try:
            self._execute(c)
            self._answer(c, CommandAck.DONE, "")
        except (FcsvError, rospy.ServiceException, rospy.ROSException) as error:
            self._answer(c, CommandAck.REFUSED, str(error))

    def _execute(self, c: Command) -> None:
        if c.kind not in self._actions:
            raise CommandRefused(f"command kind {c.kind} is not known")
        self._actions[c.kind](c)

    def _command_mode(self, c: Command) -> None:
        if c.mode not in _MISSION_MODES and not self._parameters.maintenance:
            allowed = ", ".join(sorted(_MISSION_MODES))
            raise CommandRefused(f"mode '{c.mode}' is for pilots; a mission may ask for {allowed}")
        self._change_mode(c.mode)

    def _change_mode(self, mode: str) -> None:
        self._call(self._set_mode, lambda s: s(0, mode).mode_sent)

    def _go_to(self, c: Command) -> None:
        T_odom_body = conversions.pose_to_transform(c.target.pose)
        with self._lock:
            self._holder.go_to(T_odom_body, c.target.header.frame_id)

    def _hold(self, _c: Command) -> None:
        with self._lock:
            self._holder.hold()

    def _take_off(self, c: Command) -> None:
        with self._lock:
            self._holder.take_off(rospy.get_time(), c.altitude_m)
        time.sleep(_QUIET_S)
        try:
            self._call(self._takeoff, lambda s: s(0, 0, 0, 0, c.altitude_m).success)
        except Exception:
            with self._lock:
                self._holder.take_off_refused()
            raise

    def _call(self, service, ask) -> None:
        asked_s = time.monotonic()
        rospy.wait_for_service(service.resolved_name, timeout=self._parameters.service_timeout_s)
        if not ask(service):
            raise ControlError(self._reason(asked_s))

    def _reason(self, asked_s: float) -> str:
        """Why the flight link refused since ``asked_s``: the reason comes by another way than the answer. MAVROS gives
        none; then it is what the autopilot said last."""
        until_s = time.monotonic() + _REASON_WAIT_S
        while time.monotonic() < until_s:
            reasons = _since(asked_s, self._refusals)
            if reasons:
                return reasons[-1]
            time.sleep(0.02)
        return ["the flight link refused without a reason", *_since(asked_s, self._texts)][-1]

    def _answer(self, c: Command, result: int, reason: str) -> None:
        answer = Answer(result, reason)
        self._log.answered(c.sender, c.number, answer)
        if result != CommandAck.DONE:
            self._health.drop("command", f"{c.kind}: {reason}")
        self._publish(c, answer)

    def _publish(self, c: Command, answer: Answer) -> None:
        header = conversions.header(rospy.get_time(), "")
        self._acks.publish(CommandAck(header, self._name, c.sender, c.number, answer.result, answer.reason))


def _stops(c: Command) -> bool:
    """Whether a command stops the vehicle: it never waits and never comes too late."""
    return c.kind in (Command.HOLD, Command.LAND) or (c.kind == Command.SET_MODE and c.mode in _STOPPING_MODES)


def _since(asked_s: float, said: List[Tuple[float, str]]) -> List[str]:
    return [text for at_s, text in said if at_s >= asked_s]


def main() -> int:
    """Run the node."""
    return node.run("agent", AgentNode)
