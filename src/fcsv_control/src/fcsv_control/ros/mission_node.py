# SPDX-License-Identifier: Apache-2.0
"""The mission on the control PC: topics into snapshots, orders into commands, the operator's confirmations."""

import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.mission import check_gate
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.outbox import Order
from fcsv_control.mission.pairs_seen import PairsSeen
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.standing import CaptureWindow
from fcsv_control.mission.tag_in_front import TagInFront
from fcsv_control.mission.time_of_day import TimeOfDay
from fcsv_control.ros import flight_check_messages as check_messages
from fcsv_control.ros.capture_message import capture_message
from fcsv_control.ros.mission_desk import MissionDesk
from fcsv_control.ros.mission_inputs import RecorderInput, inputs_of
from fcsv_control.ros.mission_memory import MissionMemory, Restored
from fcsv_geometry import home_messages
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.mission import load_mission
from fcsv_geometry.phases import BY_HOME, PHASES
from fcsv_geometry.ros import conversions, fences, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import (
    Calibration,
    Capture,
    Command,
    CommandAck,
    Fence,
    FlightCheck,
    Heartbeat,
    Home,
    MissionState,
    PairLook,
)  # fmt: skip
from fcsv_msgs.srv import Calibrate, Proceed, ProceedResponse, SetHome

_ALIVE_S = 0.2
_OTHERS_TELL_S = 3.0  # so long after a restart a calibration node that lives has told calibration and home


@dataclass(frozen=True)
class MissionParameters:
    """Parameters of the node; the fleet is a column, front first. ``memory_dir``: where a restart finds how far it was;
    empty: a restart begins anew. ``recorder``: name of the control PC's recorder, which must be well; empty: none.
    """

    mission: str
    vehicles: List[str]
    vehicles_dir: str
    rate_hz: float = 10.0
    memory_dir: str = ""
    flight_check: str = check_gate.REQUIRED  # or off: for a bench without fleet_check
    recorder: str = ""

    def __post_init__(self):
        if self.flight_check not in check_gate.CHOICES:
            raise ValueError(f"flight_check: '{self.flight_check}' is not one of {', '.join(check_gate.CHOICES)}")
        if not 1.0 <= self.rate_hz <= 100.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..100")


