# SPDX-License-Identifier: Apache-2.0
"""Goals as interactive markers of rviz: what is asked of them goes into the queue, the view says
how they stand."""

import math
from typing import Any, Callable, Dict, Tuple

from geometry_msgs.msg import Pose, Quaternion
from interactive_markers.interactive_marker_server import InteractiveMarkerServer
from interactive_markers.menu_handler import MenuHandler
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerControl,
    InteractiveMarkerFeedback,
    Marker,
)

from fcsv_console.model.goals import BaselineGoal, GoalEnabled, GoalMoved

NAMESPACE = "/console/goals"
_BALL_M = 0.5
# height of letters: rviz's own of a description are 0.2 m, which nobody reads at 1366 px
WORDS_M = 0.6
_HALF = math.sqrt(0.5)
_LOCKED, _FREE = (0.6, 0.6, 0.6, 0.7), (0.90, 0.62, 0.0, 0.9)  # Okabe and Ito's orange


class GoalMarkers:
    """``show`` from one thread, as often as one likes; ``put`` is called by rospy's."""

    def __init__(self, put: Callable[[Any], None]):
        self._put, self._server = put, InteractiveMarkerServer(NAMESPACE)
        self._shown: Tuple[BaselineGoal, ...] = ()
        self._menus: Dict[int, MenuHandler] = {}

    def show(self, goals: Tuple[BaselineGoal, ...]) -> None:
        """Shows goals in place of those before, where they differ."""
        if goals == self._shown:
            return
        self._shown = goals
        self._server.clear()
        self._menus = {}
        for goal in goals:
            self._server.insert(
                marker(goal), lambda feedback, g=goal: self._on_feedback(feedback, g.index)
            )
            menu = self._menus[goal.index] = MenuHandler()
            wanted = GoalEnabled(goal.index, not goal.enabled)
            entry = menu.insert(
                "Drag this goal", callback=lambda _feedback, wanted=wanted: self._put(wanted)
            )
            menu.setCheckState(
                entry, MenuHandler.CHECKED if goal.enabled else MenuHandler.UNCHECKED
            )
            menu.apply(self._server, marker_name(goal.index))
        self._server.applyChanges()

    def _on_feedback(self, feedback: InteractiveMarkerFeedback, index: int) -> None:
        if feedback.event_type == InteractiveMarkerFeedback.MOUSE_UP:
            p = feedback.pose.position
            self._put(GoalMoved(index, (p.x, p.y, p.z)))


def marker_name(index: int) -> str:
    """Names the marker of the configuration ``index``, counted from 1 for people."""
    return f"goal_{index + 1}"


def marker(goal: BaselineGoal) -> InteractiveMarker:
    """A ball with its words and a menu; arrows along its way where it may be dragged."""
    made = InteractiveMarker(name=marker_name(goal.index), scale=1.5, pose=Pose())
    made.header.frame_id = "home"
    made.pose.position.x, made.pose.position.y, made.pose.position.z = goal.p_home_m
    made.pose.orientation.w = 1.0
    ball = Marker(type=Marker.SPHERE)
    ball.pose.orientation.w = 1.0
    ball.scale.x = ball.scale.y = ball.scale.z = _BALL_M
    ball.color.r, ball.color.g, ball.color.b, ball.color.a = _FREE if goal.enabled else _LOCKED
    words = Marker(type=Marker.TEXT_VIEW_FACING, text=goal.words, color=ball.color)
    words.pose.orientation.w, words.pose.position.z, words.scale.z = 1.0, 0.8, WORDS_M
    menu = InteractiveMarkerControl(
        name="menu", interaction_mode=InteractiveMarkerControl.MENU, markers=[ball, words]
    )
    menu.always_visible, menu.orientation.w = True, 1.0
    made.controls = [menu]
    if goal.enabled:
        way = InteractiveMarkerControl(
            name="way", interaction_mode=InteractiveMarkerControl.MOVE_AXIS
        )
        x, y, z = goal.along
        way.orientation = Quaternion(0.0, -_HALF * z, _HALF * y, _HALF)  # its x axis along the way
        made.controls.append(way)
    return made
