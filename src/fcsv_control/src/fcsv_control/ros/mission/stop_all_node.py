# SPDX-License-Identifier: Apache-2.0
"""/stop_all and /land_all on the control PC, in a process of their own that needs no mission.

Services of these names (std_srvs/Trigger), and topics (std_msgs/String: the reason) on which
anybody may call. The mission hears the topics, too, and does nothing more by itself until the
operator confirms ``resume``.
"""

import os
import threading
import time
from dataclasses import dataclass, field
from typing import Dict, List, Sequence

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.agent.messages import Instruction
from fcsv_control.control_messages import CommandAnswered, StopCalled, StopOver
from fcsv_control.ros.mission.vehicle_messages import TOPICS, command_of
from fcsv_control.stopping.core import LAND, STOP, Report
from fcsv_control.stopping.port import StopAllPort
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.ros.telemetry_messages import phase_of, subscribe
from fcsv_geometry.vehicles.telemetry import VehicleState
from fcsv_msgs.msg import Command, MissionState, StopReport

_STEP_HZ = 50.0


@dataclass(frozen=True)
class StopAllParameters:
    """Parameters of the node: everybody who is stopped."""

    vehicles: List[str] = field(default_factory=list)

    def __post_init__(self):
        if not self.vehicles:
            raise ValueError("vehicles: is empty; name everybody who is to be stopped")


class StopAllNode:
    """What is due is sent by the caller's own thread at once, then by a timer."""

    def __init__(self):
        names = node.parameters(StopAllParameters).vehicles
        self._port = StopAllPort(names, f"stop_all-{os.getpid()}-{os.urandom(3).hex()}")
        self._lock, self._health = threading.RLock(), Health("stop_all")
        self._commands: Dict[str, rospy.Publisher] = {
            n: rospy.Publisher(f"/{n}/command", Command, queue_size=20, tcp_nodelay=True)
            for n in names
        }
        self._report = rospy.Publisher("/stop_all/report", StopReport, queue_size=5, latch=True)
        self._told = {
            asked: rospy.Publisher(f"/{asked}_all", String, queue_size=5, tcp_nodelay=True)
            for asked in (STOP, LAND)
        }
        self._timer = node.every(1.0 / _STEP_HZ, lambda _event: self._step())
        for name in names:
            subscribe(name, (VehicleState, CommandAnswered), self._receive, self._health, TOPICS)
        rospy.Subscriber(
            "/mission/state", MissionState, lambda m: self._receive(phase_of(m)), queue_size=1
        )
        rospy.Subscriber(
            "/stop_all/over", String, lambda m: self._receive(StopOver(m.data)), queue_size=1
        )
        for asked in (STOP, LAND):
            rospy.Subscriber(
                f"/{asked}_all", String, self._on_topic, asked, queue_size=5, tcp_nodelay=True
            )
        rospy.Service("/stop_all", Trigger, lambda request: self._on_service(request, STOP))
        rospy.Service("/land_all", Trigger, lambda request: self._on_service(request, LAND))

    def _on_service(self, request, asked: str) -> TriggerResponse:
        reason = f"by {request._connection_header.get('callerid', 'somebody')}"
        with self._lock:
            answer, *outputs = self._port.serve(time.monotonic(), StopCalled(asked, reason))
            self._send(outputs)
        return TriggerResponse(answer.done, answer.text)

    def _on_topic(self, message: String, asked: str) -> None:
        if message._connection_header.get("callerid") != rospy.get_name():
            self._receive(StopCalled(asked, message.data or "by a topic"))

    def _receive(self, message: object) -> None:
        with self._lock:
            self._port.receive(time.monotonic(), message)
            self._step()

    def _step(self) -> None:
        with self._lock:
            self._send(self._port.step(time.monotonic()))

    def _send(self, outputs: Sequence[object]) -> None:
        for output in outputs:
            if isinstance(output, StopCalled):
                self._told[output.asked].publish(String(output.reason))
            elif isinstance(output, Instruction):
                self._commands[output.vehicle].publish(command_of(output))
            else:
                self._publish_report(output)

    def _publish_report(self, report: Report) -> None:
        self._health.value("asked", report.asked or "nothing")
        self._health.problem("stop all", report.in_words() if report.asked else "")
        self._report.publish(
            StopReport(header=conversions.header(rospy.get_time(), ""), **vars(report))
        )


def main() -> int:
    """Run the node."""
    return node.run("stop_all", StopAllNode)