class MissionNode:
    """Steps the machine at ``rate_hz``. Raises FcsvError on a mission that this fleet cannot fly."""

    def __init__(self):
        self._parameters = node.parameters(MissionParameters)
        names = self._names = self._parameters.vehicles
        self._vehicles = node.vehicles(self._parameters.vehicles_dir, names)
        self._mission = load_mission(self._parameters.mission)
        rospy.loginfo("%s", self._mission)
        gate = check_gate.CheckGate() if self._parameters.flight_check == check_gate.REQUIRED else check_gate.OpenGate()
        self._machine = MissionMachine(self._mission, names, {n: v.radius_m for n, v in self._vehicles.items()}, gate)
        self._sender = f"mission-{os.getpid()}-{int(time.time())}"
        self._lock = threading.RLock()
        self._in_home = HomeFrames()
        self._published_captures = 0
        self._so_far: List[CaptureWindow] = []  # published
        self._health = Health("mission")
        self._started_s, self._alive_s = time.monotonic(), float("-inf")
        self._alive = rospy.Publisher("/mission/alive", Heartbeat, queue_size=2)
        self._stop_over = rospy.Publisher("/stop_all/over", String, queue_size=2)
        self._memory = MissionMemory(self._parameters.memory_dir, self._mission, names, self._health)
        self._restored, self._judged = self._recall(), False
        self._begun_s = time.monotonic()
        self._state = rospy.Publisher("/mission/state", MissionState, queue_size=10, latch=True)
        self._captures = rospy.Publisher("/mission/capture", Capture, queue_size=50, latch=True)
        self._file = rospy.Publisher("/mission/file", String, queue_size=1, latch=True)
        self._file.publish(String(Path(self._parameters.mission).read_text()))
        self._fence = rospy.Publisher("/mission/fence", Fence, queue_size=1, latch=True)
        self._fence.publish(fences.to_message(self._mission.fence, rospy.get_time()))
        self._commands = {n: rospy.Publisher(f"/{n}/command", Command, queue_size=20) for n in names}
        self._calibrate = rospy.ServiceProxy("/calibrate", Calibrate)
        self._set_home = rospy.ServiceProxy("/set_home", SetHome)
        rospy.Service("/mission/proceed", Proceed, self._on_proceed)
        rospy.Service("/mission/abort", Trigger, self._on_abort)
        self._desk = MissionDesk(self._machine, self._lock)
        self._inputs = inputs_of([self._vehicles[n] for n in names], self._health)
        self._tag_in_front, self._pairs_seen, self._time_of_day = TagInFront(), PairsSeen(), TimeOfDay()
        self._recorder = RecorderInput(self._parameters.recorder) if self._parameters.recorder else None
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        rospy.Subscriber("/home", Home, self._on_home, queue_size=1)
        rospy.Subscriber("/flight_check", FlightCheck, self._on_flight_check, queue_size=2)
        rospy.Subscriber("/pair_check", PairLook, self._on_pair, queue_size=10)
        rospy.Subscriber("/stop_all", String, self._on_stop_all, queue_size=5, tcp_nodelay=True)
        rospy.Subscriber("/land_all", String, self._on_land_all, queue_size=5, tcp_nodelay=True)
        for name in names:
            rospy.Subscriber(f"/{name}/command_ack", CommandAck, self._on_ack, queue_size=20)

    # ---- what is heard -------------------------------------------------------------------------------------

    def _on_ack(self, message: CommandAck) -> None:
        if message.sender != self._sender:
            return
        outcome = "" if message.result == CommandAck.DONE else message.reason or "refused without a reason"
        with self._lock:
            self._machine.outbox.acknowledged(message.vehicle, message.number, outcome)

    def _on_calibration(self, message: Calibration) -> None:
        self._hear("calibration", message)

    def _on_home(self, message: Home) -> None:
        self._hear("home", message)

    def _hear(self, kind: str, message) -> None:
        with self._lock:
            if self._restored is None or self._restored.told_by(kind, message._connection_header["callerid"]):
                self._compose(kind, message)

    def _compose(self, kind: str, message) -> None:
        take = {"calibration": home_messages.take_calibration, "home": home_messages.take_home}[kind]
        try:
            take(self._in_home, message)
            self._memory.heard(kind, message)
        except FcsvError as error:
            self._health.drop("calibration or home", str(error))

    # ---- over a restart ------------------------------------------------------------------------------------

    def _recall(self) -> Optional[Restored]:
        memory = self._memory.load()
        if memory is None:
            return None
        rospy.loginfo("found the memory of a mission in %s", memory.phase)
        self._machine.restore(memory)
        return Restored(memory, self._compose)

    def _judge(self, now_s: float) -> None:
        """Once the machine knows whether the last run's memory counts: its calibration and home count, or do not."""
        for text in self._machine.said:
            rospy.logwarn("%s", text)
        self._machine.said.clear()
        if self._restored is None or self._judged or self._machine.memory() is None:
            return
        if self._machine.phase not in BY_HOME:
            self._restored, self._in_home = None, HomeFrames()
            self._memory.forget()
        elif now_s - self._begun_s >= _OTHERS_TELL_S:
            self._restored.publish()
            self._judged = True

    def _on_flight_check(self, message: FlightCheck) -> None:
        lines, patience_s = check_messages.lines_of(message), check_messages.patience_s(message)
        with self._lock:
            self._machine.gate.tell(time.monotonic(), lines, patience_s)

    def _on_pair(self, message: PairLook) -> None:
        with self._lock:
            self._pairs_seen.looked(time.monotonic(), message.reference, message.vehicle, message.off)

    def _on_stop_all(self, message: String) -> None:
        with self._lock:
            self._machine.stopped(message.data or "by a topic")

    def _on_land_all(self, message: String) -> None:
        with self._lock:
            self._machine.abort(f"landing everybody: {message.data or 'by a topic'}")

    # ---- the operator --------------------------------------------------------------------------------------

    def _on_proceed(self, request) -> ProceedResponse:
        with self._lock:
            refusal = self._machine.proceed(request.step)
            wants, self._machine.wants = self._machine.wants, ""
        if request.step == "resume" and not refusal:
            self._stop_over.publish(String("the operator resumes"))
        if wants:
            threading.Thread(target=self._call, args=(wants,), name=wants, daemon=True).start()
        return ProceedResponse(not refusal, refusal or f"confirmed: {request.step}")

    def _on_abort(self, _request) -> TriggerResponse:
        with self._lock:
            if self._machine.over:
                return TriggerResponse(False, f"the mission is over ({self._machine.phase})")
            self._machine.abort("aborted by the operator: landing")
        return TriggerResponse(True, "landing the vehicles that the mission flies; who is flown by hand lands by hand")

    def _call(self, wants: str) -> None:
        service, arguments = {
            "calibrate": (self._calibrate, (self._names, 0.0)),
            "set_home": (self._set_home, (self._mission.reference,)),
        }[wants]
        try:
            answer = service(*arguments)
            success, message = answer.success, answer.message
        except (rospy.ServiceException, rospy.ROSException) as error:
            success, message = False, f"{service.resolved_name}: {error}"
        rospy.loginfo("%s: %s", wants, message)
        with self._lock:
            self._machine.answer(wants, success, message)

    # ---- the loop ------------------------------------------------------------------------------------------

    def spin(self) -> None:
        """Step, send what is due, publish the state, until ROS ends."""
        while not rospy.is_shutdown():
            with self._lock:
                now_s = time.monotonic()
                phase = self._machine.phase
                self._machine.step(self._snapshot(now_s))
                if self._machine.phase != phase:
                    rospy.loginfo("%s -> %s: %s", phase, self._machine.phase, self._machine.detail)
                self._judge(now_s)
                for order in self._machine.outbox.due(now_s):
                    self._commands[order.vehicle].publish(self._command(order, now_s))
                self._publish(now_s)
                self._live(now_s)
                self._memory.keep(now_s, self._machine.memory())
            self._desk.tell(now_s)
            time.sleep(1.0 / self._parameters.rate_hz)

    def _live(self, now_s: float) -> None:
        """A sign of life for the agents: who commands, and his clock."""
        if now_s - self._alive_s >= _ALIVE_S - 1e-3:
            self._alive_s = now_s
            header = conversions.header(rospy.get_time(), "")
            self._alive.publish(Heartbeat(header, self._sender, self._started_s, time.monotonic(), "", ""))

    def _snapshot(self, now_s: float) -> Snapshot:
        T_home_odom = self._in_home.T_home_odom
        views = {n: i.view(now_s, T_home_odom.get(n)) for n, i in self._inputs.items()}
        cameras = {n: v.T_body_cam for n, v in self._vehicles.items()}
        recorder = None if self._recorder is None else self._recorder.view(now_s)
        self._time_of_day.see(time.monotonic(), rospy.get_time(), time.monotonic())
        views = self._pairs_seen.judge(self._tag_in_front.judge(now_s, views, T_home_odom), T_home_odom)
        slows_mps2 = self._mission.flight.acceleration_mps2
        return Snapshot(now_s, views, T_home_odom, cameras, recorder, self._time_of_day.times_set, slows_mps2)

    def _command(self, order: Order, now_s: float) -> Command:
        a = order.arguments
        command = Command(header=conversions.header(rospy.get_time(), ""), vehicle=order.vehicle, sender=self._sender)
        command.number, command.ordered_s, command.sent_s = order.number, order.ordered_s, now_s
        command.lifetime_s = order.expires_s - order.ordered_s
        command.kind = getattr(Command, order.kind)
        command.mode, command.flag = a.get("mode", ""), a.get("flag", False)
        if "target" in a:
            command.target = conversions.pose_stamped(a["target"], rospy.get_time(), a["frame"])
        return command

    def _publish(self, now_s: float) -> None:
        """``now_s``: monotonic."""
        m = self._machine
        self._health.value("phase", m.phase)
        self._health.problem("mission", "; ".join(m.problems))
        self._state.publish(MissionState(
            header=conversions.header(rospy.get_time(), ""), phase=PHASES.index(m.phase), phase_name=m.phase,
            detail=m.detail, waits_for=m.waits_for, stage=m.stage, configuration=m.configuration,
            configurations=len(self._mission.configurations), problems=m.problems,
        ))  # fmt: skip
        if self._restored is not None and not self._judged:
            return  # after a restart recordings are told again, once who records them is connected
        day = self._time_of_day
        for window in [*(w for w in m.so_far if w not in self._so_far), *m.captures[self._published_captures :]]:
            self._captures.publish(capture_message(self._mission, window, day.offset_s))
        self._so_far, self._published_captures = list(m.so_far), len(m.captures)


def main() -> int:
    """Run the node."""
    return node.run("mission", MissionNode)
