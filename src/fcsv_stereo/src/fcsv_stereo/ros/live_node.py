# SPDX-License-Identifier: Apache-2.0
"""The map in flight: every configuration adds to it as it comes in over the link; or monitoring
while vehicles hold."""

import threading
import time
from dataclasses import dataclass
from typing import Dict, List, Optional, Union

import numpy as np
import rospy
from sensor_msgs.msg import Image

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.telemetry import CalibrationFound, HomeFound
from fcsv_msgs.msg import Capture, MapState
from fcsv_stereo.in_flight import monitoring
from fcsv_stereo.in_flight.live import MapStage
from fcsv_stereo.in_flight.live_site import LiveSite
from fcsv_stereo.in_flight.map_choice import (
    WATCHING,
    MapChoice,
    MapKind,
    MapTask,
    MissionMaps,
    Monitoring,
    WatchedMaps,
)
from fcsv_stereo.in_flight.warm_up import warm_up
from fcsv_stereo.instants import MOST_SKEW_S
from fcsv_stereo.map_files.cloud_bounds import CloudBounds, bound_cloud
from fcsv_stereo.model import LivePicture, MapResult, Method
from fcsv_stereo.pipeline import METHODS
from fcsv_stereo.refinement import KnownFeatures
from fcsv_stereo.ros.camera_covariances import subscribe_covariances
from fcsv_stereo.ros.captured_pictures import subscribe_pictures
from fcsv_stereo.ros.map_messages import REFERENCE_FRAME
from fcsv_stereo.ros.map_topics import MapTopics
from fcsv_stereo.sessions.messages import window_of

_STATE_PERIOD_S = 1.0


@dataclass(frozen=True)
class LiveParameters:
    """Parameters of the node; ``vehicles`` with the reference first.

    ``watch``: between the maps of a mission, once one is whole, depth of what the vehicles see now
    on /map/watch, for a robot that is guided over the map.
    ``monitor``: instead of one map of a mission, depth of what the vehicles see now, at most
    ``monitor_rate_hz`` times a second, from pictures at most ``apart_s`` apart (vehicles hold, the
    scene may move); ``joint`` makes larger pictures as small as 640 x 480, with the camera_info of
    that size. ``refine_every``: of so many of these, poses are refined in one and corrected as
    found in between; more than 1 only where their errors stay the same for seconds, as on a rig.
    ``bars``: straight thin things are matched as wholes, too, in finished maps and in monitoring
    (docs/user/ground_trackers.md). ``shown_from_m``, ``shown_to_m``: ends of the colours of
    /map/monitor.
    """

    vehicles: List[str]
    method: str = "joint"
    monitor: bool = False
    watch: bool = False
    monitor_rate_hz: float = 5.0
    apart_s: float = MOST_SKEW_S
    refine_every: int = 1
    bars: bool = False
    shown_from_m: float = monitoring.RANGE_M[0]
    shown_to_m: float = monitoring.RANGE_M[1]

    def __post_init__(self):
        if len(self.vehicles) < 2:
            raise ValueError(
                f"vehicles: {self.vehicles} are not two or more; name them, the reference first"
            )
        if self.watch and self.monitor:
            raise ValueError("watch: is beside maps, which monitor makes none of; set one of them")
        if self.method not in METHODS:
            raise ValueError(f"method: '{self.method}' is not one of {', '.join(METHODS)}")
        if self.bars and not METHODS[self.method].matches_bars:
            raise ValueError(
                f"bars: the method '{self.method}' does not match bars; use joint, or leave them out"
            )
        if not 0.1 <= self.monitor_rate_hz <= 30.0:
            raise ValueError(f"monitor_rate_hz: {self.monitor_rate_hz} is not in 0.1..30")
        if self.refine_every < 1:
            raise ValueError(f"refine_every: {self.refine_every} must be 1 or more")
        if not 0.0 < self.shown_from_m < self.shown_to_m:
            raise ValueError(
                f"shown_from_m: {self.shown_from_m} must lie in 0..shown_to_m ({self.shown_to_m})"
            )
        if not 0.0 < self.apart_s <= 5.0:
            raise ValueError(f"apart_s: {self.apart_s} is not in (0, 5]")


