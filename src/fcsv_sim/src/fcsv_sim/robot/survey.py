# SPDX-License-Identifier: Apache-2.0
"""A place as two vehicles map it: pictures drawn at stations around it, mapped by the method
``joint``."""

from dataclasses import dataclass, replace
from typing import List, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.views import DepthView
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.place import PlacePlan
from fcsv_sim.world.town import Town
from fcsv_stereo.errors import StereoError
from fcsv_stereo.joint.method import JointOptions, map_joint
from fcsv_stereo.model import (
    Configuration,
    ConfigurationInput,
    MapInput,
    Picture,
    PosePrior,
    silent,
)

BASELINES_M = (2.0, 4.0, 6.0)
# the nearest ground that a camera sees from 10 m lies 25 m ahead
HEIGHT_M, STAND_OFF_M = 10.0, 24.0
_PLACE_SIGMA_M, _ATTITUDE_SIGMA_RAD = 0.03, np.radians(1.0)
#: of a pose before refinement: rotation per axis (rad), position per axis over the baseline
_PRIOR = PosePrior(np.radians(0.15), 0.0, 0.01 / np.sqrt(3.0))
_T_BODY_CAM = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


@dataclass(frozen=True)
class HoverStation:
    """Where the reference vehicle holds: x, y, z (m, world), and its yaw."""

    xyz_m: Tuple[float, float, float]
    yaw_rad: float


def stations(plan: PlacePlan) -> List[HoverStation]:
    """One on each of four sides, so that what a wall hides from one is seen from another; to 40 m
    the four cover a place of 36 m."""
    x0, x1, y0, y1 = plan.area_m
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    sides = [
        (x0 - STAND_OFF_M, y),
        (x, y0 - STAND_OFF_M),
        (x, y1 + STAND_OFF_M),
        (x1 + STAND_OFF_M, y),
    ]
    yaws = (0.0, np.pi / 2, -np.pi / 2, np.pi)
    return [
        HoverStation((*at, float(plan.height(*at)) + HEIGHT_M), yaw) for at, yaw in zip(sides, yaws)
    ]


def survey(town: Town, places: Sequence[HoverStation], seed: int) -> List[DepthView]:
    """The maps of the stations as depth views; the reference camera's pose is its true one, the
    others' are priors with noise. A station where nothing matched is left out."""
    renderer, views = Renderer(town), []
    for number, place in enumerate(places):
        given = _pictures(renderer, place, seed, number)
        try:
            found = map_joint(given, JointOptions(), silent)
        except StereoError:
            continue
        r = found.reference
        name = f"station {number}"
        views.append(
            DepthView(name, found.depth, found.sigma, found.kind, r.camera.K, r.T_home_cam, 0.0)
        )
    return views


def _pictures(renderer: Renderer, place: HoverStation, seed: int, number: int) -> MapInput:
    random = np.random.default_rng([seed, number, 8])
    parameters = CameraParameters(distortion=(0.0, 0.0, 0.0, 0.0, 0.0), mount_deg=0.0)
    camera = SimulatedCamera(renderer, _T_BODY_CAM, parameters, 10 * seed + number)
    T_world_station = transforms.from_xyz_yaw(place.xyz_m, place.yaw_rad)

    def photographed(stamp_s: float, left_m: float, name: str, vehicle: str) -> Picture:
        off = np.array([0.0, left_m, 0.0]) + random.normal(0.0, _PLACE_SIGMA_M, 3)
        T = transforms.from_xyz_rpy(off, random.normal(0.0, _ATTITUDE_SIGMA_RAD, 3))
        shot = camera.shoot(stamp_s, T_world_station @ T)
        return Picture(name, vehicle, 0.0, shot.rgb, camera.model, shot.T_world_cam)

    reference = photographed(0.0, 0.0, "uav1/reference", "uav1")
    configurations = []
    for i, baseline_m in enumerate(BASELINES_M, 1):
        other = photographed(float(i), -baseline_m, f"uav2/{baseline_m:g} m", "uav2")
        off = random.normal(0.0, _PRIOR.position_sigma_m(baseline_m), 3)
        error = transforms.from_xyz_rpy(off, random.normal(0.0, _PRIOR.rotation_rad, 3))
        other = replace(other, T_home_cam=other.T_home_cam @ error)
        configuration = Configuration("horizontal", baseline_m, 0.0, other.name)
        configurations.append(ConfigurationInput(configuration, [reference], [other]))
    return MapInput("session", configurations, prior=_PRIOR)
