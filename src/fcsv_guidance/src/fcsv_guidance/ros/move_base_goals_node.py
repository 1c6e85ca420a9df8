# SPDX-License-Identifier: Apache-2.0
"""Gives a robot that has its own move_base the goals along the path of ground_map, as a client of
its action."""

import threading
from dataclasses import dataclass, field
from functools import partial

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from map_msgs.msg import OccupancyGridUpdate
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import String

from fcsv_geometry import frames, transforms
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_guidance.messages import GroundDated, HoldRobot, StopRobot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_guidance.ros.place_source import PlaceParameters
from fcsv_guidance.ros.route_source import RouteSource
from fcsv_guidance.route.goal_giver import CancelGoal, GiveGoal, GivingRules, GoalEnded, GoalGiver

_PERIOD_S = 0.1
_GONE = (GoalStatus.PREEMPTED, GoalStatus.RECALLED)  # by a goal of ours, or by a cancel


@dataclass(frozen=True)
class GoalsParameters:
    """Parameters of the node."""

    action: str = "/move_base"  # of the robot's own
    rules: GivingRules = field(default_factory=GivingRules)
    place: PlaceParameters = field(default_factory=PlaceParameters)

    def __post_init__(self):
        if not self.action.strip("/ "):
            raise ValueError("action: is empty; name the robot's own move_base, as /move_base")


class MoveBaseGoalsNode:
    """path, map, hold, place/hold, robot_pose -> the action move_base."""

    def __init__(self):
        p = node.parameters(GoalsParameters)
        self._port = GoalGiver(p.rules)
        self._lock, self._health = threading.RLock(), Health("move_base_goals", {"robot_pose": 1.0})
        self._said, self._met = "", False
        self._client = actionlib.SimpleActionClient(p.action, MoveBaseAction)
        self._status = rospy.Publisher("goals/status", String, queue_size=1, latch=True)
        rospy.on_shutdown(self._client.cancel_all_goals)
        self._timer = node.every(_PERIOD_S, lambda _event: self._step())
        for topic, type_ in (("map", OccupancyGrid), ("map_updates", OccupancyGridUpdate)):
            rospy.Subscriber(
                topic,
                type_,
                lambda m: self._receive(GroundDated(messages.seen_s(m))),
                queue_size=10,
                buff_size=1 << 24,
            )
        self._source = RouteSource(p.place, self._receive, self._health)

    def _receive(self, message: object) -> None:
        with self._lock:
            self._port.receive(rospy.get_time(), message)
            if isinstance(message, (StopRobot, HoldRobot)):
                self._step()

    def _step(self) -> None:
        with self._lock:
            connected = self._client.wait_for_server(rospy.Duration(0.001))
            self._health.problem(
                "move_base", "" if connected else "no move_base answers; start the robot's"
            )
            if connected:
                if not self._met:  # goals that one of us gave who has died
                    self._met = True
                    self._client.cancel_all_goals()
                for output in self._port.step(rospy.get_time()):
                    self._send(output)
            text = self._port.text if connected else "no move_base answers"
        if text != self._said:
            self._said = text
            rospy.loginfo("move_base_goals: %s", text)
            self._status.publish(String(text))

    def _send(self, output: object) -> None:
        if isinstance(output, GiveGoal):
            T_home_goal = transforms.from_xyz_yaw([output.x_m, output.y_m, 0.0], output.yaw_rad)
            pose: PoseStamped = conversions.pose_stamped(T_home_goal, rospy.get_time(), frames.HOME)
            self._client.send_goal(
                MoveBaseGoal(pose), done_cb=partial(self._on_done, output.number)
            )
        elif isinstance(output, CancelGoal):
            self._client.cancel_all_goals()

    def _on_done(self, number: int, status: int, _result) -> None:
        if status not in _GONE:
            text = self._client.get_goal_status_text() or GoalStatus.__name__
            self._receive(GoalEnded(number, status == GoalStatus.SUCCEEDED, text))


def main() -> int:
    """Run the node."""
    return node.run("move_base_goals", MoveBaseGoalsNode)
