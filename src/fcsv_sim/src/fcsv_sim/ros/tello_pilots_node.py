# SPDX-License-Identifier: Apache-2.0
"""The people of a simulated flight of Tellos: they look at their screens, move sticks and press
buttons.

Sticks go to ``pilot/joy``, orders to the flight link's services, as a person's would; no truth is
read.
"""

import threading
import time
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Joy

from fcsv_control.tello.pid import PidConfig
from fcsv_geometry import config
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import LinkHealth, MissionState
from fcsv_msgs.srv import Proceed
from fcsv_sim.people.tello_hands import LAND, TAKE_OFF, Act, Finger, Screen, TelloHands
from fcsv_sim.ros.amber import accept_amber
from mavros_msgs.msg import State
from mavros_msgs.srv import CommandTOL, SetMode


@dataclass(frozen=True)
class TelloPilotsParameters:
    """Parameters of the node. ``gains``: config/tello/NAME.yaml, by which the hands move the sticks.
    ``heading_deg``: how vehicles line up, in the tracker's frame."""

    vehicles: List[str]
    mission: str
    gains: str
    sway_m: float = 0.35
    heading_deg: float = 0.0
    rate_hz: float = 20.0
    # lines of the flight check that the operator accepts where they are amber: what a busy computer
    # makes amber, and gimbals, whose poses come with gaps
    accepts: Tuple[str, ...] = ("disk", "recorder", "camera", "feed")

    def __post_init__(self):
        if not self.vehicles:
            raise ValueError("vehicles: name them")
        if not 0.0 <= self.sway_m <= 1.0:
            raise ValueError(f"sway_m: {self.sway_m} is not in 0..1")
        if not 5.0 <= self.rate_hz <= 50.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 5..50")


class TelloPilotsNode:
    """One pair of hands for each vehicle, one finger at the mission's button."""

    def __init__(self):
        p = self._parameters = node.parameters(TelloPilotsParameters)
        gains, height_m = config.load(p.gains, PidConfig), load_mission(p.mission).home_height_m
        heading_rad = float(np.radians(p.heading_deg))
        self._hands = {n: TelloHands(gains, height_m, p.sway_m, heading_rad) for n in p.vehicles}
        self._screens: Dict[str, Screen] = {n: Screen() for n in p.vehicles}
        self._finger, self._mission, self._lock = Finger(), MissionState(), threading.Lock()
        self._health = Health("pilots", {"sticks": p.rate_hz / 3.0})
        self._sticks = {
            n: rospy.Publisher(f"/{n}/pilot/joy", Joy, queue_size=1, tcp_nodelay=True)
            for n in p.vehicles
        }
        self._take_off = {
            n: rospy.ServiceProxy(f"/{n}/mavros/cmd/takeoff", CommandTOL) for n in p.vehicles
        }
        self._mode = {n: rospy.ServiceProxy(f"/{n}/mavros/set_mode", SetMode) for n in p.vehicles}
        self._proceed, self._height_m = rospy.ServiceProxy("/mission/proceed", Proceed), height_m
        accept_amber(p.accepts)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)
        for n in p.vehicles:
            rospy.Subscriber(f"/{n}/mavros/state", State, self._on_state, n, queue_size=2)
            rospy.Subscriber(
                f"/{n}/mavros/local_position/pose", PoseStamped, self._on_pose, n, queue_size=1
            )
            rospy.Subscriber(f"/{n}/tello/odom", Odometry, self._on_odometry, n, queue_size=1)
            rospy.Subscriber(
                f"/{n}/flight_link/health", LinkHealth, self._on_health, n, queue_size=1
            )

    def _on_mission(self, message: MissionState) -> None:
        self._mission = message

    def _on_state(self, m: State, name: str) -> None:
        self._update(name, armed=m.armed, mode=Mode(m.mode))

    def _on_odometry(self, m: Odometry, name: str) -> None:
        v = m.twist.twist.linear
        self._update(name, v_body_mps=np.array([v.x, v.y, v.z]))

    def _on_health(self, m: LinkHealth, name: str) -> None:
        self._update(name, feed_hz=m.feed_rate_hz)

    def _on_pose(self, m: PoseStamped, name: str) -> None:
        try:
            self._update(name, T_odom_body=conversions.pose_to_transform(m.pose))
        except GeometryError as error:
            self._health.drop("pose", f"{name}: {error}")

    def _update(self, name: str, **what) -> None:
        with self._lock:
            self._screens[name] = replace(self._screens[name], **what)

    def spin(self) -> None:
        """Look, move the sticks, press, until ROS ends."""
        while not rospy.is_shutdown():
            time.sleep(1.0 / self._parameters.rate_hz)
            now_s, mission = time.monotonic(), self._mission
            with self._lock:
                screens = dict(self._screens)
            for name, hands in self._hands.items():
                self._do(name, hands.act(now_s, mission.phase_name, screens[name]))
            self._health.tick("sticks")
            button = mission.waits_for
            if self._finger.press(now_s, button, screens):
                self._aside(button, lambda button=button: self._proceed(button))

    def _do(self, name: str, act: Act) -> None:
        s = act.sticks
        self._sticks[name].publish(
            Joy(
                header=conversions.header(rospy.get_time(), ""),
                axes=[s.turn, s.up, s.left, s.forward],
            )
        )
        if act.order == TAKE_OFF:
            self._aside(f"{name}: take-off", lambda: self._take_off[name](altitude=self._height_m))
        elif act.order == LAND:
            self._aside(f"{name}: LAND", lambda: self._mode[name](custom_mode=Mode.LAND))

    @staticmethod
    def _aside(what: str, call: Callable) -> None:
        """A service may take its time; the hands stay on the sticks."""

        def work() -> None:
            try:
                rospy.loginfo("%s: %s", what, str(call()).replace("\n", ", "))
            except rospy.ServiceException as error:
                rospy.logwarn("%s: %s", what, error)

        threading.Thread(target=work, name=what, daemon=True).start()


def main() -> int:
    """Run the node."""
    return node.run("tello_pilots", TelloPilotsNode)
