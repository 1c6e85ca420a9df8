# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_control flight_check: what must be true before take-off, as a table
(docs/user/flight_check.md)."""

import argparse
import sys
import time
from typing import Dict, List, Optional, Sequence

import rosgraph
import rospy

from fcsv_control.flight_check import table
from fcsv_control.flight_check.lines import Line
from fcsv_control.ros.checks import flight_check_messages as messages
from fcsv_geometry.ros import node
from fcsv_msgs.msg import FlightCheck
from fcsv_msgs.srv import AcceptLine

FLEET, ACCEPT = "/flight_check", "/flight_check/accept"
_WAIT_S = 4.0
_NOTHING = 2


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status: 0 green, or amber and accepted; 1 amber; 2 red, unknown, or nothing is heard."""
    parser = argparse.ArgumentParser(prog="flight_check", description=__doc__)
    parser.add_argument("--watch", action="store_true", help="again every second, until Ctrl-C")
    parser.add_argument(
        "--accept", nargs=2, metavar=("VEHICLE", "LINE"), help="accept an amber line"
    )
    arguments = parser.parse_args(argv if argv is not None else rospy.myargv()[1:])
    try:
        kinds = rosgraph.Master("/flight_check").getTopicTypes()
    except OSError:
        print("flight_check: no ROS master answers; is ROS_MASTER_URI right?", file=sys.stderr)
        return _NOTHING
    topics = [name for name, kind in kinds if kind == FlightCheck._type]
    topics = [FLEET] if FLEET in topics else topics
    if not topics:
        print(
            "flight_check: neither vehicle_check nor fleet_check runs on this machine's master",
            file=sys.stderr,
        )
        return _NOTHING
    node.begin("flight_check_command", anonymous=True)
    if arguments.accept and not _accept(*arguments.accept):
        return _NOTHING
    return _show(topics, arguments.watch)


def _accept(vehicle: str, line: str) -> bool:
    try:
        rospy.wait_for_service(ACCEPT, _WAIT_S)
        answer = rospy.ServiceProxy(ACCEPT, AcceptLine)(vehicle, line)
    except (rospy.ServiceException, rospy.ROSException) as error:
        print(
            f"flight_check: lines are accepted on the control PC, where fleet_check runs: {error}",
            file=sys.stderr,
        )
        return False
    if not answer.success:
        print(f"flight_check: not accepted: {answer.message}", file=sys.stderr)
    return answer.success


class Reports:
    """The newest of each topic. What does not come again in time counts as not heard."""

    def __init__(self, topics: Sequence[str]):
        self.topics = list(topics)
        self._newest: Dict[str, FlightCheck] = {}
        self._at_s: Dict[str, float] = {}
        self._subscribers = [
            rospy.Subscriber(t, FlightCheck, self._keep, t, queue_size=5) for t in topics
        ]

    def _keep(self, message: FlightCheck, topic: str) -> None:
        self._newest[topic], self._at_s[topic] = message, time.monotonic()

    @property
    def silent(self) -> List[str]:
        """Topics on which no report came, or not again in time."""
        now_s = time.monotonic()
        return [
            t for t in self.topics if now_s - self._at_s.get(t, float("-inf")) > self._patience_s(t)
        ]

    def _patience_s(self, topic: str) -> float:
        return _WAIT_S if topic not in self._newest else messages.patience_s(self._newest[topic])

    def lines(self) -> List[Line]:
        """Gives the lines of all that are heard."""
        silent = self.silent
        return [
            li for t in self.topics if t not in silent for li in messages.lines_of(self._newest[t])
        ]


def _show(topics: Sequence[str], watch: bool) -> int:
    reports = Reports(topics)
    until_s = time.monotonic() + _WAIT_S
    while reports.silent and time.monotonic() < until_s and not rospy.is_shutdown():
        time.sleep(0.05)
    while watch and not rospy.is_shutdown():
        print("\033[2J\033[H" + _text(reports), flush=True)
        time.sleep(1.0)
    print("" if watch else _text(reports))
    return _NOTHING if reports.silent else table.exit_status(reports.lines())


def _text(reports: Reports) -> str:
    shown = table.render(reports.lines(), sys.stdout.isatty())
    return "\n".join([shown, *(f"flight_check: nothing is heard on {t}" for t in reports.silent)])
