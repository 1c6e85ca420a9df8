# SPDX-License-Identifier: Apache-2.0
"""What must be true before take-off, of the whole fleet: `/flight_check` on the control PC, and
what is accepted."""

import threading
import time
from dataclasses import dataclass, field
from typing import List

import rospy

from fcsv_control.flight_check import keys
from fcsv_control.flight_check.acceptance import Acceptances
from fcsv_control.flight_check.fleet import FleetCheckRules, FleetTable
from fcsv_control.flight_check.lines import Line, worst
from fcsv_control.ros.checks import flight_check_messages as messages
from fcsv_control.ros.checks.relay_keys import RelayKeys
from fcsv_control.ros.checks.vehicle_check_node import disk_of
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import (
    ClockOffset,
    Epoch,
    Epochs,
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
_NEXT_S = 1.0


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
        self._lock = threading.RLock()
        planned = load_mission(p.mission).flight if p.mission else None
        self._table = FleetTable(list(tags), tags, p.rules, p.link, p.ground, planned)
        self._accepted = Acceptances()
        self._lines: List[Line] = []
        self._shown, self._shown_s = None, float("-inf")
        self._phase = ""
        self._health = Health("control")
        self._publisher = rospy.Publisher("/flight_check", FlightCheck, queue_size=2, latch=True)
        rospy.Service("/flight_check/accept", AcceptLine, self._on_accept)
        self._subscribe()
        self._timer = node.every(_STEP_S, self._step)

    def _subscribe(self) -> None:
        control = self._table.control

        def hear(topic, kind, call):
            rospy.Subscriber(topic, kind, lambda m: self._hear(call, m), queue_size=10)

        for name, v in self._table.vehicles.items():
            hear(f"/{name}/flight_check", FlightCheck, lambda t, m, v=v: self._on_report(t, v, m))
            hear(
                f"/{name}/flight_link/parameters",
                ParameterReport,
                lambda _t, m, v=v: setattr(v, "parameters", m),
            )
            hear(f"/{name}/odometry/state", rospy.AnyMsg, lambda t, _m, v=v: v.poses.tell(t))
            hear(
                f"/{name}/clock/offset",
                ClockOffset,
                lambda t, m, v=v: v.clock.tell(t - _age_s(m), from_message(m)),
            )
            hear(f"/{name}/odometry/epoch", Epoch, lambda _t, m, v=v: setattr(v, "epoch", m.epoch))
            hear(
                f"/{name}/tags/detections",
                TagDetections,
                lambda t, m, n=name: self._on_tags(t, n, m),
            )
        hear("/calibration_epochs", Epochs, self._on_calibrated)
        hear("/mission/alive", Heartbeat, lambda t, _m: control.mission.tell(t, self._phase))
        hear("/mission/state", MissionState, lambda _t, m: setattr(self, "_phase", m.phase_name))
        hear("/stop_all/report", StopReport, lambda t, _m: control.stop_all.tell(t, True))
        hear("/control/recorder/status", RecorderStatus, self._on_recorder)
        self._keys = RelayKeys(
            "control", "/relay", lambda told: self._hear(control.keys.tell, told)
        )

    def _hear(self, call, *what) -> None:
        with self._lock:
            call(time.monotonic(), *what)

    def _on_report(self, now_s: float, vehicle, message: FlightCheck) -> None:
        if message.vehicle != vehicle.name:
            self._health.drop(
                "flight check", f"on {vehicle.name}'s topic comes one of '{message.vehicle}'"
            )
            return
        vehicle.patience_s = messages.patience_s(message)
        vehicle.report.tell(now_s, messages.lines_of(message))

    def _on_tags(self, now_s: float, name: str, message: TagDetections) -> None:
        self._table.sightings.saw(now_s, name, [d.id for d in message.detections])

    def _on_calibrated(self, _now_s: float, message: Epochs) -> None:
        known = conversions.epochs_of(message)
        for name, vehicle in self._table.vehicles.items():
            vehicle.calibrated = known.get(name)

    def _on_recorder(self, now_s: float, message: RecorderStatus) -> None:
        self._table.control.recorder.tell(now_s, message)
        disk = disk_of(message, self._health)
        if disk is not None:
            self._table.control.disk.tell(now_s, disk)

    def _on_accept(self, request) -> AcceptLineResponse:
        with self._lock:
            refusal = self._accepted.accept(self._lines, request.vehicle, request.line)
        told = f"{request.vehicle} {request.line}: {refusal or 'accepted by the operator'}"
        rospy.logwarn("flight check: %s", told)
        self._step(None)
        return AcceptLineResponse(not refusal, told)

    def _step(self, _event) -> None:
        now_s = time.monotonic()
        with self._lock:
            self._lines = self._accepted.apply(now_s, self._table.lines(now_s))
            shown = [(li.vehicle, li.name, li.state, li.accepted) for li in self._lines]
            if shown == self._shown and now_s - self._shown_s < _NEXT_S - 0.1:
                return
            self._shown, self._shown_s = shown, now_s
            self._health.value("flight check", worst(self._lines).word)
            self._publisher.publish(messages.whole(self._lines, _NEXT_S))


def _age_s(message) -> float:
    """Gives the age of what this machine stamped by its own clock: a latched one may be old."""
    return max(0.0, rospy.get_time() - message.header.stamp.to_sec())


def main() -> int:
    """Run the node."""
    return node.run("fleet_check", FleetCheckNode)
