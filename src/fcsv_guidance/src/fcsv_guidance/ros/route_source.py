# SPDX-License-Identifier: Apache-2.0
"""What every node hears that leads a robot along a route: the path, stops, holds, the robot's
place."""

from typing import Callable

import rospy
from nav_msgs.msg import Path
from std_msgs.msg import String

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros.health import Health
from fcsv_guidance.messages import HoldRobot, StopRobot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_guidance.ros.place_source import PlaceParameters, PlaceSource
from fcsv_guidance.route.following import RouteToFollow
from fcsv_guidance.route.search import NO_ROUTE_KNOWN


class RouteSource:
    """Calls ``receive`` with RouteToFollow, StopRobot, HoldRobot, RobotPlace and PlaceLost. An empty
    path, and one that is none, stop the robot."""

    def __init__(self, place: PlaceParameters, receive: Callable[[object], None], health: Health):
        self._receive = receive
        rospy.Subscriber("path", Path, self._on_path, queue_size=1)
        rospy.Subscriber(
            "/stop_all", String, lambda _m: receive(StopRobot()), queue_size=5, tcp_nodelay=True
        )
        for source in ("hold", "place/hold"):
            rospy.Subscriber(
                source,
                String,
                lambda m, source=source: receive(HoldRobot(m.data, source)),
                queue_size=5,
                tcp_nodelay=True,
            )
        self._place = PlaceSource(place, receive, health, lose=receive)

    def _on_path(self, message: Path) -> None:
        try:
            points = messages.route_of(message)
            self._receive(RouteToFollow(points) if len(points) else StopRobot(NO_ROUTE_KNOWN))
        except FcsvError as error:
            self._receive(StopRobot(str(error)))
