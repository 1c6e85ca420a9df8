# SPDX-License-Identifier: Apache-2.0
"""What must be true before take-off, of this vehicle, by what is heard on board: `flight_check`,
once a second; and the worst lines of its diagnostics: `diagnostics/worst`."""

import shutil
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Optional, Sequence

import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from fcsv_control.flight.messages import TextReceived
from fcsv_control.flight_check import keys
from fcsv_control.flight_check.autopilot_line import AutopilotLine
from fcsv_control.flight_check.lines import Line
from fcsv_control.flight_check.links import CHECKS, MAVLINK, TELLO
from fcsv_control.flight_check.messages import (
    CheckReport,
    PictureCounted,
    PositionCounted,
    TrackerTrusts,
    WorstDiagnostics,
)
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.flight_check.vehicle import Disk
from fcsv_control.flight_check.vehicle_port import VehicleCheckPort
from fcsv_control.ros import board_messages as convert
from fcsv_control.ros.checks import flight_check_messages as messages
from fcsv_control.ros.checks.diagnostics_digest import (
    ON_THE_WAY_BYTES,
    DiagnosticsTopics,
    on_the_way_bytes,
)
from fcsv_control.ros.checks.relay_keys import RelayKeys
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import (
    FlightCheck,
    GuardianState,
    Heartbeat,
    LinkHealth,
    ParameterReport,
    RecorderStatus,
)
from mavros_msgs.msg import State as FlightState
from mavros_msgs.msg import StatusText

_STEP_S = 0.5


@dataclass(frozen=True)
class VehicleCheckParameters:
    """Parameters of the node. ``flight_link``: what the vehicle is flown by, mavlink, mavros or
    tello."""

    vehicle: str
    flight_link: str = MAVLINK
    link: str = keys.RELAY  # as in uav.launch
    line: AutopilotLine = field(default_factory=AutopilotLine)
    rules: VehicleCheckRules = field(default_factory=VehicleCheckRules)

    def __post_init__(self):
        if self.flight_link not in CHECKS:
            raise ValueError(f"flight_link: '{self.flight_link}' is not one of {', '.join(CHECKS)}")


class VehicleCheckNode:
    """Poses are counted without being read: their content is not needed thirty times a second."""

    def __init__(self):
        p = node.parameters(VehicleCheckParameters)
        self._name, self._lock = p.vehicle, threading.RLock()
        # several Tellos share a ROS master
        own = f"{p.vehicle}/" if p.flight_link == TELLO else ""
        self._port = VehicleCheckPort(
            p.vehicle,
            CHECKS[p.flight_link],
            p.rules,
            lambda lines: report_bytes(p.vehicle, lines),
            on_the_way_bytes,
            p.link,
            p.line,
            own,
        )
        self._pictures = "camera/color/camera_info" if p.flight_link == TELLO else "tags/detections"
        self._odometry: Optional[rospy.AnyMsg] = None
        self._health = Health(p.vehicle)
        self._publisher = rospy.Publisher("flight_check", FlightCheck, queue_size=2, latch=True)
        self._diagnostics = DiagnosticsTopics(self._on_diagnostics)
        self._subscribe()
        self._timer = node.every(_STEP_S, self._on_time)

    def _subscribe(self) -> None:
        name = self._name

        def subscribe(topic: str, kind: type, take: Callable[[Any], object]) -> None:
            taking = convert.taking(topic, take, self._receive, self._health)
            rospy.Subscriber(topic, kind, taking, queue_size=5, tcp_nodelay=True)

        subscribe("mavros/local_position/pose", rospy.AnyMsg, lambda _m: PositionCounted())
        subscribe("odometry/state", rospy.AnyMsg, lambda m: setattr(self, "_odometry", m))
        subscribe(self._pictures, rospy.AnyMsg, lambda _m: PictureCounted())
        subscribe("flight_link/health", LinkHealth, convert.link_lives_of)
        subscribe("flight_link/parameters", ParameterReport, convert.parameters_of)
        subscribe(
            "mavros/state",
            FlightState,
            lambda m: tm.VehicleState(name, "", Mode(m.mode), m.armed, m.connected),
        )
        subscribe(
            "mavros/battery",
            BatteryState,
            lambda m: tm.BatteryCharge(name, "", conversions.battery_share(m)),
        )
        subscribe("mavros/statustext/recv", StatusText, lambda m: TextReceived(m.severity, m.text))
        subscribe("guardian/state", GuardianState, convert.verdict_of)
        subscribe("agent/alive", Heartbeat, convert.agent_alive_of)
        subscribe("recorder/status", RecorderStatus, convert.recorder_report_of)
        subscribe("recorder/status", RecorderStatus, lambda m: disk_of(m, self._health))
        self._keys = RelayKeys(name, "relay", self._receive)

    def _receive(self, data: object) -> None:
        with self._lock:
            self._port.receive(time.monotonic(), data)

    def _on_diagnostics(self, data: object) -> None:
        self._receive(data)
        self._step()

    def _on_time(self, _event) -> None:
        raw, self._odometry = self._odometry, None
        if raw is not None:
            self._receive(TrackerTrusts(Odometry().deserialize(raw._buff).pose.covariance[0]))
        self._step()

    def _step(self) -> None:
        with self._lock:
            for output in self._port.step(time.monotonic()):
                if isinstance(output, CheckReport):
                    report = messages.small(self._name, output.lines, output.next_s)
                    self._publisher.publish(report)
                elif isinstance(output, WorstDiagnostics):
                    self._diagnostics.publish(output.statuses)
                else:
                    self._health.diagnose(output)


def report_bytes(vehicle: str, lines: Sequence[Line]) -> int:
    """Counts octets of a report and all headers around it."""
    return messages.size_bytes(messages.small(vehicle, lines, 0.0)) + ON_THE_WAY_BYTES


def disk_of(message: RecorderStatus, health: Health) -> Optional[Disk]:
    """The disk of a recorder on this machine; None where it cannot be looked at."""
    try:
        free_mib = shutil.disk_usage(Path(message.path).parent).free / 2**20
    except OSError as error:
        health.drop("disk", f"{message.path}: {error.strerror}")
        return None
    return Disk(free_mib, message.minutes_left)


def main() -> int:
    """Run the node."""
    return node.run("vehicle_check", VehicleCheckNode)
