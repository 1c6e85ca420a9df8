# SPDX-License-Identifier: Apache-2.0
"""A robot that is guided while the vehicles of a demo hold and watch it: the drive begins with the
mission's last configuration and ends it."""

import threading
from typing import Callable, Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from tf2_msgs.msg import TFMessage

from fcsv_control.mission.activities.stages import FOLLOWS, RECORDS
from fcsv_geometry import frames, transforms
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import MapState, MissionState
from fcsv_msgs.srv import Control
from fcsv_sim.demo.fleet import FleetPlan
from fcsv_sim.demo.robot_place import guided_drive, write_home
from fcsv_sim.demo.truth_export import true_camera
from fcsv_sim.machines.machines import Machine
from fcsv_sim.robot.guided import DriveRun
from fcsv_sim.robot.placed import place_of
from fcsv_sim.world.town import Town
from fcsv_stereo.ros.map_messages import REFERENCE_FRAME

_START_SIGMA_M = 1.0  # of where an operator says that the robot stands


class DriveAlong:
    """Begins the drive on the control PC's machine, whose master this process is on, once the live
    map has all configurations before the last and the vehicles hold."""

    def __init__(self, plan: FleetPlan, machine: Machine, say: Callable[[str], None]):
        self._plan, self._machine, self._say = plan, machine, say
        self._lock = threading.Lock()
        self._mission: Optional[MissionState] = None
        self._map: Optional[MapState] = None
        self._reference: Optional[tuple] = None  # stamp (s), T_home_cam
        self._run: Optional[DriveRun] = None
        self._ended = False
        rospy.Subscriber("/mission/state", MissionState, self._on_mission)
        rospy.Subscriber("/map/state", MapState, self._on_map)
        rospy.Subscriber("/tf_static", TFMessage, self._on_static, queue_size=20)

    def _on_mission(self, message: MissionState) -> None:
        with self._lock:
            self._mission = message

    def _on_map(self, message: MapState) -> None:
        with self._lock:
            self._map = message

    def _on_static(self, message: TFMessage) -> None:
        for each in message.transforms:
            if each.child_frame_id == REFERENCE_FRAME and each.header.frame_id == frames.HOME:
                T_home_cam = conversions.transform_from_msg(each.transform)
                with self._lock:
                    self._reference = each.header.stamp.to_sec(), T_home_cam

    def step(self) -> None:
        """Begins the drive where it is time, and ends the mission's last configuration with it.
        Raises MachineError where the drive breaks down."""
        if self._run is None:
            T_world_home = self._ready()
            if T_world_home is not None:
                self._begin(T_world_home)
        elif not self._ended and self._run.over:
            self._ended = True
            then = "land" if self._plan.robot_site else "go back and land"
            self._say(f"the robot's drive is over: the vehicles {then}")
            rospy.ServiceProxy("/mission/control", Control)("skip")

    def _ready(self) -> Optional[np.ndarray]:
        """T_world_home, by the truth of the live map's reference; None while it is too early."""
        with self._lock:
            mission, mapped, reference = self._mission, self._map, self._reference
        if mission is None or mapped is None or reference is None:
            return None
        last = mission.configurations - 1
        stage = FOLLOWS if self._plan.follower else RECORDS
        if mission.configuration != last or mission.stage != stage:
            return None
        if mapped.state != "ready" or mapped.configurations < last:
            return None
        stamp_s, T_home_cam = reference
        T_world_cam = true_camera(self._plan.sim_folder, self._plan.vehicles[0], stamp_s)
        return None if T_world_cam is None else T_world_cam @ transforms.invert(T_home_cam)

    def _begin(self, T_world_home: np.ndarray) -> None:
        write_home(self._plan, T_world_home)
        held = "the vehicles follow" if self._plan.robot_site else "the vehicles hold and watch"
        if self._plan.follower:
            held = f"two vehicles hold and watch, {self._plan.follower} follows and reads its tags"
            self._tell_start(T_world_home)
        self._say(f"{held}; a robot is guided by the nodes of guidance.launch")
        self._run = DriveRun(guided_drive(self._plan, T_world_home), self._machine)

    def _tell_start(self, T_world_home: np.ndarray) -> None:
        """Says about where the robot stands, as an operator does in rviz."""
        place = place_of(Town.generate(self._plan.seed, self._plan.world))
        start_m = np.array([*place.start_m, 0.0])
        start_m += np.random.default_rng([self._plan.seed, 31]).normal(0.0, _START_SIGMA_M, 3)
        T_home_world = transforms.invert(transforms.level(T_world_home))
        said = PoseWithCovarianceStamped()
        said.header = conversions.header(rospy.get_time(), frames.HOME)
        x_m, y_m, _ = transforms.apply(T_home_world, start_m)
        said.pose.pose.position.x, said.pose.pose.position.y = x_m, y_m
        said.pose.pose.orientation.w = 1.0
        said.pose.covariance[0] = said.pose.covariance[7] = _START_SIGMA_M**2
        self._start = rospy.Publisher(
            "/ground/initialpose", PoseWithCovarianceStamped, queue_size=1, latch=True
        )
        self._start.publish(said)
