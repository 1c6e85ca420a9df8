# SPDX-License-Identifier: Apache-2.0
"""Scenes of the bench: pictures of the simulated worlds with true depth and poses, and priors with
noise."""

import zlib
from dataclasses import dataclass, replace
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.town import Town
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture, PosePrior

FOV_DEG = 56.0  # f = 602 px at a width of 640
T_WORLD_HOME = transforms.from_xyz_yaw([1.0, 0.0, 8.0], 0.0)
R_BODY_CAM = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
PLACE_SIGMA_M, ATTITUDE_SIGMA_RAD = 0.03, np.radians(1.0)

Baselines = Sequence[Tuple[str, float]]
HORIZONTAL: Baselines = [("horizontal", b) for b in (2.0, 4.0, 6.0, 8.0)]
VERTICAL: Baselines = [("vertical", b) for b in (5.0, 7.0, 10.0)]
LISTS: Dict[str, Baselines] = {
    "H 2, 4, 6, 8 m": HORIZONTAL,
    "and V 5, 7, 10 m": [*HORIZONTAL, *VERTICAL],
}


@dataclass(frozen=True)
class SceneName:
    """A kind of world and its seed."""

    world: str
    seed: int

    def __str__(self) -> str:
        return f"{self.world} {self.seed}"

    def words(self) -> Tuple[int, int]:
        """Numbers that seed what is random in it."""
        return zlib.crc32(self.world.encode()), self.seed


SCENES = [
    SceneName(*s)
    for s in (
        ("street", 1),
        ("street", 2),
        ("village", 1),
        ("village", 2),
        ("field", 1),
        ("field", 2),
        ("plain", 1),
        ("plain", 2),
    )
]


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviations of a prior: rotation per axis (rad), position (its three axes together)
    over baseline."""

    rotation_rad: float
    share: float

    @property
    def prior(self) -> PosePrior:
        """Per axis."""
        return PosePrior(self.rotation_rad, 0.0, self.share / np.sqrt(3.0))

    def __str__(self) -> str:
        return f"{np.degrees(self.rotation_rad):g}° and {self.share:.0%}"


NOISES = (PoseNoise(np.radians(0.15), 0.01), PoseNoise(np.radians(0.5), 0.03))


@dataclass(frozen=True)
class Scene:
    """``reference`` has its true pose; so have ``others`` (by list order), until noise is put on
    them.

    ``true_depth`` is (H,W) float32 of the reference (m along the optical axis, NaN for sky).
    """

    name: SceneName
    baselines: Baselines
    reference: Picture
    others: List[Picture]
    true_depth: np.ndarray
    depths: Dict[str, np.ndarray]  # of every picture, by name

    def given(self, baselines: Baselines, noise: PoseNoise) -> MapInput:
        """A session of these baselines with noise on every pose but the reference's; always the
        same noise.

        It states the noise's standard deviations, as trackers do.
        """
        random = np.random.default_rng([*self.name.words(), round(noise.rotation_rad * 1e6), 7])
        drawn = [random.standard_normal(6) for _ in self.others]
        configurations = []
        for (axis, baseline_m), other, deviates in zip(self.baselines, self.others, drawn):
            if (axis, baseline_m) not in baselines:
                continue
            position_m = deviates[:3] * noise.prior.position_sigma_m(baseline_m)
            error = transforms.from_xyz_rpy(position_m, deviates[3:] * noise.rotation_rad)
            picture = replace(other, T_home_cam=other.T_home_cam @ error)
            configuration = Configuration(axis, baseline_m, 0.0, other.name)
            configurations.append(ConfigurationInput(configuration, [self.reference], [picture]))
        return MapInput("session", configurations, prior=noise.prior)

    def true_poses(self) -> Dict[str, np.ndarray]:
        """True T_home_cam by picture."""
        return {p.name: p.T_home_cam for p in (self.reference, *self.others)}


def shoot(name: SceneName, baselines: Baselines, size=(640, 480), clean: bool = False) -> Scene:
    """Render a scene: places scattered by 3 cm and 1 degree; ``clean`` leaves the sensor's noise
    and lens out."""
    random = np.random.default_rng([*name.words(), 3])
    camera = camera_in(name, size, clean)

    def take(number: int, xyz):
        p = np.asarray(xyz) + random.normal(0.0, PLACE_SIGMA_M, 3)
        T_home_body = transforms.from_xyz_rpy(p, random.normal(0.0, ATTITUDE_SIGMA_RAD, 3))
        shot = camera.shoot(float(number), T_WORLD_HOME @ T_home_body)
        return shot.rgb, shot.depth, transforms.invert(T_WORLD_HOME) @ shot.T_world_cam

    image, depth, T_home_cam = take(0, [0.0, 0.0, 0.0])
    reference = Picture("uav1/reference", "uav1", 0.0, image, camera.model, T_home_cam)
    others, depths = [], {reference.name: depth}
    for number, (axis, b) in enumerate(baselines, 1):
        image, seen, T_home_cam = take(
            number, [0.0, -b, 0.0] if axis == "horizontal" else [0.0, 0.0, b]
        )
        others.append(Picture(f"uav2/{axis} {b:g} m", "uav2", 0.0, image, camera.model, T_home_cam))
        depths[others[-1].name] = seen
    return Scene(name, baselines, reference, others, depth, depths)


def camera_in(name: SceneName, size=(640, 480), clean: bool = False) -> SimulatedCamera:
    """The simulator's camera in a scene's world, its lens already undistorted; ``clean`` without
    noise and blur."""
    renderer = Renderer(Town.generate(name.seed, name.world))
    parameters = CameraParameters(
        width=size[0],
        height=size[1],
        horizontal_fov_deg=FOV_DEG,
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
        mount_deg=0.0,
    )
    if clean:
        parameters = replace(
            parameters, read_noise=0.0, shot_noise=0.0, blur_px=0.0, vignetting=0.0
        )
    return SimulatedCamera(renderer, R_BODY_CAM, parameters, name.seed)


def smaller(given: MapInput, factor: int) -> MapInput:
    """The same with pictures ``factor`` times smaller: to compile and warm up with."""
    import cv2

    def shrink(p: Picture) -> Picture:
        c = p.camera
        width, height = c.width // factor, c.height // factor
        image = cv2.resize(p.image, (width, height), interpolation=cv2.INTER_AREA)
        at = [(c.cx + 0.5) / factor - 0.5, (c.cy + 0.5) / factor - 0.5]
        return replace(
            p, image=image, camera=PinholeCamera(width, height, c.fx / factor, c.fy / factor, *at)
        )

    configurations = [
        replace(
            c, references=[shrink(p) for p in c.references], others=[shrink(p) for p in c.others]
        )
        for c in given.configurations
    ]
    return replace(given, configurations=configurations)
