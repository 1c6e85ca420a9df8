# SPDX-License-Identifier: Apache-2.0
"""The operator's side of the mission node: the service /mission/control and the action /mission/execute."""

import threading

import actionlib
import rospy

from fcsv_control.mission.machine import MissionMachine
from fcsv_msgs.msg import ExecuteAction, ExecuteFeedback, ExecuteResult
from fcsv_msgs.srv import Control, ControlResponse

_FEEDBACK_S = 0.5


class MissionDesk:
    """``lock`` guards the machine. It is never held while a goal is spoken to: the action server has its own."""

    def __init__(self, machine: MissionMachine, lock: threading.RLock):
        self._machine, self._lock = machine, lock
        self._goal = None
        self._cancelled = False
        self._told_s = float("-inf")
        rospy.Service("/mission/control", Control, self._on_control)
        self._server = actionlib.ActionServer(
            "/mission/execute", ExecuteAction, self._on_goal, self._on_cancel, auto_start=False
        )
        self._server.start()

    def _on_control(self, request) -> ControlResponse:
        with self._lock:
            refusal = self._machine.control(request.operation)
        rospy.loginfo("%s: %s", request.operation, refusal or "done")
        return ControlResponse(not refusal, refusal or f"done: {request.operation}")

    def _on_goal(self, goal) -> None:
        with self._lock:
            refusal = self._machine.execute(goal.get_goal().configurations)
        if refusal:
            goal.set_rejected(ExecuteResult(), refusal)
            return
        goal.set_accepted()
        self._goal, self._cancelled = goal, False

    def _on_cancel(self, goal) -> None:
        if goal != self._goal:
            return
        self._cancelled = True
        with self._lock:
            self._machine.finish("cancelled by who asked for it")

    def tell(self, now_s: float) -> None:
        """Feedback twice a second while a goal is flown, its result when the mission is over."""
        goal = self._goal
        if goal is None:
            return
        with self._lock:
            m = self._machine
            over, phase, detail = m.over, m.phase, m.detail
            feedback = ExecuteFeedback(m.configuration, phase, m.progress, detail)
            captured = list(dict.fromkeys(w.index for w in m.captures))
        if over:
            self._goal = None
            self._end(goal, phase, detail, captured)
        elif now_s - self._told_s >= _FEEDBACK_S:
            self._told_s = now_s
            goal.publish_feedback(feedback)

    def _end(self, goal, phase: str, detail: str, captured) -> None:
        asked = list(goal.get_goal().configurations) or range(len(self._machine.mission.configurations))
        result = ExecuteResult(captured, [i for i in asked if i not in captured])
        if phase == "DONE":
            goal.set_succeeded(result, detail)
        elif self._cancelled:
            goal.set_canceled(result, detail)
        else:
            goal.set_aborted(result, detail)
