# SPDX-License-Identifier: Apache-2.0
"""Hands on the sticks of a pair of Tellos: by sight until the tracker knows where they are, then by its poses."""

import time
from typing import Dict, NamedTuple, Optional

import numpy as np
import rospy
from geometry_msgs.msg import Twist, Vector3
from std_msgs.msg import Empty

from fcsv_control.mission.places import body_set_point
from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import node
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_sim.demo.ros.pair_cameras import PairCamera
from fcsv_sim.people.tello_pilot import Hand, sticks_to
from fcsv_sim.truth import TruthReader
from mavros_msgs.msg import State

_RATE_HZ = 15.0
_REACTION_S = 0.3  # a pilot acts on what he saw a moment ago
_SWAY_PERIOD_S = 8.0


class Goal(NamedTuple):
    """T_world_body as a pilot by the side has it in mind, or T_home_cam."""

    by_sight: bool
    T: np.ndarray


class PairPilots:
    """Sticks are given until another goal is; without one the vehicle is left alone.

    The pilots' eyes are the only thing here that knows the truth: before home is set, and to hold a vehicle that the
    tracker has lost, which would drift away. No pose and no set-point comes from them.
    """

    def __init__(self, sim_dir, vehicles: Dict[str, VehicleGeometry], cameras: Dict[str, PairCamera], sway_m: float):
        self._vehicles, self._cameras, self._sway_m = vehicles, cameras, sway_m
        self._eyes = {n: TruthReader(sim_dir, n) for n in vehicles}
        self._goals: Dict[str, Optional[Goal]] = dict.fromkeys(vehicles)
        self._hands_on = {n: Hand() for n in vehicles}
        self._held: Dict[str, np.ndarray] = {}  # where a vehicle was when the tracker lost it
        self.states: Dict[str, State] = {}
        self._sticks = {n: rospy.Publisher(f"/{n}/tello/cmd_vel", Twist, queue_size=1) for n in vehicles}
        self._orders = {(n, what): rospy.Publisher(f"/{n}/tello/{what}", Empty, queue_size=1)
                        for n in vehicles for what in ("takeoff", "land")}  # fmt: skip
        for n in vehicles:
            rospy.Subscriber(f"/{n}/tello/state", State, self._on_state, n, queue_size=2)
        self._timer = node.every(1.0 / _RATE_HZ, self._fly)

    def _on_state(self, message: State, name: str) -> None:
        self.states[name] = message

    @property
    def all_there(self) -> bool:
        return len(self.states) == len(self._vehicles)

    @property
    def all_landed(self) -> bool:
        return not any(state.armed for state in self.states.values())

    def order(self, what: str) -> None:
        """To both, ``takeoff`` or ``land``; may be said again."""
        if what == "land":
            self._goals = dict.fromkeys(self._vehicles)
        for n in self._vehicles:
            self._orders[n, what].publish(Empty())

    def by_sight(self, name: str, T_world_body: np.ndarray) -> None:
        self._goals[name] = Goal(True, T_world_body)

    def by_tracker(self, name: str, T_home_cam: np.ndarray) -> None:
        self._goals[name] = Goal(False, T_home_cam)

    def seen_away_m(self, name: str) -> float:
        """How far a vehicle is from its goal by sight (m), to a pilot's eye; infinite where it cannot be seen."""
        goal = self._goals[name]
        try:
            return float(np.linalg.norm(self._eyes[name].latest()[1][:3, 3] - goal.T[:3, 3]))
        except PoseUnavailable:
            return np.inf

    def _fly(self, _event) -> None:
        for name, goal in list(self._goals.items()):
            if goal is None:
                continue
            try:
                v, turn = self._hands(name, goal)
            except PoseUnavailable:
                v, turn = np.zeros(3), 0.0
            self._sticks[name].publish(Twist(Vector3(*v), Vector3(0.0, 0.0, turn)))

    def _hands(self, name: str, goal: Goal):
        now_s = time.time()
        if goal.by_sight:
            return sticks_to(self._eyes[name].at(now_s - _REACTION_S), goal.T)
        if not self._cameras[name].known(now_s):
            return self._hold(name, now_s)
        self._held.pop(name, None)
        T_body_cam = self._vehicles[name].T_body_cam
        target = body_set_point(goal.T, np.eye(4), T_body_cam)
        T_home_cam = self._cameras[name].latest()[1]
        return self._hands_on[name].sticks(1.0 / _RATE_HZ, T_home_cam @ transforms.invert(T_body_cam), target)

    def _hold(self, name: str, now_s: float):
        """Where it was lost, swaying about there where that helps the tracker."""
        seen = self._eyes[name].at(now_s - _REACTION_S)
        aside_m = self._sway_m * np.sin(2.0 * np.pi * now_s / _SWAY_PERIOD_S)
        T_held = self._held.setdefault(name, seen)
        return sticks_to(seen, transforms.transform(T_held[:3, :3], T_held[:3, 3] + [0.0, aside_m, 0.0]))
