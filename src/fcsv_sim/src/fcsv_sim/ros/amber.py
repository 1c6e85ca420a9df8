# SPDX-License-Identifier: Apache-2.0
"""A simulated operator who accepts amber lines of the flight check by their names, and says so."""

from typing import Sequence

import rospy

from fcsv_msgs.msg import FlightCheck, FlightCheckLine
from fcsv_msgs.srv import AcceptLine


def accept_amber(names: Sequence[str]) -> rospy.Subscriber:
    """Accepts, from now on, those of ``names`` wherever they are amber."""
    accept = rospy.ServiceProxy("/flight_check/accept", AcceptLine)

    def on_check(message: FlightCheck) -> None:
        for line in message.lines:
            if line.state == FlightCheckLine.AMBER and not line.accepted and line.name in names:
                try:
                    rospy.loginfo(
                        "operator: %s (%s)", accept(line.vehicle, line.name).message, line.what
                    )
                except rospy.ServiceException as error:
                    rospy.logwarn("operator: accepting %s %s: %s", line.vehicle, line.name, error)

    return rospy.Subscriber("/flight_check", FlightCheck, on_check, queue_size=1)
