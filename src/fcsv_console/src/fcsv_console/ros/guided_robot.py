# SPDX-License-Identifier: Apache-2.0
"""What guidance publishes of a robot on the ground, for the plan view."""

from dataclasses import replace
from typing import Callable, List, Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid, Path
from std_msgs.msg import String

from fcsv_console.model import facts as f
from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import FcsvError, GeometryError
from fcsv_geometry.ros import conversions

GRID, UPDATES, PATH, POSE = "/ground/map", "/ground/map_updates", "/ground/path", "/robot_pose"
STATUS = {"/ground/status": "ground", "/ground/follower/status": "follower"}


class GuidedRobotHearing:
    """``put`` is told of what comes."""

    def __init__(self, put: Callable[[f.Fact], None]):
        self._put = put
        self._grid: Optional[f.RobotGround] = None
        self._percents: Optional[np.ndarray] = None
        large = {"queue_size": 2, "buff_size": 1 << 24}
        self._subscribers: List[rospy.Subscriber] = [
            self._subscribe(GRID, OccupancyGrid, self._on_grid, **large),
            self._subscribe(UPDATES, OccupancyGridUpdate, self._on_update, **large),
            self._subscribe(PATH, Path, self._on_path, queue_size=2),
            self._subscribe(POSE, PoseWithCovarianceStamped, self._on_pose, queue_size=1),
        ]
        for topic, source in STATUS.items():
            said = lambda m, source=source: put(f.RobotStatus(source, m.data))  # noqa: E731
            self._subscribers.append(self._subscribe(topic, String, said, queue_size=5))

    def close(self) -> None:
        """End the subscriptions."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _subscribe(self, topic: str, kind, take: Callable, **how) -> rospy.Subscriber:
        def on_message(message) -> None:
            try:
                take(message)
            except (FcsvError, ValueError) as error:
                self._put(f.Unusable("control", topic, str(error)))

        return rospy.Subscriber(topic, kind, on_message, **how)

    def _on_grid(self, message: OccupancyGrid) -> None:
        info = message.info
        _require_home(message)
        self._percents = np.array(message.data, np.int8).reshape(info.height, info.width)
        at = info.origin.position
        self._grid = f.RobotGround(at.x, at.y, info.resolution, info.height, info.width, b"")
        self._put_grid()

    def _on_update(self, message: OccupancyGridUpdate) -> None:
        if self._percents is None:
            return  # the whole grid comes to who begins to listen
        part = np.array(message.data, np.int8).reshape(message.height, message.width)
        rows = slice(message.y, message.y + message.height)
        self._percents[rows, message.x : message.x + message.width] = part
        if part.size > 1:  # a single cell renews the stamp alone
            self._put_grid()

    def _put_grid(self) -> None:
        self._put(replace(self._grid, percents=self._percents.tobytes()))

    def _on_path(self, message: Path) -> None:
        if message.poses:
            _require_home(message)
        points = tuple((p.pose.position.x, p.pose.position.y) for p in message.poses)
        self._put(f.RobotRoute(points))

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        _require_home(message)
        T_home_robot = conversions.pose_to_transform(message.pose.pose)
        x_m, y_m = map(float, T_home_robot[:2, 3])
        self._put(f.RobotSeen(x_m, y_m, transforms.yaw(T_home_robot)))


def _require_home(message) -> None:
    """Raises GeometryError where a message is in another frame."""
    if message.header.frame_id != frames.HOME:
        raise GeometryError(f"is in frame '{message.header.frame_id}', not in {frames.HOME}")
