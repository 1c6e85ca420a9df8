# SPDX-License-Identifier: Apache-2.0
"""The operator's side of the mission node: its services, and the action /mission/execute."""

from typing import Callable, Sequence

import actionlib
import rospy
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.control_messages import Abort, Cancel, Confirm, Execute, MissionStatus, Operate
from fcsv_geometry.vehicles.telemetry import Reply
from fcsv_msgs.msg import ExecuteAction, ExecuteFeedback, ExecuteResult
from fcsv_msgs.srv import Control, ControlResponse, Proceed, ProceedResponse

_FEEDBACK_S = 0.5


class MissionDesk:
    """``recorded``: indices of the configurations with pictures. ``serve`` answers a request. It is
    never called while a goal is spoken to: the action server has its own lock."""

    def __init__(self, recorded: Sequence[int], serve: Callable[[object], Reply]):
        self._recorded, self._serve = recorded, serve
        self._goal = None
        self._cancelled = False
        self._told_s = float("-inf")
        rospy.Service(
            "/mission/proceed", Proceed, lambda r: ProceedResponse(*self._ask(Confirm(r.step)))
        )
        rospy.Service(
            "/mission/control", Control, lambda r: ControlResponse(*self._ask(Operate(r.operation)))
        )
        rospy.Service("/mission/abort", Trigger, lambda _r: TriggerResponse(*self._ask(Abort())))
        self._server = actionlib.ActionServer(
            "/mission/execute", ExecuteAction, self._on_goal, self._on_cancel, auto_start=False
        )
        self._server.start()

    def _ask(self, request: object):
        answer = self._serve(request)
        return answer.done, answer.text

    def _on_goal(self, goal) -> None:
        answer = self._serve(Execute(list(goal.get_goal().configurations)))
        if not answer.done:
            goal.set_rejected(ExecuteResult(), answer.text)
            return
        goal.set_accepted()
        self._goal, self._cancelled = goal, False

    def _on_cancel(self, goal) -> None:
        if goal != self._goal:
            return
        self._cancelled = True
        self._serve(Cancel())

    def tell(self, now_s: float, m: MissionStatus) -> None:
        """Feedback twice a second while a goal is flown, its result when the mission is over."""
        goal = self._goal
        if goal is None:
            return
        if m.over:
            self._goal = None
            self._end(goal, m)
        elif now_s - self._told_s >= _FEEDBACK_S:
            self._told_s = now_s
            goal.publish_feedback(ExecuteFeedback(m.configuration, m.phase, m.progress, m.detail))

    def _end(self, goal, m: MissionStatus) -> None:
        asked = list(goal.get_goal().configurations) or self._recorded
        left = [i for i in asked if i in self._recorded and i not in m.captured]
        result = ExecuteResult(m.captured, left)
        if m.phase == "DONE":
            goal.set_succeeded(result, m.detail)
        elif self._cancelled:
            goal.set_canceled(result, m.detail)
        else:
            goal.set_aborted(result, m.detail)
