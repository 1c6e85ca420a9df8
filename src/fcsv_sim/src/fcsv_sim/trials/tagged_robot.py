# SPDX-License-Identifier: Apache-2.0
"""A robot with tags on its sides before a vehicle's camera: drawn pictures, the detector on board,
and what is believed of the vehicle's pose."""

from dataclasses import dataclass
from typing import Sequence

import cv2
import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.vehicles.telemetry import SeenTag
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_guidance.place.tag_fix import RobotSight
from fcsv_sim.render.bodies import BoxedThing
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.movers import ROBOT, ball_radius_m, placed_boxes
from fcsv_sim.world.town import Town
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.tags import ON_BOARD_DECIMATE, TagDetector


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviations of where a vehicle's camera is taken to be, about home's axes."""

    position_m: float = 0.05
    level_deg: float = 0.3  # roll, pitch
    yaw_deg: float = 0.5

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6), as camera_pose has it."""
        level, yaw = np.radians([self.level_deg, self.yaw_deg])
        return np.diag(np.square([self.position_m] * 3 + [level, level, yaw]))

    def error(self, random: np.random.Generator) -> np.ndarray:
        """(6,) drawn of the covariance."""
        return np.sqrt(np.diag(self.covariance)) * random.standard_normal(6)


class TagViewer:
    """A vehicle whose simulated camera looks at the robot in ``town``."""

    def __init__(
        self,
        town: Town,
        vehicle: VehicleGeometry,
        tags: Sequence[BodyTag],
        seed: int,
        noise: PoseNoise = PoseNoise(),
    ):
        self.vehicle, self._tags, self._noise = vehicle, tuple(tags), noise
        self._boxes = placed_boxes()[ROBOT]
        self._radius_m = max(
            [ball_radius_m(self._boxes), *(t.mount.xyz_m[2] + t.size_m for t in tags)]
        )
        parameters = CameraParameters()
        self._camera = SimulatedCamera(Renderer(town), vehicle.T_body_cam, parameters, seed)
        self._detector = TagDetector({t.id: t.size_m for t in tags}, ON_BOARD_DECIMATE, sharp=True)
        cv2.setNumThreads(1)

    def picture(self, stamp_s: float, T_world_body: np.ndarray, T_world_robot: np.ndarray):
        """The shot of a moment."""
        thing = BoxedThing(self._boxes, T_world_robot, self._radius_m, self._tags)
        return self._camera.shoot(stamp_s, T_world_body, [thing], samples=3)

    def look(
        self, stamp_s: float, T_world_body: np.ndarray, T_world_robot: np.ndarray, error: np.ndarray
    ) -> RobotSight:
        """What the vehicle tells of a picture; ``error`` (6,) of its own pose, world's axes."""
        shot = self.picture(stamp_s, T_world_body, T_world_robot)
        grey = cv2.cvtColor(shot.rgb, cv2.COLOR_RGB2GRAY)
        T = shot.T_world_cam
        believed = transforms.transform(rotations.exp(error[3:]) @ T[:3, :3], T[:3, 3] + error[:3])
        seen = [
            SeenTag(o.id, o.size_m, o.corners_normalized, o.T_cam_tag[:3, 3])
            for o in self._detector.detect(grey, self._camera.model)
        ]
        focal_px = self._camera.model.fx
        covariance = self._noise.covariance
        return RobotSight(self.vehicle.name, stamp_s, believed, covariance, focal_px, seen)
