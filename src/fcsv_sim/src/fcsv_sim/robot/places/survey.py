# SPDX-License-Identifier: Apache-2.0
"""A place as two vehicles map it: pictures drawn at stations around it, mapped by the method
``joint``."""

from dataclasses import dataclass, field, replace
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.ground.views import DepthView
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

# the nearest ground that a camera sees from 10 m lies 25 m ahead
HEIGHT_M, STAND_OFF_M = 10.0, 24.0
_T_BODY_CAM = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


@dataclass(frozen=True, eq=False)
class SurveyRules:
    """What two vehicles map with: their ``camera`` and ``T_body_cam`` 4x4, ``baselines_m`` to the
    right of the reference, how far they hold off their places (standard deviations per axis), and
    ``prior``: how well poses are known before they are refined."""

    camera: CameraParameters = CameraParameters(distortion=(0.0, 0.0, 0.0, 0.0, 0.0), mount_deg=0.0)
    T_body_cam: np.ndarray = field(default_factory=lambda: _T_BODY_CAM)
    baselines_m: Tuple[float, ...] = (2.0, 4.0, 6.0)
    place_sigma_m: float = 0.03
    attitude_sigma_rad: float = np.radians(1.0)
    # rotation per axis (rad), position per axis over the baseline
    prior: PosePrior = PosePrior(np.radians(0.15), 0.0, 0.01 / np.sqrt(3.0))


SURVEY = SurveyRules()  # of System III


@dataclass(frozen=True)
class HoverStation:
    """Where the reference vehicle holds: x, y, z (m, world), and its yaw."""

    xyz_m: Tuple[float, float, float]
    yaw_rad: float

    @property
    def T_world_body(self) -> np.ndarray:
        return transforms.from_xyz_yaw(self.xyz_m, self.yaw_rad)

    def beside(self, right_m: float) -> "HoverStation":
        """The same so far to the right."""
        off = np.array([np.sin(self.yaw_rad), -np.cos(self.yaw_rad), 0.0]) * right_m
        return replace(self, xyz_m=tuple(float(v) for v in self.xyz_m + off))


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


#: The 4x4 pose of a camera that its tracker tells, of the vehicle's number (0: the reference) and
#: the true pose; both in the world.
TrackedPose = Callable[[int, np.ndarray], np.ndarray]


def survey(
    town: Town,
    places: Sequence[HoverStation],
    seed: int,
    rules: SurveyRules = SURVEY,
    tracked: Optional[TrackedPose] = None,
) -> List[DepthView]:
    """The maps of the stations as depth views. Without ``tracked`` the reference camera's pose is its
    true one, the others' are priors with noise. A station where nothing matched is left out."""
    renderer, views = Renderer(town), []
    for number, place in enumerate(places):
        given = _pictures(renderer, place, seed, number, rules, tracked)
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


def _pictures(
    renderer: Renderer,
    place: HoverStation,
    seed: int,
    number: int,
    rules: SurveyRules,
    tracked: Optional[TrackedPose],
) -> MapInput:
    random = np.random.default_rng([seed, number, 8])
    camera = SimulatedCamera(renderer, rules.T_body_cam, rules.camera, 10 * seed + number)

    def photographed(stamp_s: float, left_m: float, name: str, vehicle: str) -> Picture:
        off = np.array([0.0, left_m, 0.0]) + random.normal(0.0, rules.place_sigma_m, 3)
        T = transforms.from_xyz_rpy(off, random.normal(0.0, rules.attitude_sigma_rad, 3))
        shot = camera.shoot(stamp_s, place.T_world_body @ T)
        return Picture(name, vehicle, 0.0, shot.rgb, camera.model, shot.T_world_cam)

    reference = photographed(0.0, 0.0, "uav1/reference", "uav1")
    configurations = []
    for i, baseline_m in enumerate(rules.baselines_m, 1):
        other = photographed(float(i), -baseline_m, f"uav2/{baseline_m:g} m", "uav2")
        if tracked is None:
            off = random.normal(0.0, rules.prior.position_sigma_m(baseline_m), 3)
            error = transforms.from_xyz_rpy(off, random.normal(0.0, rules.prior.rotation_rad, 3))
            T_home_cam = other.T_home_cam @ error
        else:
            T_home_cam = tracked(1, other.T_home_cam)
        other = replace(other, T_home_cam=T_home_cam)
        configuration = Configuration("horizontal", baseline_m, 0.0, other.name)
        configurations.append((configuration, other))
    if tracked is not None:
        reference = replace(reference, T_home_cam=tracked(0, reference.T_home_cam))
    inputs = [ConfigurationInput(c, [reference], [other]) for c, other in configurations]
    return MapInput("session", inputs, prior=rules.prior)
