# SPDX-License-Identifier: Apache-2.0
"""The control PC's services /calibrate and /set_home, and what they find as latched topics."""

import threading
import time
from dataclasses import dataclass, field, replace
from typing import Any, List, Optional, Sequence, Tuple

import rospy

from fcsv_geometry import frames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.ros.telemetry_messages import epochs_message, home_message, phase_of, subscribe
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_msgs.msg import Calibration, ClockOffset, Epochs, Home, MissionState
from fcsv_msgs.srv import (
    Calibrate,
    CalibrateInFlight,
    CalibrateInFlightResponse,
    CalibrateResponse,
    SetHome,
    SetHomeResponse,
)
from fcsv_tracking.column.calibration import CalibrationRules
from fcsv_tracking.column.calibration_port import CalibrateColumn, CalibrationPort, HomeWanted
from fcsv_tracking.devices.clocks import VehicleClock
from fcsv_tracking.ros import clock_node, link_messages

_STEP_S = 0.1


@dataclass(frozen=True)
class CalibrationParameters:
    """Parameters of the node; the vehicles are a column, front first.

    ``tracker_profile``: config/trackers/NAME.yaml, in place of ``rules.tracker``.
    """

    vehicles: List[str]
    vehicles_dir: str
    rules: CalibrationRules = field(default_factory=CalibrationRules)
    tracker_profile: str = ""


class CalibrationNode:
    """A call to /calibrate or /calibrate_in_flight waits until its port has collected enough."""

    def __init__(self):
        parameters = node.parameters(CalibrationParameters)
        names, rules = parameters.vehicles, parameters.rules
        if parameters.tracker_profile:
            rules = replace(rules, tracker=load_profile(parameters.tracker_profile))
        found = node.vehicles(parameters.vehicles_dir, names)
        self._port = CalibrationPort({n: found[n] for n in names}, rules)
        self._changed = threading.Condition()
        self._ended: Optional[Tuple[tm.Reply, Calibration]] = None  # of the calibration that runs
        self._health = Health("control")
        latched = lambda topic, kind: rospy.Publisher(topic, kind, queue_size=1, latch=True)  # noqa: E731
        self._calibration, self._home = latched("/calibration", Calibration), latched("/home", Home)
        self._epochs = {of: latched(f"/{of}_epochs", Epochs) for of in (tm.CALIBRATION, tm.HOME)}
        rospy.Service("/calibrate", Calibrate, self._on_calibrate)
        rospy.Service("/calibrate_in_flight", CalibrateInFlight, self._on_calibrate_in_flight)
        rospy.Service("/set_home", SetHome, self._on_set_home)
        take = lambda m: self._receive(phase_of(m))  # noqa: E731
        rospy.Subscriber("/mission/state", MissionState, take, queue_size=1)
        for name in names:
            subscribe(
                name,
                (tm.VehicleOdometry, tm.OdometryEpoch, tm.SeenTags),
                self._receive,
                self._health,
            )
            rospy.Subscriber(
                f"/{name}/clock/offset", ClockOffset, self._on_clock, name, queue_size=1
            )
        self._timer = node.every(_STEP_S, lambda _event: self._step())

    def _receive(self, message: object) -> None:
        with self._changed:
            self._port.receive(time.monotonic(), message)

    def _on_clock(self, message: ClockOffset, name: str) -> None:
        self._receive(VehicleClock(name, clock_node.from_message(message)))

    def _step(self) -> None:
        with self._changed:
            told, reply = self._publish_all(self._port.step(time.monotonic()))
            if reply is not None:
                self._ended = reply, told or Calibration()
                self._changed.notify_all()

    def _on_calibrate(self, request) -> CalibrateResponse:
        reply, found = self._calibrate(CalibrateColumn(request.column, request.duration_s))
        return CalibrateResponse(reply.done, reply.text, found)

    def _on_calibrate_in_flight(self, request) -> CalibrateInFlightResponse:
        reply, _ = self._calibrate(CalibrateColumn(request.column, in_flight=True))
        return CalibrateInFlightResponse(reply.done, reply.drifted, reply.text)

    def _calibrate(self, wanted: CalibrateColumn) -> Tuple[tm.Reply, Calibration]:
        """The answer once it is over, and what was found."""
        with self._changed:
            _, reply = self._publish_all(self._port.serve(time.monotonic(), wanted))
            if reply is not None:
                return reply, Calibration()
            self._ended = None
            while self._ended is None:
                if rospy.is_shutdown():
                    return tm.Reply(False, "the calibration node ends"), Calibration()
                self._changed.wait(0.5)
            return self._ended

    def _on_set_home(self, request) -> SetHomeResponse:
        with self._changed:
            told, reply = self._publish_all(
                self._port.serve(time.monotonic(), HomeWanted(request.reference))
            )
        return SetHomeResponse(reply.done, reply.text, told or Home())

    def _publish_all(self, outputs: Sequence[object]) -> Tuple[Any, Optional[tm.Reply]]:
        """Publish them; the calibration or home among them, and the reply."""
        message, reply = None, None
        for output in outputs:
            if isinstance(output, tm.CalibrationFound):
                header = conversions.header(output.stamp_s, frames.odom(output.links[0].parent))
                message = Calibration(
                    header, [link_messages.to_message(link) for link in output.links]
                )
                self._calibration.publish(message)
            elif isinstance(output, tm.HomeFound):
                message = home_message(output)
                self._home.publish(message)
            elif isinstance(output, tm.EpochsFound):
                self._epochs[output.of].publish(epochs_message(output))
            elif isinstance(output, tm.Dropped):
                self._health.drop(output.what, output.why)
            else:
                reply = output
        return message, reply


def main() -> int:
    """Run the node."""
    return node.run("calibration", CalibrationNode)
