# SPDX-License-Identifier: Apache-2.0
"""What the demo sees of a running mission: the control PC's topics, as lines for a person."""

import os
import threading
import time
from typing import Callable, Dict, Iterable, Optional

import rospy
from geometry_msgs.msg import PoseStamped
from std_srvs.srv import Trigger

from fcsv_control.ros.checks.flight_check_messages import lines_of
from fcsv_geometry.ros import node
from fcsv_msgs.msg import Capture, FlightCheck, MapState, MissionState, RecorderStatus
from fcsv_sim.demo.maps_in_flight import MapsInFlight
from fcsv_sim.demo.movement import Movement
from fcsv_sim.demo.start_up import StartUp
from fcsv_sim.machines.machines import Machine
from mavros_msgs.msg import State, StatusText


def attach(control: Machine) -> None:
    """Make this process a node on a machine's master (once: rospy knows one master a process)."""
    os.environ.update({k: v for k, v in control.env.items() if k.startswith("ROS_")})
    node.begin("demo", anonymous=True, disable_signals=True)


class MissionWatch:
    """Follows one mission on the control PC's master; ``say`` is called with each new line, by one
    thread at once."""

    def __init__(self, control: Machine, vehicles: Iterable[str], say: Callable[[str], None]):
        attach(control)
        self._tell, self._telling = say, threading.Lock()
        self._lock = threading.Lock()
        self._line = ""
        self.maps = MapsInFlight()
        self.start_up = StartUp(time.monotonic())
        self.phase: Optional[int] = None
        self.captures = 0
        self.moved_m: Dict[str, float] = dict.fromkeys(vehicles, 0.0)
        self.states: Dict[str, State] = {}
        self.recorders: Dict[str, RecorderStatus] = {}
        self._movements: Dict[str, Movement] = {v: Movement() for v in self.moved_m}
        self._armed_at: Optional[float] = None
        self.flown_s = 0.0
        self._abort = rospy.ServiceProxy("/mission/abort", Trigger)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission)
        rospy.Subscriber("/mission/capture", Capture, self._on_capture)
        rospy.Subscriber("/flight_check", FlightCheck, lambda m: self.start_up.check(lines_of(m)))
        rospy.Subscriber("/map/state", MapState, self._on_map)
        for vehicle in vehicles:
            rospy.Subscriber(f"/{vehicle}/mavros/state", State, self._on_state, vehicle)
            rospy.Subscriber(
                f"/{vehicle}/mavros/statustext/recv", StatusText, self._on_text, vehicle
            )
            rospy.Subscriber(
                f"/{vehicle}/mavros/local_position/pose", PoseStamped, self._on_pose, vehicle
            )
            rospy.Subscriber(
                f"/{vehicle}/recorder/status", RecorderStatus, self._on_recorder, vehicle
            )

    @property
    def starting(self) -> bool:
        """Whether the mission still waits for vehicles that are not ready."""
        return self.phase in (None, MissionState.WAIT_VEHICLES)

    @property
    def over(self) -> bool:
        return self.phase in (MissionState.DONE, MissionState.ABORTED)

    @property
    def aborted(self) -> bool:
        return self.phase == MissionState.ABORTED

    @property
    def landed(self) -> bool:
        """Every vehicle that was heard of is disarmed."""
        return not any(state.armed for state in self.states.values())

    def abort(self) -> bool:
        """Ask the mission to land everybody; False where it does not answer."""
        try:
            rospy.wait_for_service(self._abort.resolved_name, timeout=2.0)
            return self._abort().success
        except (rospy.ROSException, rospy.ServiceException):
            return False

    def vehicles_line(self) -> str:
        """One line with every vehicle's mode, height and pictures."""
        words = []
        for vehicle, state in sorted(self.states.items()):
            place = self._movements[vehicle].place_m
            height = "height not known" if place is None else f"{place[2]:.1f} m"
            pictures = getattr(self.recorders.get(vehicle), "pictures", 0)
            armed = "" if state.armed else " disarmed"
            words.append(f"{vehicle} {state.mode}{armed}, {height}, {pictures} pictures")
        return " | ".join(words)

    def _say(self, line: str) -> None:
        """Topics come in threads of their own, and print writes a line's end by itself."""
        with self._telling:
            self._tell(line)

    def _on_mission(self, message: MissionState) -> None:
        self.phase = message.phase
        if self.starting:
            self.start_up.problems(message.problems)
            return
        if message.phase == MissionState.CONFIGURATIONS:
            self.maps.begin(time.monotonic())
        step = (
            f" {message.configuration + 1}/{message.configurations}"
            if message.phase_name == "CONFIGURATIONS"
            else ""
        )
        problems = f"  !! {'; '.join(message.problems)}" if message.problems else ""
        line = f"{message.phase_name}{step}: {message.detail}{problems}"
        with self._lock:
            if line == self._line:
                return
            self._line = line
        self._say(line)

    def _on_capture(self, message: Capture) -> None:
        self.captures += 1
        self._say(
            f"captured {message.configuration.name}: set-point held within {message.position_error_m:.2f} m"
        )

    def _on_map(self, message: MapState) -> None:
        line = self.maps.on_map_state(message, time.monotonic())
        if line is not None:
            self._say(line)

    def _on_state(self, message: State, vehicle: str) -> None:
        self.states[vehicle] = message
        flying = any(state.armed for state in self.states.values())
        now = time.monotonic()
        if flying and self._armed_at is None:
            self._armed_at = now
        elif not flying and self._armed_at is not None:
            self.flown_s, self._armed_at = self.flown_s + now - self._armed_at, None

    def _on_pose(self, message: PoseStamped, vehicle: str) -> None:
        """Distance moved while configurations are flown: what the thesis counts as movement."""
        p = message.pose.position
        step_m = self._movements[vehicle].add((p.x, p.y, p.z))
        if self.phase == MissionState.CONFIGURATIONS:
            self.moved_m[vehicle] += step_m

    def _on_recorder(self, message: RecorderStatus, vehicle: str) -> None:
        self.recorders[vehicle] = message

    def _on_text(self, message: StatusText, vehicle: str) -> None:
        if message.severity > StatusText.WARNING:
            return
        if self.starting:
            self.start_up.text(vehicle, message.text)
        else:
            self._say(f"{vehicle}: {message.text}")