class LiveNode:
    """Callbacks file what comes in; one worker maps it."""

    def __init__(self):
        self._parameters = node.parameters(LiveParameters)
        self._choice, self._site = self._make_choice(), LiveSite()
        self._changed, self._in_home = threading.Condition(), HomeFrames()
        self._rate = monitoring.ImageRate()
        self._state = MapState(
            state=MapStage.WAITING.value, detail="waiting for the first configuration"
        )
        self._health = Health("map", {"pictures": 0.0})
        latched = {"queue_size": 1, "latch": True}
        self._topics = MapTopics()
        self._monitor = rospy.Publisher("/map/monitor", Image, **latched)
        self._states = rospy.Publisher("/map/state", MapState, **latched)
        self._timer = node.every(_STATE_PERIOD_S, lambda _event: self._say())
        subscribe_pictures(self._parameters.vehicles, self._receive, self._health)
        rospy.Subscriber("/mission/capture", Capture, self._on_capture, queue_size=50)
        subscribe_covariances(self._parameters.vehicles, self._on_covariance, self._health)

    def _make_choice(self) -> MapChoice:
        p = self._parameters
        if not (p.monitor or p.watch):
            return MissionMaps()
        refines = METHODS[p.method].refines_poses
        newest = Monitoring(p.vehicles, p.apart_s, p.refine_every, refines)
        return newest if p.monitor else WatchedMaps(newest)

    # ---- what comes in ---------------------------------------------------------------------------

    def _receive(self, data: object) -> None:
        with self._changed:
            if isinstance(data, LivePicture):
                self._choice.on_picture(data)
            else:
                self._on_frames(data)
            self._changed.notify()

    def _on_frames(self, data: Union[CalibrationFound, HomeFound]) -> None:
        if isinstance(data, CalibrationFound):
            self._in_home.calibrate(data.links, data.stamp_s)
        else:
            self._in_home.set_home(data.reference, data.T_odom_home)
        if self._in_home.places:
            self._choice.on_frames(self._in_home.T_home_odom, self._in_home.at)

    def _on_capture(self, message: Capture) -> None:
        with self._changed:
            self._choice.on_window(window_of(message))
            self._changed.notify()

    def _on_covariance(self, name: str, stamp_s: float, covariance: np.ndarray) -> None:
        with self._changed:
            self._choice.on_covariance(name, stamp_s, covariance)

    # ---- the worker ------------------------------------------------------------------------------

    def spin(self) -> None:
        """Maps what is new until ROS shuts the node down."""
        p = self._parameters
        method, options = METHODS[p.method], self._options()
        for each in [options[MapKind.INSTANT]] if p.monitor else options.values():
            warm_up(method, each)
        next_s = 0.0
        while not rospy.is_shutdown():
            # before looking: what is taken then is the newest
            time.sleep(max(0.0, next_s - time.monotonic()))
            task = self._next()
            if task is None:
                if self._site.due:
                    self._join()
                continue
            if task.kind in WATCHING:
                next_s = time.monotonic() + 1.0 / p.monitor_rate_hz
            result = self._map(method, options[task.kind], task)
            if result is not None:
                self._choice.learn(task, result)
                if task.view:
                    self._site.learn(task.view, result)

    def _options(self) -> Dict[MapKind, object]:
        """The method's options for each kind of map."""
        p, known = self._parameters, KnownFeatures()
        method = METHODS[p.method]
        maps = {}
        if not p.monitor:
            whole = method.remembering(method.options(), known)
            maps = {
                MapKind.FIRST_LOOK: method.remembering(method.quick, known),
                MapKind.WHOLE: method.with_bars(whole) if p.bars else whole,
            }
        if not (p.monitor or p.watch):
            return maps
        now = method.remembering(method.monitor, known)
        now = method.with_bars(now) if p.bars else now
        trusting = method.trusting_poses(now) if method.refines_poses else now
        return {**maps, MapKind.INSTANT: now, MapKind.INSTANT_CORRECTED: trusting}

    def _next(self) -> Optional[MapTask]:
        with self._changed:
            if self._choice.waits:
                self._changed.wait(0.2)
            try:
                return self._choice.next()
            except FcsvError as error:
                self._say(MapStage.FAILED, str(error))
                return None

    def _map(self, method: Method, options, task: MapTask) -> Optional[MapResult]:
        given, names = task.given, task.names
        watches = self._parameters.watch and task.kind in WATCHING
        if not (self._parameters.monitor or watches):
            self._say(MapStage.MAPPING, names)
        started = time.monotonic()
        try:
            result = bound_cloud(method.map(given, options), CloudBounds())
        except FcsvError as error:
            self._say(MapStage.FAILED, str(error), given.warnings)
            return None
        # a defect must not take the map away from a flight: the next configuration may do
        except Exception as error:
            self._say(MapStage.FAILED, node.defect(error), given.warnings)
            return None
        if watches:
            self._topics.publish_watch(result)
            self._health.problem("map", "")
            self._health.value("watch", f"{time.monotonic() - started:.2f} s")
            return result
        self._topics.publish(result)
        self._topics.publish_refined(result)
        state = self._state
        state.configurations, state.points, state.coverage = (
            len(result.pairs),
            result.points,
            result.coverage,
        )
        state.reference = rospy.Time.from_sec(result.reference.stamp_s)
        state.processing_s, state.latency_s = (
            time.monotonic() - started,
            rospy.get_time() - task.newest_s,
        )
        if self._parameters.monitor:
            self._show(result, monitoring.skew_s(given), names)
        partial = task.kind is MapKind.FIRST_LOOK
        self._say(MapStage.PARTIAL if partial else MapStage.READY, names, result.warnings)
        return result

    def _join(self) -> None:
        """The maps of all stations and headings so far as one cloud, while nothing else is due."""
        try:
            site = self._site.join()
        except FcsvError as error:
            self._health.problem("site", str(error))
            return
        # a defect must not take the map away from a flight
        except Exception as error:
            self._health.problem("site", node.defect(error))
            return
        self._topics.publish_site(site.cloud)
        self._health.problem("site", "")
        self._health.value("site", site.words)
        rospy.loginfo("site: %s", "; ".join([site.words, *site.remarks]))

    def _show(self, result: MapResult, skew_s: float, names: str) -> None:
        """The newest depth as a picture, for people: with its rate, skew and age."""
        now_s, s = rospy.get_time(), self._state
        self._rate.tick(now_s)
        s.skew_s, s.rate_hz = skew_s, self._rate.hz(now_s)
        line = monitoring.in_words(s.rate_hz, skew_s, s.latency_s, [names])
        range_m = self._parameters.shown_from_m, self._parameters.shown_to_m
        shown = monitoring.picture(result.reference.image, result.depth, line, range_m)
        stamp_s = result.reference.stamp_s
        self._monitor.publish(conversions.array_to_image(shown, "rgb8", stamp_s, REFERENCE_FRAME))

    def _say(
        self,
        state: Optional[MapStage] = None,
        detail: str = "",
        problems: Optional[List[str]] = None,
    ) -> None:
        """Publish the state, changed or not; a failure is also an error of this node's health."""
        s = self._state
        if state and (state, detail) != (s.state, s.detail):
            rospy.loginfo("map: %s: %s", state, detail)
        if state:
            s.state, s.detail, s.problems = state.value, detail, list(problems or [])
            self._health.problem("map", detail if state is MapStage.FAILED else "")
        s.header = conversions.header(rospy.get_time(), frames.HOME)
        s.rate_hz = self._rate.hz(rospy.get_time())
        self._states.publish(s)


def main() -> int:
    """Run the node."""
    return node.run("live_map", LiveNode)
