# SPDX-License-Identifier: Apache-2.0
"""A simulated gimbal and its camera under the topics of the real ones: joint_states, command,
camera."""

import threading
import time
from dataclasses import dataclass, field
from typing import Tuple

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_sim.gimbal.gimbal import MountErrors, ServoErrors, SimulatedGimbal
from fcsv_sim.gimbal.gimbal_camera import GimbalCamera, GimbalCameraParameters
from fcsv_sim.truth import TruthReader
from fcsv_sim.world.movers import ROBOT
from fcsv_tracking.gimbal.config import load_gimbals
from fcsv_tracking.ros.gimbal_servos_node import ServoLoop

_READ_HZ = 100.0


@dataclass(frozen=True)
class GimbalNodeParameters:
    """Parameters of the node; the ground robot stands at ``robot_xyz_yaw`` (m, rad) in the world, or
    is where a simulated robot (sim_robot.launch) drives it: ``robot_drives``."""

    vehicle: str
    robot_file: str
    sim_dir: str
    seed: int = 1
    robot_xyz_yaw: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    robot_drives: bool = False
    camera: GimbalCameraParameters = field(default_factory=GimbalCameraParameters)
    servo: ServoErrors = field(default_factory=ServoErrors)
    mount: MountErrors = field(default_factory=MountErrors)


class GimbalNode:
    """Servos are read in a thread of their own; pictures come at the rate, or as fast as they are
    drawn."""

    def __init__(self):
        p = self._parameters = node.parameters(GimbalNodeParameters)
        gimbal, self._name = load_gimbals(p.robot_file, [p.vehicle])[p.vehicle], p.vehicle
        cv2.setNumThreads(1)
        *place, yaw = p.robot_xyz_yaw
        self._T_ground_world = transforms.invert(transforms.from_xyz_yaw(place, yaw))
        self._truth = TruthReader(p.sim_dir, p.vehicle)
        self._robot = TruthReader(p.sim_dir, ROBOT) if p.robot_drives else None
        seed = p.seed * 1000 + gimbal.servo.pan_id
        self._servos = SimulatedGimbal(gimbal.geometry, seed, time.time, p.servo, p.mount)
        self._servos.turn(gimbal.start)
        self._camera = GimbalCamera(gimbal.tags, p.camera, seed)
        self._health = Health(
            p.vehicle, {f"{p.vehicle} joints": 0.5 * _READ_HZ, "pictures": 0.3 * p.camera.rate_hz}
        )
        at = f"/{p.vehicle}/gimbal/camera"
        self._pictures = rospy.Publisher(f"{at}/image_raw", Image, queue_size=2)
        self._infos = rospy.Publisher(f"{at}/camera_info", CameraInfo, queue_size=2)
        self._lock = threading.Lock()
        self._loop = ServoLoop(p.vehicle, self._servos, self._health)
        self._timer = node.every(1.0 / _READ_HZ, self._serve)

    def _serve(self, _event) -> None:
        with self._lock:
            self._loop.pass_once()

    def spin(self) -> None:
        """Runs until ROS shuts the node down."""
        due_s, period_s = time.time(), 1.0 / self._parameters.camera.rate_hz
        while not rospy.is_shutdown():
            due_s = max(due_s + period_s, time.time() - 0.5 * period_s)
            time.sleep(max(0.0, due_s - time.time()))
            try:
                self._photograph(time.time() - 0.02)
            except PoseUnavailable as error:
                self._health.drop("no truth", str(error))
                time.sleep(0.1)

    def _photograph(self, true_s: float) -> None:
        self._truth.wait_for(true_s + self._parameters.camera.exposure_s)
        gray = self._camera.shoot(true_s, self._T_ground_cam, self._T_ground_body)
        time.sleep(max(0.0, self._camera.arrival_s(true_s) - time.time()))
        stamp_s, frame = self._camera.stamp_s(true_s), frames.gimbal_optical(self._name)
        self._infos.publish(conversions.info_from_camera(self._camera.model, stamp_s, frame))
        self._pictures.publish(conversions.array_to_image(gray, "mono8", stamp_s, frame))
        self._health.tick("pictures")
        self._loop.report()

    def _T_ground_cam(self, stamp_s: float) -> np.ndarray:
        with self._lock:
            return self._servos.T_ground_cam(stamp_s)

    def _T_ground_body(self, stamp_s: float) -> np.ndarray:
        T_ground_world = self._T_ground_world
        if self._robot is not None:
            T_ground_world = transforms.invert(self._robot.wait_for(stamp_s))
        return T_ground_world @ self._truth.at(stamp_s)


def main() -> int:
    """Run the node."""
    return node.run("sim_gimbal", GimbalNode)
