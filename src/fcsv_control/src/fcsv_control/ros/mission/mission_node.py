# SPDX-License-Identifier: Apache-2.0
"""The mission on the control PC as a node: topics, services and files around its port."""

import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence

import rospy
from std_msgs.msg import String

from fcsv_control.agent.lease import MISSIONS
from fcsv_control.agent.messages import Instruction
from fcsv_control.control_messages import (
    CheckTable,
    FollowAsked,
    FramesJudged,
    MissionAlive,
    MissionStatus,
    PairLooked,
    ServiceAnswered,
    ServiceWanted,
    StopCalled,
    StopOver,
    WallClock,
)
from fcsv_control.mission.memory import Memory
from fcsv_control.mission.port import Captured, MissionPort
from fcsv_control.mission.watches import check_gate
from fcsv_control.mission.ways.places import FollowPlace
from fcsv_control.ros.checks import flight_check_messages as check_messages
from fcsv_control.ros.mission.capture_message import capture_message
from fcsv_control.ros.mission.mission_desk import MissionDesk
from fcsv_control.ros.mission.mission_memory import MissionMemory, Restored
from fcsv_control.ros.mission.vehicle_messages import TOPICS, command_of
from fcsv_control.stopping.core import LAND, STOP
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.missions.phases import PHASES
from fcsv_geometry.ros import conversions, fences, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.ros.telemetry_messages import (
    calibration_of,
    home_of,
    subscribe,
    subscribe_epochs,
    subscribe_relay,
)
from fcsv_geometry.vehicles.telemetry import RecorderState, Reply
from fcsv_msgs.msg import (
    Calibration,
    Capture,
    Command,
    Fence,
    FlightCheck,
    Heartbeat,
    Home,
    MissionState,
    PairLook,
    RecorderStatus,
    VehicleMove,
)
from fcsv_msgs.srv import Calibrate, CalibrateInFlight, SetHome


