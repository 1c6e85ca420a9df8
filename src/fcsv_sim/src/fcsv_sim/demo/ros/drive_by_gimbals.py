# SPDX-License-Identifier: Apache-2.0
"""A robot that is guided by its gimbals while the vehicles of a demo follow it: the drive begins once
all stations are mapped and the vehicles follow, and ends the mission."""

import time
from typing import Callable, Optional, Tuple

import numpy as np
import rospy

from fcsv_control.mission.activities.stages import FOLLOWS
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Home, MapState
from fcsv_sim.demo.fleet import FleetPlan
from fcsv_sim.demo.ros.drive_along import DriveAlong
from fcsv_sim.machines.machines import Machine
from fcsv_sim.robot.gimbals.survey import T_world_level
from fcsv_sim.robot.placed import place_of
from fcsv_sim.world.town import Town

_MAPPED_S = 8.0  # so long the live map is ready: no station is left


class DriveByGimbals(DriveAlong):
    """Home is the one that the gimbals set while the robot stood at its start."""

    def __init__(self, plan: FleetPlan, machine: Machine, say: Callable[[str], None]):
        self._T_ground_home: Optional[np.ndarray] = None
        self._said: Tuple[str, str] = ("", "")
        self._said_s = 0.0
        super().__init__(plan, machine, say)
        self._T_world_ground = T_world_level(place_of(Town.generate(plan.seed, plan.world)))
        rospy.Subscriber("/home", Home, self._on_home)

    def _on_home(self, message: Home) -> None:
        T_ground_home = conversions.pose_to_transform(message.home_in_odom)
        with self._lock:
            self._T_ground_home = T_ground_home

    def _on_map(self, message: MapState) -> None:
        super()._on_map(message)
        with self._lock:
            if (message.state, message.detail) != self._said:
                self._said, self._said_s = (message.state, message.detail), time.monotonic()

    def _ready(self) -> Optional[np.ndarray]:
        with self._lock:
            mission, (mapped, _), since_s = self._mission, self._said, self._said_s
            T_ground_home = self._T_ground_home
        if mission is None or mission.stage != FOLLOWS or T_ground_home is None:
            return None
        if mapped != "ready" or time.monotonic() - since_s < _MAPPED_S:
            return None
        return self._T_world_ground @ T_ground_home
