# SPDX-License-Identifier: Apache-2.0
"""The operators of a simulated flight: they look at the vehicles and at the screen, move sticks and press buttons."""

import time
from typing import Dict

import rospy
from std_srvs.srv import Trigger

from fcsv_control.mission.config import load_mission
from fcsv_geometry.errors import PoseUnavailable
from fcsv_msgs.msg import MissionState, State
from fcsv_sim.operator import ButtonPresser, Field, Pilot, Sight
from fcsv_sim.rc import RcSender
from fcsv_sim.truth import TruthReader


class OperatorNode:
    """Sends 50 RC frames a second to every vehicle."""

    def __init__(self):
        self._names = list(rospy.get_param("~vehicles"))
        ports = rospy.get_param("~rc_ports")
        mission = load_mission(rospy.get_param("~mission"))
        field = Field(home_height_m=mission.home_height_m, spacing_m=mission.column_spacing_m)
        seed = rospy.get_param("~seed", 1)
        self._pilots = [Pilot(i, field, seed) for i in range(len(self._names))]
        self._presser = ButtonPresser(field)
        self._radios = [RcSender(int(p)) for p in ports]
        self._truth = {n: TruthReader(rospy.get_param("~sim_dir"), n) for n in self._names}
        self._states: Dict[str, State] = {n: State() for n in self._names}
        self._mission = MissionState(phase_name="WAIT_VEHICLES")
        self._proceed = rospy.ServiceProxy("/mission/proceed", Trigger)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)
        for name in self._names:
            rospy.Subscriber(f"/{name}/mavros/state", State, self._on_state, name, queue_size=2)

    def _on_mission(self, message: MissionState) -> None:
        self._mission = message

    def _on_state(self, message: State, name: str) -> None:
        self._states[name] = message

    def spin(self) -> None:
        """Look, move the sticks, press, until ROS ends."""
        while not rospy.is_shutdown():
            time.sleep(0.02)
            try:
                sights = {n: self._sight(n) for n in self._names}
            except PoseUnavailable:
                continue  # not on the field yet
            now_s = time.time()
            phase = self._mission.phase_name
            for pilot, radio, sight in zip(self._pilots, self._radios, sights.values()):
                s = pilot.sticks(now_s, phase, sight)
                radio.send(s.roll, s.pitch, s.throttle, s.yaw, s.mode)
            if self._presser.press(now_s, self._mission.waits_for, phase, sights, self._pilots):
                self._press()

    def _sight(self, name: str) -> Sight:
        reader, state = self._truth[name], self._states[name]
        return Sight(reader.latest()[1], reader.velocity(), state.armed, state.mode)

    def _press(self) -> None:
        try:
            answer = self._proceed()
            rospy.loginfo("operator: proceed (%s)", answer.message or "taken")
        except rospy.ServiceException as error:
            rospy.logwarn("operator: %s", error)


def main() -> None:
    """Run the node."""
    rospy.init_node("operator")
    OperatorNode().spin()
