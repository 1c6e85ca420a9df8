# SPDX-License-Identifier: Apache-2.0
"""Rendered pictures of the simulated town with known depth; kept in memory for the run, nowhere on
disk."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.world.town import Town
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture

CAMERA = PinholeCamera.from_fov(640, 480, np.radians(56.0))  # thesis table 6.2
T_LEVEL = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


@dataclass(frozen=True)
class Shot:
    """A place of the other camera: axis, baseline (m), inward tilt (rad)."""

    axis: str
    baseline_m: float
    tilt_rad: float = 0.0

    @property
    def name(self) -> str:
        tilt = f" tilt {np.degrees(self.tilt_rad):g}°" if self.tilt_rad else ""
        return f"{self.axis} {self.baseline_m:g} m{tilt}"

    @property
    def T_home_cam(self) -> np.ndarray:
        """As the mission has it: to the right, or above."""
        b = self.baseline_m
        if self.axis == "horizontal":
            return transforms.from_xyz_yaw([0.0, -b, 0.0], self.tilt_rad) @ T_LEVEL
        return transforms.from_xyz_rpy([0.0, 0.0, b], [0.0, self.tilt_rad, 0.0]) @ T_LEVEL


@dataclass(frozen=True)
class Scatter:
    """Standard deviations: where the vehicle stands (m, rad) and how wrong its pose is known (share
    of b, rad)."""

    place_m: float = 0.0
    attitude_rad: float = 0.0
    pose_share: float = 0.0
    pose_rad: float = 0.0


#: The conditions of the benchmarks.
FLIGHT = Scatter(0.03, np.radians(1.0), 0.01, np.radians(0.15))


@dataclass
class Scene:
    """A town from a standpoint; ``T_world_home`` is level."""

    seed: int
    T_world_home: np.ndarray
    _renderer: Optional[Renderer] = None
    _pictures: Dict[bytes, Tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def photograph(self, T_home_cam: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Picture and true depth (m, NaN for the sky) from a pose."""
        key = np.round(T_home_cam, 9).tobytes()
        if key not in self._pictures:
            self._renderer = self._renderer or Renderer(Town.generate(self.seed))
            self._pictures[key] = self._renderer.render(self.T_world_home @ T_home_cam, CAMERA)
        return self._pictures[key]

    def poses(
        self, shots: Sequence[Shot], scatter: Scatter, seed: int
    ) -> Tuple[np.ndarray, List[Tuple]]:
        """T_home_cam of the reference, and of each shot the true one and the prior."""
        random = np.random.default_rng([self.seed, seed])
        T_reference = _scattered(T_LEVEL, scatter, random)
        others = []
        for shot in shots:
            T_true = _scattered(shot.T_home_cam, scatter, random)
            rpy = random.normal(0.0, 1.0, 3) * scatter.pose_rad
            p = random.normal(0.0, 1.0, 3) / np.sqrt(3.0) * scatter.pose_share * shot.baseline_m
            others.append((T_true, T_true @ transforms.from_xyz_rpy(p, rpy)))
        return T_reference, others

    def given(
        self, shots: Sequence[Shot], scatter: Optional[Scatter] = None, seed: int = 0
    ) -> Tuple[MapInput, np.ndarray]:
        """Input of a method, and the reference's true depth; without scatter every pose is
        exact."""
        T_reference, others = self.poses(shots, scatter or Scatter(), seed)
        image, depth = self.photograph(T_reference)
        reference = Picture("reference", "uav1", 0.0, image, CAMERA, T_reference)
        configurations = []
        for i, (shot, (T_true, prior)) in enumerate(zip(shots, others)):
            other = Picture(f"uav2/{i}", "uav2", 0.0, self.photograph(T_true)[0], CAMERA, prior)
            configuration = Configuration(shot.axis, shot.baseline_m, shot.tilt_rad, shot.name)
            configurations.append(ConfigurationInput(configuration, [reference], [other]))
        return MapInput("session", configurations), depth


@lru_cache(maxsize=1)
def city() -> Scene:
    """The demo's standpoint: a field, the town behind it, hills; up to 400 m and more. One for the
    whole study."""
    return Scene(1, transforms.from_xyz_yaw([1.0, 0.0, 8.0], 0.0))


def _scattered(T_home_cam: np.ndarray, scatter: Scatter, random: np.random.Generator) -> np.ndarray:
    p = random.normal(0.0, 1.0, 3) * scatter.place_m
    rpy = random.normal(0.0, 1.0, 3) * scatter.attitude_rad
    out = T_home_cam @ transforms.from_xyz_rpy([0.0, 0.0, 0.0], rpy)
    out[:3, 3] += p
    return out
