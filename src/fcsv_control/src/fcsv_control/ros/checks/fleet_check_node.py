# SPDX-License-Identifier: Apache-2.0
"""What must be true before take-off, of the whole fleet: `/flight_check` on the control PC, and
what is accepted."""

import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Iterable, List

import rospy

from fcsv_control.flight_check import keys
from fcsv_control.flight_check.fleet import FleetCheckRules
from fcsv_control.flight_check.fleet_port import FleetCheckPort
from fcsv_control.flight_check.messages import (
    Accept,
    CheckReport,
    ClockMeasured,
    ParametersReported,
    PositionCounted,
    StopStandsBy,
    TagsCame,
    VehicleReported,
)
from fcsv_control.ros import board_messages as convert
from fcsv_control.ros.checks import flight_check_messages as messages
from fcsv_control.ros.checks.relay_keys import RelayKeys
from fcsv_control.ros.checks.vehicle_check_node import disk_of
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.ros import node
from fcsv_geometry.ros import telemetry_messages as telemetry
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_msgs.msg import (
    ClockOffset,
    FlightCheck,
    Heartbeat,
    MissionState,
    ParameterReport,
    RecorderStatus,
    StopReport,
    TagDetections,
)
from fcsv_msgs.srv import AcceptLine, AcceptLineResponse
from fcsv_tracking.ros.clock_node import from_message

_STEP_S = 0.5


@dataclass(frozen=True)
class FleetCheckParameters:
    """Parameters of the node; ``vehicles``: the whole column, front first; ``link``, ``ground``: as
    control.launch; ``mission``: its file, with whose ``flight`` the autopilots are compared; empty:
    they are not."""

    vehicles: List[str]
    vehicles_dir: str
    link: str = keys.RELAY
    ground: bool = False
    mission: str = ""
    rules: FleetCheckRules = field(default_factory=FleetCheckRules)


class FleetCheckNode:
    """Everything here can be away for a while: the vehicles' own checks go on, and nobody is handed
    over meanwhile."""

    def __init__(self):
        p = node.parameters(FleetCheckParameters)
        tags = {n: v.tag_id for n, v in node.vehicles(p.vehicles_dir, p.vehicles).items()}
        planned = load_mission(p.mission).flight if p.mission else None
        self._port = FleetCheckPort(tags, p.rules, p.link, p.ground, planned)
        self._lock, self._health = threading.RLock(), Health("control")
        self._publisher = rospy.Publisher("/flight_check", FlightCheck, queue_size=2, latch=True)
        rospy.Service("/flight_check/accept", AcceptLine, self._on_accept)
        self._subscribe(tags)
        telemetry.subscribe_epochs(self._receive)
        self._keys = RelayKeys("control", "/relay", self._receive)
        self._timer = node.every(_STEP_S, self._step)

    def _subscribe(self, vehicles: Iterable[str]) -> None:
        health = self._health

        def subscribe(topic: str, kind: type, take: Callable[[Any], object]) -> None:
            taking = convert.taking(topic, take, self._receive, health)
            rospy.Subscriber(topic, kind, taking, queue_size=10)

        for n in vehicles:
            parameters = lambda m, n=n: ParametersReported(n, convert.parameters_of(m))  # noqa: E731
            clock = lambda m, n=n: ClockMeasured(n, _age_s(m), from_message(m))  # noqa: E731
            tags = lambda m, n=n: TagsCame(n, [d.id for d in m.detections])  # noqa: E731
            subscribe(f"/{n}/flight_check", FlightCheck, lambda m, n=n: reported_of(n, m))
            subscribe(f"/{n}/flight_link/parameters", ParameterReport, parameters)
            subscribe(f"/{n}/odometry/state", rospy.AnyMsg, lambda _m, n=n: PositionCounted(n))
            subscribe(f"/{n}/clock/offset", ClockOffset, clock)
            subscribe(f"/{n}/tags/detections", TagDetections, tags)
            telemetry.subscribe(n, [tm.OdometryEpoch], self._receive, health)
        subscribe("/mission/alive", Heartbeat, convert.mission_alive_of)
        subscribe("/mission/state", MissionState, telemetry.phase_of)
        subscribe("/stop_all/report", StopReport, lambda _m: StopStandsBy())
        subscribe("/control/recorder/status", RecorderStatus, convert.recorder_report_of)
        subscribe("/control/recorder/status", RecorderStatus, lambda m: disk_of(m, health))

    def _receive(self, data: object) -> None:
        with self._lock:
            self._port.receive(time.monotonic(), data)

    def _on_accept(self, request) -> AcceptLineResponse:
        with self._lock:
            accept = Accept(request.vehicle, request.line)
            answer, *outputs = self._port.serve(time.monotonic(), accept)
            self._publish_outputs(outputs)
        return AcceptLineResponse(answer.done, answer.text)

    def _step(self, _event) -> None:
        with self._lock:
            self._publish_outputs(self._port.step(time.monotonic()))

    def _publish_outputs(self, outputs: List[object]) -> None:
        for output in outputs:
            if isinstance(output, CheckReport):
                self._publisher.publish(messages.whole(output.lines, output.next_s))
            elif isinstance(output, tm.Dropped):
                self._health.drop(output.what, output.why)
            else:
                self._health.diagnose(output)


def reported_of(vehicle: str, m: FlightCheck) -> VehicleReported:
    """The report that came on a vehicle's topic."""
    return VehicleReported(vehicle, m.vehicle, messages.lines_of(m), messages.patience_s(m))


def _age_s(message) -> float:
    """Gives the age of what this machine stamped by its own clock: a latched one may be old."""
    return max(0.0, rospy.get_time() - message.header.stamp.to_sec())


def main() -> int:
    """Run the node."""
    return node.run("fleet_check", FleetCheckNode)
