# SPDX-License-Identifier: Apache-2.0
"""A column of vehicles while it is calibrated: true motion with vibration, each one's T265, and
what each camera sees of the tag in front, either as noisy corners or as rendered pictures that the
tag detector looks at."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_geometry.vehicles.vehicle import Mount, VehicleGeometry
from fcsv_sim.render.bodies import RenderedBody
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.sensors.t265 import T265
from fcsv_sim.world.town import Town
from fcsv_tracking.column.detection import Detection
from fcsv_tracking.tags import ON_BOARD_DECIMATE, TagDetector, corner_points

_STATE_EVERY = 7  # every which sample of the odometry the radio carries
_VIBRATION_HZ = np.array([23.0, 31.0, 47.0])


@dataclass(frozen=True)
class FormationParameters:
    """``vehicles`` stand ``distance_m`` behind one another; all but the last sway sideways."""

    vehicles: int = 2
    distance_m: float = 3.5
    sway_m: float = 0.8
    sway_period_s: float = 5.0
    vibration_rms_deg: float = 0.1
    height_m: float = 8.0
    picture_rate_hz: float = 5.0
    duration_s: float = 8.0
    corner_noise_px: float = 0.15
    tracker: TrackerProfile = T265_PROFILE  # what the vehicles' trackers do
    camera: CameraParameters = CameraParameters()


def formation_vehicle(number: int) -> VehicleGeometry:
    """Vehicle ``number`` (from 1) as in config/vehicles."""
    return VehicleGeometry(
        f"uav{number}",
        number,
        number,
        0.16,
        Mount((0.11, 0.0, 0.03)),
        Mount((0.06, 0.0, -0.05), (0.0, 90.0, 0.0)),
        Mount((-0.16, 0.0, 0.02), (0.0, 0.0, 180.0)),
    )


class Formation:
    """One calibration of a column, front first; the same seed gives the same flight, noise and
    pictures."""

    def __init__(self, seed: int, parameters: FormationParameters = FormationParameters()):
        self.parameters = parameters
        self.vehicles = [formation_vehicle(k + 1) for k in range(parameters.vehicles)]
        self._seed = seed
        self._random = np.random.default_rng([seed, 11])
        self._phases = self._random.uniform(0.0, 2 * np.pi, (parameters.vehicles, 9))
        self._offsets = self._random.uniform(-0.15, 0.15, (parameters.vehicles, 3))
        self._yaws = self._random.uniform(-0.05, 0.05, parameters.vehicles)
        self.tracks, self.states = self._fly()
        self._renderer: Optional[Renderer] = None

    @property
    def names(self) -> List[str]:
        return [v.name for v in self.vehicles]

    def body(self, k: int, t_s: float) -> np.ndarray:
        """True T_world_body of vehicle ``k`` (from 0)."""
        p, phase = self.parameters, self._phases[k]
        wander = 0.05 * np.sin(np.array([0.7, 0.9, 0.5]) * t_s + phase[:3])
        if k < p.vehicles - 1:  # neighbours a quarter period apart: tags stay in the picture
            wander[1] += p.sway_m * np.sin(2 * np.pi * t_s / p.sway_period_s + k * np.pi / 2)
            wander[2] += 0.2 * p.sway_m * np.sin(2 * np.pi * t_s / 4.0 + phase[3])
        tilt = 0.03 * np.sin(np.array([1.3, 1.1, 0.4]) * t_s + phase[3:6]) + [
            0.0,
            0.0,
            self._yaws[k],
        ]
        shake = np.radians(p.vibration_rms_deg) * np.sqrt(2.0 / 3.0)
        turn = tilt + shake * np.sin(2 * np.pi * _VIBRATION_HZ * t_s + phase[6:9])
        place = np.array([-k * p.distance_m, 0.0, p.height_m]) + self._offsets[k] + wander
        return transforms.from_xyz_rpy(place, turn)

    def _fly(self) -> Tuple[List[Trajectory], List[Trajectory]]:
        """T_odom_body of every vehicle: every sample of it, and the part that the radio carries."""
        tracks, states = [], []
        for k, vehicle in enumerate(self.vehicles):
            tracker = T265(self.parameters.tracker, vehicle.T_body_t265, 1000 * self._seed + k)
            T_t265_body = transforms.invert(vehicle.T_body_t265)
            whole, radio = Trajectory(gap_s=0.1), Trajectory(gap_s=0.15)
            for i in range(
                int((self.parameters.duration_s + 0.3) * self.parameters.tracker.rate_hz)
            ):
                t_s = i / self.parameters.tracker.rate_hz
                T_odom_body = tracker.odometry(t_s, self.body(k, t_s))[0] @ T_t265_body
                whole.add(t_s, T_odom_body)
                if i % _STATE_EVERY == 0:
                    radio.add(t_s, T_odom_body)
            tracks.append(whole)
            states.append(radio)
        return tracks, states

    @property
    def end_s(self) -> float:
        """Stamp of the last picture."""
        return (
            int(self.parameters.duration_s * self.parameters.picture_rate_hz) - 1
        ) / self.parameters.picture_rate_hz

    def stamps_s(self) -> np.ndarray:
        return np.arange(0, self.end_s + 1e-6, 1.0 / self.parameters.picture_rate_hz)

    def detections(self, child: int, parent: int) -> List[Detection]:
        """What ``child`` sees of the tag of ``parent``: true corners with noise."""
        camera = self.parameters.camera.model
        found = []
        for t_s in self.stamps_s():
            T_world_cam = self.body(child, t_s) @ self.vehicles[child].T_body_cam
            T_cam_tag = (
                transforms.invert(T_world_cam)
                @ self.body(parent, t_s)
                @ self.vehicles[parent].T_body_tag
            )
            p_cam = transforms.apply(T_cam_tag, corner_points(self.vehicles[parent].tag_size_m))
            uv = camera.undistorted().project(p_cam)
            if not ((uv > 2).all() and (uv < [camera.width - 3, camera.height - 3]).all()):
                continue
            uv = uv + self._random.normal(0, self.parameters.corner_noise_px, uv.shape)
            found.append(self._detection(child, parent, t_s, camera.undistorted().normalize(uv)))
        return found

    def pictures(self, child: int):
        """(stamp_s, grey picture) of the child's camera; all others are in it where they are."""
        if self._renderer is None:
            self._renderer = Renderer(Town.generate(self._seed))
        camera = SimulatedCamera(
            self._renderer,
            self.vehicles[child].T_body_cam,
            self.parameters.camera,
            100 * self._seed + child,
        )
        for t_s in self.stamps_s():
            others = [
                RenderedBody(v, self.body(k, t_s))
                for k, v in enumerate(self.vehicles)
                if k != child
            ]
            rgb = camera.shoot(t_s, self.body(child, t_s), others, samples=1).rgb
            yield t_s, cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)

    def seen(self, child: int, parent: int) -> List[Detection]:
        """What the tag detector finds of ``parent`` in the child's rendered pictures."""
        vehicle = self.vehicles[parent]
        detector = TagDetector({vehicle.tag_id: vehicle.tag_size_m}, ON_BOARD_DECIMATE, sharp=True)
        camera = self.parameters.camera.model
        return [
            self._detection(child, parent, t_s, tag.corners_normalized)
            for t_s, gray in self.pictures(child)
            for tag in detector.detect(gray, camera)
        ]

    def _detection(
        self, child: int, parent: int, t_s: float, corners_normalized: np.ndarray
    ) -> Detection:
        T_odom_cam = self.tracks[child].at(t_s) @ self.vehicles[child].T_body_cam
        T_odom_tag = self.states[parent].at(t_s) @ self.vehicles[parent].T_body_tag
        focal_px = self.parameters.camera.model.fx
        return Detection(
            t_s,
            corners_normalized,
            self.vehicles[parent].tag_size_m,
            focal_px,
            T_odom_cam,
            T_odom_tag,
        )

    def relative(self, T_O1_On: Dict[str, np.ndarray], k: int) -> Tuple[np.ndarray, np.ndarray]:
        """Estimated and true T_D1_Dn (first vehicle's body to the k-th's) at the end, from T_O1_On
        by name."""
        try:
            T_O1_D1, T_On_Dn = self.tracks[0].at(self.end_s), self.tracks[k].at(self.end_s)
        except PoseUnavailable as error:  # the flight goes on beyond the last picture
            raise AssertionError(str(error)) from error
        estimated = transforms.invert(T_O1_D1) @ T_O1_On[self.names[k]] @ T_On_Dn
        return estimated, transforms.invert(self.body(0, self.end_s)) @ self.body(k, self.end_s)
