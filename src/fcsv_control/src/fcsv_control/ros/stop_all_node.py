# SPDX-License-Identifier: Apache-2.0
"""/stop_all and /land_all on the control PC, in a process of their own that needs no mission.

Services of these names (std_srvs/Trigger), and topics (std_msgs/String: the reason) on which anybody may call. The
mission hears the topics, too, and does nothing more by itself until the operator confirms ``resume``.
"""

import os
import threading
import time
from dataclasses import dataclass, field
from typing import Callable, Dict, List

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.stopping import LAND, STOP, StopAll, StopOrder
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Command, CommandAck, MissionState, StopReport
from mavros_msgs.msg import State

_STEP_HZ = 50.0
_REPORT_S = 0.5


@dataclass(frozen=True)
class StopAllParameters:
    """Parameters of the node: everybody who is stopped."""

    vehicles: List[str] = field(default_factory=list)

    def __post_init__(self):
        if not self.vehicles:
            raise ValueError("vehicles: is empty; name everybody who is to be stopped")


class StopAllNode:
    """What is due is sent by the caller's own thread at once, then by a timer."""

    def __init__(self):
        names = node.parameters(StopAllParameters).vehicles
        self._core, self._lock = StopAll(names), threading.RLock()
        self._sender = f"stop_all-{os.getpid()}-{os.urandom(3).hex()}"
        self._reported_s, self._said = float("-inf"), ""
        self._health = Health("stop_all")
        self._commands: Dict[str, rospy.Publisher] = {
            n: rospy.Publisher(f"/{n}/command", Command, queue_size=20, tcp_nodelay=True) for n in names
        }
        self._report = rospy.Publisher("/stop_all/report", StopReport, queue_size=5, latch=True)
        self._told = {
            asked: rospy.Publisher(f"/{asked}_all", String, queue_size=5, tcp_nodelay=True) for asked in (STOP, LAND)
        }
        self._timer = node.every(1.0 / _STEP_HZ, lambda _event: self._do())
        for name in names:
            rospy.Subscriber(f"/{name}/mavros/state", State, self._on_state, name, queue_size=5, tcp_nodelay=True)
            rospy.Subscriber(f"/{name}/command_ack", CommandAck, self._on_ack, name, queue_size=20)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)
        rospy.Subscriber("/stop_all/over", String, self._on_over, queue_size=1)
        for asked in (STOP, LAND):
            rospy.Subscriber(f"/{asked}_all", String, self._on_topic, asked, queue_size=5, tcp_nodelay=True)
        rospy.Service("/stop_all", Trigger, lambda request: self._on_service(request, STOP))
        rospy.Service("/land_all", Trigger, lambda request: self._on_service(request, LAND))

    # ---- calls ---------------------------------------------------------------------------------------------

    def _on_service(self, request, asked: str) -> TriggerResponse:
        reason = f"by {request._connection_header.get('callerid', 'somebody')}"
        self._told[asked].publish(String(reason))  # the mission first: it must not order anything after it
        self._do(lambda now_s: self._core.begin(now_s, asked, reason))
        with self._lock:
            words = self._core.report(time.monotonic()).in_words()
        return TriggerResponse(True, f"{words}; see /stop_all/report")

    def _on_topic(self, message: String, asked: str) -> None:
        if message._connection_header.get("callerid") != rospy.get_name():
            self._do(lambda now_s: self._core.begin(now_s, asked, message.data or "by a topic"))

    def _on_over(self, message: String) -> None:
        rospy.loginfo("over: %s", message.data)
        self._do(lambda _now_s: self._core.end())

    # ---- what is heard -------------------------------------------------------------------------------------

    def _on_state(self, m: State, name: str) -> None:
        self._do(lambda now_s: self._core.state(now_s, name, m.mode, m.armed))

    def _on_ack(self, m: CommandAck, name: str) -> None:
        if m.sender == self._sender:
            refusal = "" if m.result == CommandAck.DONE else m.reason or "refused without a reason"
            self._do(lambda now_s: self._core.acknowledged(now_s, name, m.number, refusal))

    def _on_mission(self, m: MissionState) -> None:
        self._do(lambda now_s: self._core.mission(now_s, m.phase_name))

    # ---- what is sent --------------------------------------------------------------------------------------

    def _do(self, heard: Callable[[float], None] = lambda _now_s: None) -> None:
        with self._lock:
            now_s = time.monotonic()
            heard(now_s)
            for order in self._core.due(now_s):
                self._commands[order.vehicle].publish(self._command(order, now_s))
            self._tell(now_s)

    def _command(self, order: StopOrder, now_s: float) -> Command:
        return Command(
            header=conversions.header(rospy.get_time(), ""), vehicle=order.vehicle, sender=self._sender,
            number=order.number, kind=Command.SET_MODE, mode=order.mode, ordered_s=order.ordered_s, sent_s=now_s,
        )  # fmt: skip

    def _tell(self, now_s: float) -> None:
        report = self._core.report(now_s)
        words = report.in_words() if report.asked else ""
        if words == self._said and now_s - self._reported_s < _REPORT_S:
            return
        if words and words != self._said:
            rospy.logwarn("%s", words)
        self._said, self._reported_s = words, now_s
        self._health.value("asked", report.asked or "nothing")
        self._health.problem("stop all", words)
        self._report.publish(StopReport(header=conversions.header(rospy.get_time(), ""), **vars(report)))


def main() -> int:
    """Run the node."""
    return node.run("stop_all", StopAllNode)
