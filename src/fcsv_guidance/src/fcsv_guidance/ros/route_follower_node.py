# SPDX-License-Identifier: Apache-2.0
"""Drives a robot that takes cmd_vel along the path of ground_map; for every doubt it stands."""

import threading
from dataclasses import dataclass, field
from typing import Optional

import numpy as np
import rospy
from geometry_msgs.msg import Twist
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import String

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health, without_numbers
from fcsv_guidance.grid import Grid
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.robot import load_robot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_guidance.ros.place_source import PlaceParameters
from fcsv_guidance.ros.route_source import RouteSource
from fcsv_guidance.route.following import FollowerRules, RouteFollower
from fcsv_guidance.route.grid_regions import clearance_map, with_region

_PERIOD_S = 0.05


@dataclass(frozen=True)
class FollowerParameters:
    """Parameters of the node."""

    robot: str  # its file, config/robots/NAME.yaml
    rules: FollowerRules = field(default_factory=FollowerRules)
    place: PlaceParameters = field(default_factory=PlaceParameters)


class RouteFollowerNode:
    """path, stand, hold, place/hold, robot_pose -> cmd_vel at 20 Hz, zero where the robot shall
    stand."""

    def __init__(self):
        p = node.parameters(FollowerParameters)
        self._port = RouteFollower(load_robot(p.robot), p.rules)
        self._lock, self._health = threading.RLock(), Health("route_follower", {"robot_pose": 1.0})
        self._grid: Optional[Grid] = None
        self._stands: Optional[np.ndarray] = None
        self._last = ""
        self._cmd_vel = rospy.Publisher("cmd_vel", Twist, queue_size=1, tcp_nodelay=True)
        self._status = rospy.Publisher("follower/status", String, queue_size=1, latch=True)
        rospy.on_shutdown(lambda: self._cmd_vel.publish(Twist()))
        self._timer = node.every(_PERIOD_S, lambda _event: self._step())
        rospy.Subscriber("stand", OccupancyGrid, self._on_grid, queue_size=1, buff_size=1 << 24)
        rospy.Subscriber(
            "stand_updates", OccupancyGridUpdate, self._on_update, queue_size=10, buff_size=1 << 24
        )
        self._source = RouteSource(p.place, self._receive, self._health)

    def _on_grid(self, message: OccupancyGrid) -> None:
        try:
            grid, stands = messages.grid_of(message)
        except FcsvError as error:
            self._health.drop("stand", str(error))
            return
        self._set_grid(messages.seen_s(message), grid, stands)

    def _on_update(self, message: OccupancyGridUpdate) -> None:
        try:
            with self._lock:
                if self._stands is None:
                    return  # the whole grid comes to who begins to listen
                stands = with_region(self._stands, messages.region_of(message))
                self._set_grid(messages.seen_s(message), self._grid, stands)
        except FcsvError as error:
            self._health.drop("stand_updates", str(error))

    def _set_grid(self, stamp_s: float, grid: Grid, stands: np.ndarray) -> None:
        with self._lock:
            self._grid, self._stands = grid, stands
            self._receive(clearance_map(stamp_s, grid, stands))

    def _receive(self, message: object) -> None:
        with self._lock:
            self._port.receive(rospy.get_time(), message)

    def _step(self) -> None:
        with self._lock:
            (command,) = self._port.step(rospy.get_time())
        self._cmd_vel.publish(messages.twist_of(command))
        self._say(command)

    def _say(self, command: DriveCommand) -> None:
        text = command.reason or "the robot drives"
        self._health.value("follower", text)
        if without_numbers(text) != self._last:  # ages count up
            self._last = without_numbers(text)
            rospy.loginfo("route_follower: %s", text)
            self._status.publish(String(text))


def main() -> int:
    """Run the node."""
    return node.run("route_follower", RouteFollowerNode)
