# SPDX-License-Identifier: Apache-2.0
"""The ground on topics: grids with what changes in them, a path to the goal, a service for
routes."""

import threading
import time
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Callable, Deque, Dict, List, Tuple, Union

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import GridCells, OccupancyGrid, Path
from nav_msgs.srv import GetPlan, GetPlanResponse
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from fcsv_geometry import frames
from fcsv_geometry.errors import ConfigError, FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_guidance.ground.live_views import LiveViews
from fcsv_guidance.ground.site_views import read_views
from fcsv_guidance.messages import Goal, OwnVehicle, RobotPlace
from fcsv_guidance.robot import load_robot
from fcsv_guidance.ros import ground_messages as messages
from fcsv_guidance.ros.place_source import PlaceParameters, PlaceSource
from fcsv_guidance.ros.tag_follower import TagFollowerParameters, TagFollowerShell
from fcsv_guidance.route.following import RouteToFollow
from fcsv_guidance.route.ground_server import (
    GoalDropped,
    GridChanged,
    GridMessage,
    GroundRules,
    GroundServer,
    MapSeen,
    NoRouteMessage,
    RobotHold,
    RouteMessage,
)
from fcsv_guidance.route.search import NoRoute
from fcsv_stereo.ros.map_messages import REFERENCE_FRAME, WATCH_FRAME

_PERIOD_S, _CLOCK_S = 0.2, 0.05
MAP, WATCH = "/map", "/map/watch"  # topics below which depth views come in parts
DRIVES = ("cmd_vel", "move_base", "none")


@dataclass(frozen=True)
class GroundParameters:
    """Parameters of the node."""

    robot: str  # its file, config/robots/NAME.yaml
    # folders that map wrote in one home, or the one that survey wrote
    maps: List[str] = field(default_factory=list)
    live: bool = False  # take /map/depth with sigma and kind as they come, too
    stations: bool = False  # each reference picture of live maps is a map of its own, and stays
    watch: bool = False  # take /map/watch/depth likewise: what vehicles that hold see now
    # maps of folders count as of now, not of their pictures: only where nothing has moved since
    fresh: bool = False
    drive: str = "none"  # who drives by the path: cmd_vel, move_base or none; only checked
    ground: GroundRules = field(default_factory=GroundRules)
    place: PlaceParameters = field(default_factory=PlaceParameters)
    follower: TagFollowerParameters = field(default_factory=TagFollowerParameters)

    def __post_init__(self):
        if not self.maps and not self.live:
            raise ValueError("maps: is empty; name folders that 'map' wrote, or set live")
        if self.drive not in DRIVES:
            raise ValueError(f"drive: '{self.drive}' is none of {', '.join(DRIVES)}")


class _NewestGrid(rospy.SubscribeListener):
    """Who begins to listen to a grid gets it whole, as it is then; updates bring what changes
    later."""

    def __init__(self):
        super().__init__()
        self.message = None

    def peer_subscribe(
        self, topic_name: str, _topic_publish: Callable, peer_publish: Callable
    ) -> None:
        """rospy's: somebody begins to listen."""
        if self.message is not None:
            peer_publish(self.message)