@dataclass(frozen=True)
class MissionParameters:
    """Parameters of the node; the fleet is a column, front first. ``memory_dir``: where a restart
    finds how far it was; empty: a restart begins anew. ``recorder``: name of the control PC's
    recorder, which must be well; empty: none.
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
            raise ValueError(
                f"flight_check: '{self.flight_check}' is not one of {', '.join(check_gate.CHOICES)}"
            )
        if not 1.0 <= self.rate_hz <= 100.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..100")


class MissionNode:
    """Steps its port at ``rate_hz``. Raises FcsvError on a mission that this fleet cannot fly."""

    def __init__(self):
        p = self._parameters = node.parameters(MissionParameters)
        column = [node.vehicles(p.vehicles_dir, p.vehicles)[n] for n in p.vehicles]
        self._mission = load_mission(p.mission)
        rospy.loginfo("%s", self._mission)
        gate = (
            check_gate.CheckGate()
            if p.flight_check == check_gate.REQUIRED
            else check_gate.OpenGate()
        )
        sender = f"{MISSIONS}{os.getpid()}-{int(time.time())}"
        self._lock, self._started_s = threading.RLock(), time.monotonic()
        self._health = Health("mission")
        self._alive = rospy.Publisher("/mission/alive", Heartbeat, queue_size=2)
        self._stop_over = rospy.Publisher("/stop_all/over", String, queue_size=2)
        self._memory = MissionMemory(p.memory_dir, self._mission, p.vehicles, self._health)
        memory = self._memory.load()
        self._port = MissionPort(
            self._mission,
            column,
            sender,
            self._started_s,
            gate,
            memory,
            p.recorder,
            unfinished=self._memory.unfinished,
        )
        self._restored: Optional[Restored] = None if memory is None else Restored(memory)
        for kind, message in {} if self._restored is None else self._restored.messages.items():
            self._compose(kind, message)
        self._state = rospy.Publisher("/mission/state", MissionState, queue_size=10, latch=True)
        self._captures = rospy.Publisher("/mission/capture", Capture, queue_size=50, latch=True)
        self._file = rospy.Publisher("/mission/file", String, queue_size=1, latch=True)
        self._file.publish(String(Path(p.mission).read_text()))
        self._fence = rospy.Publisher("/mission/fence", Fence, queue_size=1, latch=True)
        self._fence.publish(fences.to_message(self._mission.fence, rospy.get_time()))
        self._commands = {
            n: rospy.Publisher(f"/{n}/command", Command, queue_size=20) for n in p.vehicles
        }
        self._calibrate = rospy.ServiceProxy("/calibrate", Calibrate)
        self._calibrate_in_flight = rospy.ServiceProxy("/calibrate_in_flight", CalibrateInFlight)
        self._set_home = rospy.ServiceProxy("/set_home", SetHome)
        self._publish: Dict[type, Callable[[Any], None]] = {
            Instruction: self._command,
            Memory: self._memory.keep,
            Captured: self._capture,
            FramesJudged: self._judged,
            MissionAlive: self._live,
            MissionStatus: self._publish_state,
            ServiceWanted: self._call,
            StopOver: lambda m: self._stop_over.publish(String(m.reason)),
        }
        self._desk = MissionDesk(self._mission.recorded, self._serve)
        self._subscribe()

    def _subscribe(self) -> None:
        p = self._parameters
        subscribe_relay(self._receive)
        for name in p.vehicles:
            subscribe(name, list(TOPICS), self._receive, self._health, TOPICS)
        if p.recorder:
            rospy.Subscriber(
                f"/{p.recorder}/recorder/status", RecorderStatus, self._on_recorder, queue_size=5
            )
        subscribe_epochs(self._receive)
        rospy.Subscriber(
            "/calibration", Calibration, lambda m: self._on_frames("calibration", m), queue_size=1
        )
        rospy.Subscriber("/home", Home, lambda m: self._on_frames("home", m), queue_size=1)
        rospy.Subscriber("/flight_check", FlightCheck, self._on_flight_check, queue_size=2)
        rospy.Subscriber("/pair_check", PairLook, self._on_pair, queue_size=10)
        rospy.Subscriber("/mission/follow", VehicleMove, self._on_follow, queue_size=10)
        for asked in (STOP, LAND):
            rospy.Subscriber(
                f"/{asked}_all", String, self._on_stop, asked, queue_size=5, tcp_nodelay=True
            )

    # ---- what is heard ---------------------------------------------------------------------------

    def _receive(self, message: object) -> None:
        with self._lock:
            self._port.receive(time.monotonic(), message)

    def _on_recorder(self, m: RecorderStatus) -> None:
        self._receive(RecorderState(self._parameters.recorder, "", m.problem, m.pictures))

    def _on_frames(self, kind: str, message) -> None:
        with self._lock:
            if self._restored is None or self._restored.published_by(
                kind, message._connection_header["callerid"]
            ):
                self._compose(kind, message)

    def _compose(self, kind: str, message) -> None:
        try:
            found = calibration_of(message) if kind == "calibration" else home_of(message)
        except FcsvError as error:
            self._health.drop("calibration or home", str(error))
            return
        self._memory.remember(kind, message)
        self._receive(found)

    def _on_flight_check(self, m: FlightCheck) -> None:
        self._receive(CheckTable(check_messages.lines_of(m), check_messages.patience_s(m)))

    def _on_pair(self, m: PairLook) -> None:
        self._receive(PairLooked(m.reference, m.vehicle, m.off))

    def _on_follow(self, m: VehicleMove) -> None:
        turned = (m.z_m, m.yaw_rad) if m.with_pose else ()
        place = FollowPlace(m.x_m, m.y_m, *turned)
        answer = self._serve(FollowAsked(m.header.frame_id, m.vehicle, place))
        if not answer.done:
            self._health.drop("follow", answer.text)

    def _on_stop(self, message: String, asked: str) -> None:
        self._receive(StopCalled(asked, message.data or "by a topic"))

    def _serve(self, request: object) -> Reply:
        with self._lock:
            answer, *outputs = self._port.serve(time.monotonic(), request)
            self._send(outputs)
        return answer

    # ---- what is told ----------------------------------------------------------------------------

    def spin(self) -> None:
        """Step the port and send what it gives, until ROS ends."""
        while not rospy.is_shutdown():
            with self._lock:
                before_s, wall_s, now_s = time.monotonic(), rospy.get_time(), time.monotonic()
                self._port.receive(now_s, WallClock(before_s, wall_s, now_s))
                outputs = self._port.step(now_s)
                self._send(outputs)
            self._desk.tell(now_s, next(o for o in outputs if isinstance(o, MissionStatus)))
            time.sleep(1.0 / self._parameters.rate_hz)

    def _send(self, outputs: Sequence[object]) -> None:
        for output in outputs:
            self._publish[type(output)](output)

    def _live(self, m: MissionAlive) -> None:
        """A sign of life for the agents: who commands, and his clock."""
        header = conversions.header(rospy.get_time(), "")
        self._alive.publish(Heartbeat(header, m.sender, self._started_s, m.sent_s, "", ""))

    def _judged(self, m: FramesJudged) -> None:
        if m.count:
            self._restored.publish()
        else:
            self._restored = None
            self._memory.forget()

    def _command(self, i: Instruction) -> None:
        self._commands[i.vehicle].publish(command_of(i))

    def _publish_state(self, m: MissionStatus) -> None:
        self._health.value("phase", m.phase)
        self._health.problem("mission", "; ".join(m.problems))
        self._state.publish(
            MissionState(
                header=conversions.header(rospy.get_time(), ""),
                phase=PHASES.index(m.phase),
                phase_name=m.phase,
                detail=m.detail,
                waits_for=m.waits_for,
                stage=m.stage,
                configuration=m.configuration,
                configurations=len(self._mission.configurations),
                station=m.station,
                heading_rad=m.heading_rad,
                problems=m.problems,
            )
        )

    def _capture(self, c: Captured) -> None:
        self._captures.publish(capture_message(self._mission, c))

    def _call(self, wanted: ServiceWanted) -> None:
        threading.Thread(
            target=self._call_now, args=(wanted.name,), name=wanted.name, daemon=True
        ).start()

    def _call_now(self, name: str) -> None:
        service, arguments = {
            "calibrate": (self._calibrate, (self._parameters.vehicles, 0.0)),
            "calibrate_in_flight": (self._calibrate_in_flight, (self._parameters.vehicles,)),
            "set_home": (self._set_home, (self._mission.reference,)),
        }[name]
        try:
            answer = service(*arguments)
            drifted = name == "calibrate_in_flight" and answer.drifted
            self._receive(ServiceAnswered(name, answer.success, answer.message, drifted))
        except (rospy.ServiceException, rospy.ROSException) as error:
            self._receive(ServiceAnswered(name, False, f"{service.resolved_name}: {error}"))


def main() -> int:
    """Run the node."""
    return node.run("mission", MissionNode)
