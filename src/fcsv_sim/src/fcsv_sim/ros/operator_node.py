# SPDX-License-Identifier: Apache-2.0
"""The operators of a simulated flight: they look at the vehicles and at the screen, move sticks and
press buttons."""

import threading
import time
from dataclasses import dataclass
from typing import Dict, List, Tuple

import rospy

from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import MissionState
from fcsv_msgs.srv import Proceed
from fcsv_sim.people.operator import ButtonPresser, Field, Pilot, PilotSight
from fcsv_sim.people.rc import RcSender
from fcsv_sim.ros.amber import accept_amber
from fcsv_sim.truth import TruthReader
from mavros_msgs.msg import State


@dataclass(frozen=True)
class OperatorParameters:
    """Parameters of the node; ``rc_ports`` are the vehicles' receivers, in the order of
    ``vehicles``."""

    vehicles: List[str]
    rc_ports: List[int]
    mission: str
    sim_dir: str
    vehicles_dir: str = ""  # not looked at: people see the vehicles
    seed: int = 1
    rate_hz: float = 50.0
    start_xy_m: Tuple[float, float] = (0.0, 0.0)  # of the column's first vehicle, in the world
    buttons: bool = True  # it presses and accepts; else somebody does in the window
    # lines of the flight check that this operator accepts where they are amber, and says so: what a
    # small or busy computer lacks, a simulated vehicle flies without
    accepts: Tuple[str, ...] = ("disk", "recorder", "camera")

    def __post_init__(self):
        if len(self.rc_ports) != len(self.vehicles) or not self.vehicles:
            raise ValueError(
                f"rc_ports: {len(self.rc_ports)} for {len(self.vehicles)} vehicles; give one for each"
            )
        if not 5.0 <= self.rate_hz <= 400.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 5..400")


class OperatorNode:
    """Sends RC frames to every vehicle at ``rate_hz``."""

    def __init__(self):
        p = self._parameters = node.parameters(OperatorParameters)
        mission = load_mission(p.mission)
        x, y = p.start_xy_m
        start_xy_m = (x + Field.start_xy_m[0], y + Field.start_xy_m[1])
        field = Field(
            (x, y),
            start_xy_m=start_xy_m,
            home_height_m=mission.home_height_m,
            spacing_m=mission.column_spacing_m,
        )
        self._pilots = [Pilot(i, field, p.seed) for i in range(len(p.vehicles))]
        self._presser = ButtonPresser()
        self._radios = [RcSender(port) for port in p.rc_ports]
        self._truth = {n: TruthReader(p.sim_dir, n) for n in p.vehicles}
        self._states: Dict[str, State] = {n: State() for n in p.vehicles}
        self._mission = MissionState(phase_name="WAIT_VEHICLES")
        self._health = Health("operator", {"sticks": p.rate_hz / 3.0})
        self._proceed = rospy.ServiceProxy("/mission/proceed", Proceed)
        if p.buttons:
            accept_amber(p.accepts)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)
        for name in p.vehicles:
            rospy.Subscriber(f"/{name}/mavros/state", State, self._on_state, name, queue_size=2)

    def _on_mission(self, message: MissionState) -> None:
        self._mission = message

    def _on_state(self, message: State, name: str) -> None:
        self._states[name] = message

    def spin(self) -> None:
        """Look, move the sticks, press, until ROS ends."""
        while not rospy.is_shutdown():
            time.sleep(1.0 / self._parameters.rate_hz)
            try:
                sights = {n: self._sight(n) for n in self._parameters.vehicles}
            except PoseUnavailable as error:
                self._health.problem("field", f"not on the field yet: {error}")
                continue
            self._health.problem("field", "")
            self._health.tick("sticks")
            self._act(rospy.get_time(), self._mission, sights)

    def _act(self, now_s: float, mission: MissionState, sights: Dict[str, PilotSight]) -> None:
        phase = mission.phase_name
        for pilot, radio, sight in zip(self._pilots, self._radios, sights.values()):
            s = pilot.sticks(now_s, phase, sight)
            radio.send(s.roll, s.pitch, s.throttle, s.yaw, s.mode)
        if self._parameters.buttons and self._presser.press(
            now_s, mission.waits_for, phase, sights, self._pilots
        ):
            # a service may take its time; the hands stay on the sticks
            threading.Thread(
                target=self._press, args=(mission.waits_for,), name="finger", daemon=True
            ).start()

    def _sight(self, name: str) -> PilotSight:
        reader, state = self._truth[name], self._states[name]
        return PilotSight(reader.latest()[1], reader.velocity(), state.armed, Mode(state.mode))

    def _press(self, button: str) -> None:
        try:
            answer = self._proceed(button)
            rospy.loginfo("operator: %s (%s)", button, answer.message or "taken")
        except rospy.ServiceException as error:
            rospy.logwarn("operator: %s: %s", button, error)


def main() -> int:
    """Run the node."""
    return node.run("operator", OperatorNode)
