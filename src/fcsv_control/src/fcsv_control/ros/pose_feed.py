# SPDX-License-Identifier: Apache-2.0
"""The odometry's poses on their way to the autopilot: which go on, which are believed, what follows where they stop."""

import threading
import time
from typing import Callable, Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped

from fcsv_control.errors import ControlError
from fcsv_control.flight.feed import FeedParameters, FeedVerdict, VisionFeed
from fcsv_control.flight.feed_check import FeedCheck, FeedCheckRules
from fcsv_control.flight.link import FlightLink
from fcsv_control.flight.watchdog import Alarm, FeedWatchdog, WatchdogParameters
from fcsv_control.ros.posed import pose_in
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import ModeAsked, SceneMotion
from mavros_msgs.msg import StatusText

WATCH_S = 0.05
_STALL_S = 0.25  # a check that comes later than this was delayed itself


class PoseFeed:
    """``say(severity, text)`` tells people. It feeds from ``begin`` on; call ``watch`` every WATCH_S."""

    def __init__(
        self, name: str, feed: FeedParameters, watchdog: WatchdogParameters, belief: FeedCheckRules, health: Health,
        say: Callable[[int, str], None],
    ):  # fmt: skip
        self._name, self._odom, self._health, self._say = name, frames.odom(name), health, say
        self._feed = VisionFeed(feed)
        self._watchdog = FeedWatchdog(watchdog, time.monotonic())
        self._check = FeedCheck(belief)
        self._watched_s = time.monotonic()
        self._warned = False
        self._landing: Optional[threading.Thread] = None
        self._link: Optional[FlightLink] = None

    def begin(self, link: FlightLink) -> None:
        """Feed the autopilot behind this link from now on."""
        self._link = link
        self._asks = rospy.Publisher("flight_link/mode_asked", ModeAsked, queue_size=10, tcp_nodelay=True)
        rospy.Subscriber("mavros/vision_pose/pose", PoseStamped, self._on_vision, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("tags/scene_motion", SceneMotion, self._on_scene, queue_size=1)

    @property
    def doubt(self) -> str:
        """Why the poses are not believed; empty where they are."""
        return self._check.doubt

    def estimate(self, T_odom_body: np.ndarray, v_odom_mps) -> None:
        """The autopilot's estimate came."""
        self._check.estimate(time.monotonic(), T_odom_body, v_odom_mps)

    def barometer(self, height_m: float) -> None:
        """The autopilot's barometer was heard."""
        self._check.barometer(time.monotonic(), height_m)

    def _on_scene(self, m: SceneMotion) -> None:
        self._check.scene(time.monotonic(), m.span_s, m.off_rad, m.turn_rad, m.points, m.one_way)

    def begin_again(self) -> None:
        """The odometry's frame was begun anew: the next pose is adopted at once."""
        self._link.note_reset()
        self._check.begin_again()

    def _on_vision(self, message: PoseStamped) -> None:
        verdict, why = self._feed.judge(time.monotonic(), message.header.stamp.to_sec())
        if verdict is FeedVerdict.DROP:
            self._health.drop("late pose", why)
        if verdict is not FeedVerdict.SEND:
            return
        T_odom_body = pose_in(self._odom, message, "pose feed", self._health)
        if T_odom_body is not None:
            now_s, stamp_s = time.monotonic(), self._feed.stamp_s
            if self._check.waits(now_s, self._link.state.in_the_air):
                self._watchdog.feed(now_s)
            elif self._believed(now_s, stamp_s, T_odom_body):
                self._link.send_pose(stamp_s, T_odom_body)
                self._watchdog.feed(now_s)
                self._health.tick("pose feed")

    def _believed(self, now_s: float, stamp_s: float, T_odom_body: np.ndarray) -> bool:
        """Whether a pose agrees with what the autopilot feels."""
        state = self._link.state
        believed = self._check.passes(now_s, stamp_s, T_odom_body, state.armed, state.in_the_air)
        if believed and self._check.came_back:
            self._link.note_reset()
        doubt = self._check.doubt or self._check.scene_says
        self._health.problem("tracker", f"{self._name}: {doubt}" if doubt else "")
        return believed

    def watch(self, now_s: float) -> None:
        """What the age of the feed asks for."""
        pause_s, self._watched_s = now_s - self._watched_s, now_s
        if pause_s > _STALL_S:
            rospy.logwarn("%s: this computer did not let the flight link run for %.2f s", self._name, pause_s)
            self._watchdog.slept(now_s, pause_s - WATCH_S)
        s, ours = self._link.state, self._link.mode_is_ours
        alarm = self._watchdog.check(now_s, s.armed, s.mode, ours)
        late = alarm is not Alarm.NONE
        age = f"pose feed is {self._watchdog.age_s(now_s):.1f} s old"
        self._health.problem("feed", f"{self._name}: {age} while flying in {s.mode}" if late else "")
        if late and not self._warned:
            by_hand = "" if s.mode == "GUIDED" or ours else f" in {s.mode}: fly in ALT_HOLD, or land"
            self._say(StatusText.CRITICAL, f"{self._name}: {age}{by_hand}")
        self._warned = late
        if alarm is Alarm.LAND and (self._landing is None or not self._landing.is_alive()):
            self._say(StatusText.ALERT, f"{self._name}: {age}, landing")
            self._landing = threading.Thread(target=self._land_now, name="failsafe", daemon=True)
            self._landing.start()

    def _land_now(self) -> None:
        self._asks.publish(ModeAsked(conversions.header(rospy.get_time(), ""), "LAND"))  # else it is a pilot's
        try:
            self._link.set_mode("LAND")
        except ControlError as error:
            rospy.logerr("landing after the loss of the pose feed: %s", error)
