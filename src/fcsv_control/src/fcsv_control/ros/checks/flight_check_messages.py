# SPDX-License-Identifier: Apache-2.0
"""Lines of the flight check to messages and back."""

import io
from typing import Dict, List, Sequence

import rospy

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_control.flight_check.vehicle import VEHICLE_CHECKS
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import FlightCheck, FlightCheckLine

MOST_TEXT = 120  # characters of what was found: an autopilot may say much
_REMEDIES: Dict[str, str] = {check.name: check.remedy for check in VEHICLE_CHECKS}


def small(vehicle: str, lines: Sequence[Line], next_s: float) -> FlightCheck:
    """A vehicle's report as it crosses the radio: of green lines the name, of the others no
    remedy."""
    green = " ".join(line.name for line in lines if line.state is Grade.GREEN)
    others = [
        FlightCheckLine(name=li.name, state=li.state, what=li.what[:MOST_TEXT], since_s=li.since_s)
        for li in lines
        if li.state is not Grade.GREEN
    ]
    return FlightCheck(conversions.header(rospy.get_time(), ""), vehicle, green, others, next_s)


def whole(lines: Sequence[Line], next_s: float) -> FlightCheck:
    """The fleet's table."""
    told = [
        FlightCheckLine(li.vehicle, li.name, li.state, li.what, li.remedy, li.since_s, li.accepted)
        for li in lines
    ]
    return FlightCheck(conversions.header(rospy.get_time(), ""), "control", "", told, next_s)


def lines_of(message: FlightCheck) -> List[Line]:
    """Gives the lines of either kind. A state that this version does not know counts as unknown."""
    green = [Line(message.vehicle, name, Grade.GREEN, "") for name in message.green.split()]
    known = {s.value for s in Grade}
    return green + [
        Line(
            m.vehicle or message.vehicle,
            m.name,
            Grade(m.state) if m.state in known else Grade.UNKNOWN,
            m.what,
            m.remedy or (_REMEDIES.get(m.name, "") if m.state != Grade.GREEN else ""),
            m.since_s,
            m.accepted,
        )
        for m in message.lines
    ]


def size_bytes(message: FlightCheck) -> int:
    """Counts the octets of its content on the wire."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return len(buffer.getvalue())


def patience_s(message: FlightCheck) -> float:
    """Says how long to wait: after so long without another report this one counts for nothing: two
    may get lost."""
    return 3.0 * message.next_s + 1.0
