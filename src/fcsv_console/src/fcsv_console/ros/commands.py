# SPDX-License-Identifier: Apache-2.0
"""What the operator asks for, as topics, services and the action of those who do it. Each answer
comes later."""

import os
import threading
import time
from typing import Callable, Dict, Sequence, Set, Tuple

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from std_msgs.msg import String

from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Command, CommandAck, ExecuteAction, ExecuteGoal
from fcsv_msgs.srv import AcceptLine, Control, Proceed

Answer = Callable[[str, bool], None]
_SERVER_S = 3.0
_REPEAT_S, _REPEATS = 0.2, 15
_NOBODY = "NOBODY LISTENS: the node stop_all does not run; pilots, take over"


class CommandClient:
    """Every call returns at once; ``answer(words, done)`` is called by another thread."""

    def __init__(self, vehicles: Sequence[str]):
        self._sender = f"console-{os.getpid()}-{os.urandom(3).hex()}"
        self._number = 0
        self._open: Set[Tuple[str, int]] = set()
        self._all = {
            what: rospy.Publisher(f"/{what}", String, queue_size=5, tcp_nodelay=True)
            for what in ("stop_all", "land_all")
        }
        self._commands = {
            n: rospy.Publisher(f"/{n}/command", Command, queue_size=20) for n in vehicles
        }
        self._acks = [
            rospy.Subscriber(f"/{n}/command_ack", CommandAck, self._on_ack) for n in vehicles
        ]
        self._refusals: Dict[Tuple[str, int], str] = {}  # "" where it is done
        self._execute = actionlib.ActionClient("/mission/execute", ExecuteAction)
        self._goal = None  # kept: who lets go of it hears no answer

    # ---- everybody, without the mission ----------------------------------------------------------

    def everybody(self, what: str, answer: Answer) -> None:
        """``what``: "stop_all" or "land_all". Sent by the caller's own thread, over a connection
        that stands."""
        publisher = self._all[what]
        listeners = publisher.get_num_connections()
        publisher.publish(String("the operator at the console"))
        answer("sent; see the report of stop_all" if listeners else _NOBODY, listeners > 0)

    # ---- the mission -----------------------------------------------------------------------------

    def proceed(self, step: str, answer: Answer) -> None:
        """Confirm the step that is waited for."""
        self._service("/mission/proceed", Proceed, (step,), answer)

    def control(self, operation: str, answer: Answer) -> None:
        """pause, skip, repeat, next, previous, skip_station, repeat_station, resume_station, abort."""
        self._service("/mission/control", Control, (operation,), answer)

    def accept(self, vehicle: str, line: str, answer: Answer) -> None:
        """An amber line of the flight check."""
        self._service("/flight_check/accept", AcceptLine, (vehicle, line), answer)

    def execute(self, configurations: Sequence[int], answer: Answer) -> None:
        """Fly these configurations, none: all."""

        def changed(handle) -> None:
            status = handle.get_goal_status()
            if status == GoalStatus.ACTIVE:
                answer("accepted: it is flown", True)
            elif status in (GoalStatus.REJECTED, GoalStatus.ABORTED, GoalStatus.LOST):
                answer(handle.get_goal_status_text() or "refused", False)

        def send() -> None:
            if not self._execute.wait_for_server(rospy.Duration(_SERVER_S)):
                answer("/mission/execute does not answer", False)
                return
            self._goal = self._execute.send_goal(ExecuteGoal(list(configurations)), changed)

        _start(send)

    def _service(self, name: str, kind, arguments: Tuple, answer: Answer) -> None:
        def call() -> None:
            try:
                rospy.wait_for_service(name, _SERVER_S)
                told = rospy.ServiceProxy(name, kind)(*arguments)
            except (rospy.ServiceException, rospy.ROSException, OSError) as error:
                answer(f"{name}: {error}", False)
                return
            answer(told.message, told.success)

        _start(call)

    # ---- commands to a vehicle -------------------------------------------------------------------

    def record(self, on: bool, answer: Answer) -> None:
        """Pictures on or off on every vehicle, repeated until each has answered."""
        orders = []
        for name in self._commands:
            self._number += 1
            orders.append((name, self._number))
        self._open.update(orders)
        ordered_s = time.monotonic()

        def send() -> None:
            for _ in range(_REPEATS):
                for name, number in [o for o in orders if o in self._open]:
                    self._commands[name].publish(self._command(name, number, on, ordered_s))
                time.sleep(_REPEAT_S)
                if not self._open.intersection(orders):
                    break
            refusals = {name: self._refusals.pop((name, n), "no answer") for name, n in orders}
            self._open.difference_update(orders)
            told = (f"{name}: {refusal or 'done'}" for name, refusal in refusals.items())
            answer("; ".join(told), not any(refusals.values()))

        _start(send)

    def _command(self, name: str, number: int, on: bool, ordered_s: float) -> Command:
        return Command(
            header=conversions.header(rospy.get_time(), ""),
            vehicle=name,
            sender=self._sender,
            number=number,
            kind=Command.RECORD,
            flag=on,
            ordered_s=ordered_s,
            sent_s=time.monotonic(),
            lifetime_s=_REPEAT_S * _REPEATS,
        )

    def _on_ack(self, m: CommandAck) -> None:
        key = (m.vehicle, m.number)
        if m.sender == self._sender and key in self._open:
            self._refusals[key] = "" if m.result == CommandAck.DONE else m.reason or "refused"
            self._open.discard(key)


def _start(work: Callable[[], None]) -> None:
    threading.Thread(target=work, daemon=True).start()
