# SPDX-License-Identifier: Apache-2.0
"""What must be true before take-off, of this vehicle, by what is heard on board: `flight_check`,
once a second; and the worst lines of its diagnostics: `diagnostics/worst`."""

import math
import shutil
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Optional

import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from fcsv_control.conditions import Grade
from fcsv_control.flight_check import keys
from fcsv_control.flight_check.autopilot_line import AutopilotLine
from fcsv_control.flight_check.lines import Judged, Line, worst
from fcsv_control.flight_check.links import CHECKS, MAVLINK, TELLO
from fcsv_control.flight_check.pace import Pace
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.flight_check.vehicle import Disk, VehicleFacts
from fcsv_control.ros.checks import flight_check_messages as messages
from fcsv_control.ros.checks.diagnostics_digest import ON_THE_WAY_BYTES, DiagnosticsDigest
from fcsv_control.ros.checks.relay_keys import RelayKeys
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
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
        self._name, self._rules, self._lock = p.vehicle, p.rules, threading.Lock()
        self._facts = VehicleFacts(relay=p.link, line=p.line)
        self._judged, self._pace = Judged(p.vehicle, CHECKS[p.flight_link]), Pace()
        self._pictures = "camera/color/camera_info" if p.flight_link == TELLO else "tags/detections"
        self._odometry: Optional[rospy.AnyMsg] = None
        self._states = None
        self._health = Health(p.vehicle)
        self._publisher = rospy.Publisher("flight_check", FlightCheck, queue_size=2, latch=True)
        shares_its_master = p.flight_link == TELLO
        self._diagnostics = DiagnosticsDigest(f"{p.vehicle}/" if shares_its_master else "")
        self._subscribe()
        self._timer = node.every(_STEP_S, self._step)

    def _subscribe(self) -> None:
        f = self._facts

        def hear(topic, kind, call):
            return rospy.Subscriber(topic, kind, call, queue_size=5, tcp_nodelay=True)

        hear("mavros/local_position/pose", rospy.AnyMsg, lambda _m: self._tell(f.positions.tell))
        hear("odometry/state", rospy.AnyMsg, self._on_odometry)
        hear(self._pictures, rospy.AnyMsg, lambda _m: self._tell(f.pictures.tell))
        hear("flight_link/health", LinkHealth, lambda m: self._tell(f.link.tell, m))
        hear("flight_link/parameters", ParameterReport, lambda m: self._tell(f.parameters.tell, m))
        hear("mavros/state", FlightState, lambda m: self._tell(f.armed.tell, m.armed))
        hear(
            "mavros/battery",
            BatteryState,
            lambda m: self._tell(f.battery_share.tell, conversions.battery_share(m)),
        )
        hear("mavros/statustext/recv", StatusText, lambda m: self._tell(f.texts.add, m.text))
        hear("guardian/state", GuardianState, lambda m: self._tell(f.guardian.tell, m))
        hear("agent/alive", Heartbeat, lambda m: self._tell(f.agent.tell, m))
        hear("recorder/status", RecorderStatus, self._on_recorder)
        self._keys = RelayKeys(self._name, "relay", lambda told: self._tell(f.keys.tell, told))

    def _tell(self, hear, *what) -> None:
        with self._lock:
            hear(time.monotonic(), *what)

    def _on_odometry(self, message: rospy.AnyMsg) -> None:
        self._odometry = message

    def _on_recorder(self, message: RecorderStatus) -> None:
        self._tell(self._facts.recorder.tell, message)
        disk = disk_of(message, self._health)
        if disk is not None:
            self._tell(self._facts.disk.tell, disk)

    def _step(self, _event) -> None:
        raw, self._odometry = self._odometry, None
        if raw is not None:
            variance_m2 = Odometry().deserialize(raw._buff).pose.covariance[0]
            self._tell(self._facts.tracker_variance_m2.tell, variance_m2)
        with self._lock:
            lines = self._judged.lines(time.monotonic(), self._facts, self._rules)
        self._publish(lines)
        self._diagnostics.step()

    def _publish(self, lines) -> None:
        states = [line.state for line in lines]
        message = messages.small(self._name, lines, 0.0)
        size = messages.size_bytes(message) + ON_THE_WAY_BYTES
        message.next_s = self._pace.period_s(size)
        if self._pace.due(time.monotonic(), size, states != self._states):
            self._tell_log(lines)
            self._states = states
            self._publisher.publish(message)

    def _tell_log(self, lines) -> None:
        """What is not green, where it changed."""
        self._health.value("flight check", worst(lines).word)
        for i, line in enumerate(lines):
            if self._states is None or self._states[i] is line.state:
                continue
            log = rospy.loginfo if line.state is Grade.GREEN else rospy.logwarn
            log("flight check of %s: %s", self._name, in_words(line))


def disk_of(message: RecorderStatus, health: Health) -> Optional[Disk]:
    """The disk of a recorder on this machine; None where it cannot be looked at."""
    try:
        free_mib = shutil.disk_usage(Path(message.path).parent).free / 2**20
    except OSError as error:
        health.drop("disk", f"{message.path}: {error.strerror}")
        return None
    return Disk(free_mib, getattr(message, "minutes_left", math.nan))


def in_words(line: Line) -> str:
    """One line for a log.

    >>> in_words(Line("uav1", "battery", Grade.AMBER, "31%", "change it"))
    'battery amber: 31% (change it)'
    """
    return f"{line.name} {line.state.word}: {line.what}" + (
        f" ({line.remedy})" if line.remedy else ""
    )


def main() -> int:
    """Run the node."""
    return node.run("vehicle_check", VehicleCheckNode)
