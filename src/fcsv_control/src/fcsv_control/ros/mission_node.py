# SPDX-License-Identifier: Apache-2.0
"""The mission on the control PC: topics into snapshots, orders into commands, the operator's confirmations."""

import os
import threading
import time
from typing import Dict, Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.mission.config import load_mission, tilt_rad
from fcsv_control.mission.machine import PHASES, MissionMachine
from fcsv_control.mission.outbox import Order
from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicle import load_vehicles
from fcsv_msgs.msg import (
    Calibration,
    Capture,
    Command,
    CommandAck,
    Configuration,
    Home,
    MissionState,
    State,
    TagDetections,
)
from fcsv_msgs.srv import Calibrate, SetHome
from fcsv_tracking.chain import odoms_in_home
from fcsv_tracking.ros import link_messages

_TAG_GAP_S = 1.0


class _Heard:
    """The latest of one vehicle."""

    def __init__(self):
        self.T_odom_body: Optional[np.ndarray] = None
        self.odometry_s = self.state_s = float("-inf")
        self.speed_mps = float("inf")
        self.ground_z: Optional[float] = None
        self.state = State()
        self.tag_s = self.tag_since_s = float("-inf")


class MissionNode:
    """Steps the machine at 10 Hz."""

    def __init__(self):
        self._names = list(rospy.get_param("~vehicles"))
        self._vehicles = load_vehicles(rospy.get_param("~vehicles_dir"), self._names)
        self._mission = load_mission(rospy.get_param("~mission"))
        rospy.loginfo("%s", self._mission)
        self._machine = MissionMachine(self._mission, self._names)
        self._sender = f"mission-{os.getpid()}-{int(time.time())}"
        self._lock = threading.RLock()
        self._heard: Dict[str, _Heard] = {n: _Heard() for n in self._names}
        self._calibration: Optional[Calibration] = None
        self._home: Optional[Home] = None
        self._T_home_odom: Dict[str, np.ndarray] = {}
        self._published_captures = 0
        self._health = Health("mission")
        self._state = rospy.Publisher("/mission/state", MissionState, queue_size=10, latch=True)
        self._captures = rospy.Publisher("/mission/capture", Capture, queue_size=50, latch=True)
        self._commands = {n: rospy.Publisher(f"/{n}/command", Command, queue_size=20) for n in self._names}
        self._calibrate = rospy.ServiceProxy("/calibrate", Calibrate)
        self._set_home = rospy.ServiceProxy("/set_home", SetHome)
        rospy.Service("/mission/proceed", Trigger, self._on_proceed)
        rospy.Service("/mission/abort", Trigger, self._on_abort)
        rospy.Subscriber("/calibration", Calibration, self._on_calibration, queue_size=1)
        rospy.Subscriber("/home", Home, self._on_home, queue_size=1)
        for i, name in enumerate(self._names):
            front = self._names[i - 1] if i else None
            rospy.Subscriber(f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=10)
            rospy.Subscriber(f"/{name}/mavros/state", State, self._on_state, name, queue_size=10)
            rospy.Subscriber(f"/{name}/command_ack", CommandAck, self._on_ack, queue_size=20)
            if front:
                rospy.Subscriber(f"/{name}/tags/detections", TagDetections, self._on_tags, (name, front), queue_size=5)

    # ---- what is heard -------------------------------------------------------------------------------------

    def _on_odometry(self, message: Odometry, name: str) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", f"{name}: {error}")
            return
        v = message.twist.twist.linear
        with self._lock:
            heard = self._heard[name]
            heard.T_odom_body, heard.odometry_s = T_odom_body, message.header.stamp.to_sec()
            heard.speed_mps = float(np.linalg.norm((v.x, v.y, v.z)))
            if not heard.state.armed:
                heard.ground_z = T_odom_body[2, 3]

    def _on_state(self, message: State, name: str) -> None:
        with self._lock:
            self._heard[name].state, self._heard[name].state_s = message, rospy.get_time()

    def _on_tags(self, message: TagDetections, names) -> None:
        name, front = names
        if self._vehicles[front].tag_id not in [d.id for d in message.detections]:
            return
        with self._lock:
            heard, stamp_s = self._heard[name], message.header.stamp.to_sec()
            if stamp_s - heard.tag_s > _TAG_GAP_S:
                heard.tag_since_s = stamp_s
            heard.tag_s = stamp_s

    def _on_ack(self, message: CommandAck) -> None:
        if message.sender != self._sender:
            return
        outcome = "" if message.result == CommandAck.DONE else message.reason or "refused"
        with self._lock:
            self._machine.outbox.acknowledged(message.vehicle, message.number, outcome)

    def _on_calibration(self, message: Calibration) -> None:
        with self._lock:
            self._calibration = message
            self._recompose()

    def _on_home(self, message: Home) -> None:
        with self._lock:
            self._home = message
            self._recompose()

    def _recompose(self) -> None:
        if self._calibration is not None and self._home is not None:
            links = [link_messages.from_message(link) for link in self._calibration.links]
            T_odom_home = conversions.pose_to_transform(self._home.home_in_odom)
            self._T_home_odom = odoms_in_home(links, self._home.reference, T_odom_home)

    # ---- the operator --------------------------------------------------------------------------------------

    def _on_proceed(self, _request) -> TriggerResponse:
        with self._lock:
            refusal = self._machine.proceed()
            wants, self._machine.wants = self._machine.wants, ""
        if wants:
            threading.Thread(target=self._call, args=(wants,), daemon=True).start()
        return TriggerResponse(not refusal, refusal)

    def _on_abort(self, _request) -> TriggerResponse:
        with self._lock:
            self._machine.abort("aborted by the operator: landing")
        return TriggerResponse(True, "landing all vehicles")

    def _call(self, wants: str) -> None:
        service, arguments = {
            "calibrate": (self._calibrate, (self._names, 0.0)),
            "set_home": (self._set_home, (self._mission.reference,)),
        }[wants]
        try:
            answer = service(*arguments)
            success, message = answer.success, answer.message
        except rospy.ServiceException as error:
            success, message = False, f"{service.resolved_name}: {error}"
        with self._lock:
            self._machine.answer(wants, success, message)

    # ---- the loop ------------------------------------------------------------------------------------------

    def spin(self) -> None:
        """Step, send what is due, publish the state, until ROS ends."""
        while not rospy.is_shutdown():
            with self._lock:
                now_s = rospy.get_time()
                self._machine.step(self._snapshot(now_s))
                for order in self._machine.outbox.due(now_s):
                    self._commands[order.vehicle].publish(self._message(order, now_s))
                self._publish(now_s)
            time.sleep(0.1)

    def _snapshot(self, now_s: float) -> Snapshot:
        views = {name: self._view(name, now_s) for name in self._names}
        cameras = {name: v.T_body_cam for name, v in self._vehicles.items()}
        return Snapshot(now_s, views, dict(self._T_home_odom), cameras)

    def _view(self, name: str, now_s: float) -> VehicleView:
        h = self._heard[name]
        T_home_odom = self._T_home_odom.get(name)
        known = h.T_odom_body is not None
        T_home_cam = None
        if known and T_home_odom is not None:
            T_home_cam = T_home_odom @ h.T_odom_body @ self._vehicles[name].T_body_cam
        seen = now_s - h.tag_s < _TAG_GAP_S
        return VehicleView(
            pose_age_s=now_s - h.odometry_s,
            T_odom_body=h.T_odom_body,
            speed_mps=h.speed_mps,
            height_m=h.T_odom_body[2, 3] - h.ground_z if known and h.ground_z is not None else 0.0,
            state_age_s=now_s - h.state_s,
            connected=h.state.connected,
            armed=h.state.armed,
            mode=h.state.mode,
            sees_front_s=h.tag_s - h.tag_since_s if seen else 0.0,
            T_home_cam=T_home_cam,
        )

    def _message(self, order: Order, now_s: float) -> Command:
        a = order.arguments
        command = Command(header=conversions.header(now_s, ""), vehicle=order.vehicle, sender=self._sender)
        command.number, command.expires = order.number, rospy.Time.from_sec(order.expires_s)
        command.kind = getattr(Command, order.kind)
        command.mode, command.flag = a.get("mode", ""), a.get("flag", False)
        command.target = PoseStamped()
        if "target" in a:
            command.target = conversions.pose_stamped(a["target"], now_s, a["frame"])
        return command

    def _publish(self, now_s: float) -> None:
        m = self._machine
        self._state.publish(
            MissionState(
                header=conversions.header(now_s, ""),
                phase=PHASES.index(m.phase),
                phase_name=m.phase,
                detail=m.detail,
                waits_for=m.waits_for,
                configuration=m.configuration,
                configurations=len(self._mission.configurations),
                problems=m.problems,
            )
        )
        for window in m.captures[self._published_captures :]:
            self._captures.publish(self._capture(window, now_s))
        self._published_captures = len(m.captures)

    def _capture(self, window, now_s: float) -> Capture:
        c = self._mission.configurations[window.index]
        axis = Configuration.HORIZONTAL if c.axis == "horizontal" else Configuration.VERTICAL
        return Capture(
            header=conversions.header(now_s, ""),
            index=window.index,
            configuration=Configuration(c.title, axis, c.baseline_m, tilt_rad(c), c.record_s),
            reference=self._mission.reference,
            vehicle=window.vehicle,
            start=rospy.Time.from_sec(window.start_s),
            stop=rospy.Time.from_sec(window.stop_s),
            position_error_m=window.position_error_m,
        )


def main() -> int:
    """Run the node; a mission that cannot be flown ends it with one line."""
    rospy.init_node("mission")
    try:
        node = MissionNode()
    except (FcsvError, ValueError) as error:
        rospy.logfatal("%s", error)
        return 2
    node.spin()
    return 0