class GroundNode:
    """Callbacks convert and file; one worker thread computes, the port decides."""

    def __init__(self):
        self._parameters = p = node.parameters(GroundParameters)
        robot = load_robot(p.robot)
        self._port = GroundServer(robot, p.ground)
        self._lock, self._health = threading.RLock(), Health("ground")
        self._due = threading.Condition()
        # the newest of map and watch, and of which reference picture
        self._views: Dict[Tuple[str, float], MapSeen] = {}
        self._came: Deque[Union[RobotPlace, OwnVehicle]] = deque(maxlen=400)
        if p.maps:
            first, *others = (self._as_of(view) for view in read_views(p.maps)[0])
            self._port.receive(rospy.get_time(), MapSeen(first, others=tuple(others)))
        latched = {"queue_size": 1, "latch": True}
        self._newest = _NewestGrid(), _NewestGrid()
        map_, stand = self._newest
        self._grids = (
            rospy.Publisher("map", OccupancyGrid, queue_size=1, subscriber_listener=map_),
            rospy.Publisher("stand", OccupancyGrid, queue_size=1, subscriber_listener=stand),
        )
        self._updates = (
            rospy.Publisher("map_updates", OccupancyGridUpdate, queue_size=10),
            rospy.Publisher("stand_updates", OccupancyGridUpdate, queue_size=10),
        )
        self._path = rospy.Publisher("path", Path, **latched)
        self._to_see = rospy.Publisher("to_see", GridCells, **latched)
        self._status = rospy.Publisher("status", String, **latched)
        self._held = rospy.Publisher("hold", String, **latched)
        # whoever still drives by the path of a ground_map that has died
        self._path.publish(messages.path_message(np.empty((0, 2)), rospy.get_time()))
        self._has_map = self._has_goal = False
        if not p.maps:
            self._say("no map has come")
        self._tell_of_map()
        self._publish()
        self._timer = node.every(_PERIOD_S, lambda _event: self._publish())
        rospy.Service("make_plan", GetPlan, self._on_plan)
        rospy.Subscriber("move_base_simple/goal", PoseStamped, self._on_goal, queue_size=1)
        rospy.Subscriber("/stop_all", String, self._on_stop, queue_size=5)
        self._follower = None
        if p.follower.vehicle:
            if not robot.tags:
                raise ConfigError(f"{p.robot}: 'tags' is missing: no vehicle can follow them")
            self._follower = TagFollowerShell(
                p.follower,
                robot,
                lambda: (self._port.ground, self._port.eye_m),
                self._came.append,
                self._health,
            )
        self._place = PlaceSource(p.place, self._on_place, self._health)
        if p.live:
            self._listen(MAP, REFERENCE_FRAME)
        if p.watch:
            self._listen(WATCH, WATCH_FRAME)

    def _as_of(self, view):
        """The view with the time for which it counts; one that nobody knows is the oldest of
        all."""
        while self._parameters.fresh and rospy.get_time() == 0.0 and not rospy.is_shutdown():
            time.sleep(_CLOCK_S)  # simulated time begins with the first /clock
        stamp_s = rospy.get_time() if self._parameters.fresh else view.stamp_s
        if not np.isfinite(stamp_s):
            rospy.logwarn(
                "%s: does not say when it was seen: it counts as too old to drive on (set fresh)",
                view.name,
            )
        return replace(view, stamp_s=stamp_s)

    # ---- live maps -------------------------------------------------------------------------------

    def _listen(self, topic: str, frame: str) -> None:
        """Subscribes to the parts of depth views on topics below ``topic``, of a camera in ``frame``."""
        views = LiveViews("live map" if topic == MAP else "watch")

        def add(message, part: str, convert: Callable[[], np.ndarray]) -> None:
            self._on_part(topic, views, message, part, convert)

        def on_static(message: TFMessage) -> None:
            for t in message.transforms:
                if t.child_frame_id == frame and t.header.frame_id == frames.HOME:
                    add(t, "T_home_cam", lambda t=t: conversions.transform_from_msg(t.transform))

        for part, encoding in (("depth", "32FC1"), ("sigma", "32FC1"), ("kind", "mono8")):
            rospy.Subscriber(
                f"{topic}/{part}",
                Image,
                lambda m, part=part, encoding=encoding: add(
                    m, part, lambda: conversions.image_to_array(m, encoding)
                ),
                queue_size=2,
                buff_size=1 << 24,
            )
        rospy.Subscriber(
            f"{topic}/camera_info",
            CameraInfo,
            lambda m: add(m, "camera", lambda: conversions.camera_from_info(m)),
            queue_size=2,
        )
        rospy.Subscriber("/tf_static", TFMessage, on_static, queue_size=20)

    def _on_part(self, topic: str, views: LiveViews, message, part: str, convert) -> None:
        try:
            with self._due:
                view = views.add(messages.stamp_of(message), part, convert())
                if view is not None:  # the newest is enough
                    stays = topic == MAP and self._parameters.stations
                    if stays:  # by its reference picture
                        view = replace(view, name=f"{view.name} {view.stamp_s:.3f}")
                    seen = MapSeen(view, topic == MAP and not stays, topic == WATCH)
                    self._views[topic, view.stamp_s if stays else 0.0] = seen
                    self._due.notify()
        except FcsvError as error:
            self._health.drop(f"{topic}/{part}", str(error))

    def spin(self) -> None:
        """Takes live maps until ROS shuts the node down."""
        while not rospy.is_shutdown():
            with self._due:
                if not self._views:
                    self._due.wait(0.2)
                views, self._views = self._views, {}
            for (topic, _), view in views.items():
                self._receive(view)
                self._health.tick(f"{topic}/depth")
                self._publish()

    def _on_place(self, place: RobotPlace) -> None:
        self._came.append(place)
        if self._follower is not None:
            self._follower.receive(place)

    # ---- goals and routes ------------------------------------------------------------------------

    def _on_goal(self, message: PoseStamped) -> None:
        try:
            goal = Goal(*messages.place_of(message, "goal"))
            goal.require_finite()
        except FcsvError as error:  # nobody wants the one before any more
            self._say(str(error), wrong=True)
            self._receive(GoalDropped(str(error)))
            return
        with self._lock:
            if self._port.whole_grid is not None:  # a bag has the grid of each route, whole
                self._show(self._port.whole_grid)
        if not self._has_goal:  # a hold of a ground_map that has died holds until now
            self._has_goal = True
            self._held.publish(String(""))
        self._receive(goal)

    def _on_stop(self, _message: String) -> None:
        self._receive(GoalDropped("stopped by the operator"))

    def _on_plan(self, request) -> GetPlanResponse:
        try:
            start_m, goal_m = (
                messages.place_of(request.start, "start"),
                messages.place_of(request.goal, "goal"),
            )
            with self._lock:
                found = self._port.plan(start_m, goal_m, request.tolerance)
                said = self._port.in_words(found) if isinstance(found, NoRoute) else None
        except FcsvError as error:  # nobody else asked: a drive goes on
            raise rospy.ServiceException(str(error)) from error
        if said is not None:
            raise rospy.ServiceException(said.reason)
        return GetPlanResponse(messages.path_message(found.points_home_m, rospy.get_time()))

    def _receive(self, message: object) -> None:
        try:
            with self._lock:
                self._receive_places()
                self._port.receive(rospy.get_time(), message)
        except FcsvError as error:
            if isinstance(message, MapSeen) and message.watching:
                self._health.drop(WATCH, str(error))  # the next may do
            else:
                self._say(str(error), wrong=True)
            return
        self._tell_of_map()
        self._publish()

    def _tell_of_map(self) -> None:
        if not self._has_map and self._port.ground is not None:
            self._has_map = True
            self._say("a map is here; no goal was given")

    def _receive_places(self) -> None:
        """Those that came while a map was laid, too: a view needs the places of its time."""
        while self._came:
            self._port.receive(rospy.get_time(), self._came.popleft())

    # ---- what goes out ---------------------------------------------------------------------------

    def _publish(self) -> None:
        with self._lock:
            self._receive_places()
            for said in self._port.pending():
                self._show(said)
            for said in self._port.step(rospy.get_time()):
                self._show(said)

    def _show(self, said: object) -> None:
        now_s = rospy.get_time()
        if isinstance(said, GridMessage):
            for publisher, message in zip(self._grids, self._whole(now_s)):
                publisher.publish(message)
        elif isinstance(said, GridChanged):
            self._whole(now_s)
            for publisher, region in zip(self._updates, (said.occupied, said.stands)):
                publisher.publish(messages.update_message(region, said.stamp_s))
        elif isinstance(said, RouteMessage):
            self._path.publish(messages.path_message(said.points_home_m, now_s))
            self._tell_follower(said.points_home_m)
            self._cells(np.empty((0, 2)))
            self._say(f"a route of {len(said.points_home_m)} corners leads to the goal")
        elif isinstance(said, NoRouteMessage):
            self._path.publish(messages.path_message(np.empty((0, 2)), now_s))
            self._tell_follower(np.empty((0, 2)))
            self._cells(said.to_see_m)
            self._say(said.reason, wrong=True)
        elif isinstance(said, RobotHold):
            self._held.publish(String(said.reason))

    def _tell_follower(self, points_home_m: np.ndarray) -> None:
        if self._follower is not None:  # of a single point nothing lies ahead
            several = len(points_home_m) > 1
            self._follower.receive(RouteToFollow(points_home_m if several else np.empty((0, 2))))

    def _whole(self, now_s: float) -> List[OccupancyGrid]:
        """Both grids as they are now, which new listeners get from here on."""
        said = self._port.whole_grid
        for newest, percents in zip(self._newest, (said.occupied, said.stands)):
            newest.message = messages.grid_message(said.grid, percents, said.stamp_s, now_s)
        return [newest.message for newest in self._newest]

    def _cells(self, to_see_m: np.ndarray) -> None:
        cell_m = 0.1 if self._port.whole_grid is None else self._port.whole_grid.grid.cell_m
        self._to_see.publish(messages.cells_message(to_see_m, cell_m, rospy.get_time()))

    def _say(self, text: str, wrong: bool = False) -> None:
        self._health.problem("route", text if wrong else "")
        if not wrong:
            rospy.loginfo("ground: %s", text)
        self._status.publish(String(text))


def main() -> int:
    """Run the node."""
    return node.run("ground_map", GroundNode)
