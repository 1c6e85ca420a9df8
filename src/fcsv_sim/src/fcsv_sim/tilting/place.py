# SPDX-License-Identifier: Apache-2.0
"""Farmland with the thin things in it, pictures of them with their true depth, and which pixels are
theirs."""

from dataclasses import dataclass, field, replace
from typing import Dict, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.caster import make_caster
from fcsv_sim.render.rays import T, ray_buffer, set_rays
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.tilting.things import BEHIND, THINGS
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.town import WORLDS, Town

_SEED = 3
#: Where each thing stands in the world (m): far enough from the others that none is in another's
#: pictures.
_AT = {"lines": (11.0, 0.0, 8.0), "valve": (11.0, -40.0, 1.4), "branch": (11.0, 40.0, 3.0)}
_SAME_DEPTH_M = 2e-3


@dataclass(frozen=True)
class RenderedView:
    """A picture (H,W,3 uint8 RGB), its true depth (H,W float32, m, NaN for the sky), and which
    pixels are the thing's (H,W bool)."""

    image: np.ndarray
    depth: np.ndarray
    thing: np.ndarray


@dataclass
class TiltingPlace:
    """The world, made once; ``seed`` is of the noise of pictures."""

    seed: int = 1
    _renderer: Renderer = field(init=False)
    _things: Dict[str, object] = field(init=False)

    def __post_init__(self):
        mesh, self._things = MeshBuilder(), {}
        plan = WORLDS["field"](mesh, np.random.default_rng([_SEED, 1]))
        for name, thing in THINGS.items():
            at = np.array(_AT[name])
            alone = MeshBuilder()
            thing(alone, at)
            thing(mesh, at)
            if name in BEHIND:
                BEHIND[name](mesh, at)
            vertices, triangles, *_ = alone.build()
            self._things[name] = make_caster(vertices, triangles)
        self._renderer = Renderer(Town(_SEED, plan, *mesh.build()))

    def T_world_rig(self, thing: str, distance_m: float) -> np.ndarray:
        """A level rig (x forward) ``distance_m`` before the middle of a thing. Raises
        SimulationError on neither."""
        if thing not in THINGS:
            raise SimulationError(f"thing '{thing}' is not one of {', '.join(THINGS)}")
        if not 0.1 <= distance_m <= 11.0:
            raise SimulationError(
                f"distance of {distance_m} m is not in 0.1 to 11 m, where the field is free"
            )
        x, y, z = _AT[thing]
        return transforms.transform(np.eye(3), [x - distance_m, y, z])

    def photograph(
        self, thing: str, T_world_cam: np.ndarray, camera: PinholeCamera, number: int = 0
    ) -> RenderedView:
        """Takes a picture as a camera with noise, blur and vignetting takes it; ``number``
        distinguishes noises."""
        sensor = _Sensor(self._renderer, camera, self.seed * 1000 + number)
        image, depth = sensor.shoot(T_world_cam)
        alone = self.depth_of(thing, T_world_cam, camera)
        with np.errstate(invalid="ignore"):
            return RenderedView(image, depth, np.abs(alone - depth) < _SAME_DEPTH_M)

    def depth_of(self, thing: str, T_world_cam: np.ndarray, camera: PinholeCamera) -> np.ndarray:
        """(H,W) m along the optical axis of the thing alone, infinite elsewhere."""
        directions = (camera.rays() @ T_world_cam[:3, :3].T).reshape(-1, 3)
        rays = ray_buffer(len(directions))
        set_rays(rays, np.broadcast_to(T_world_cam[:3, 3], directions.shape), directions)
        self._things[thing].cast(rays)
        return rays[:, T].reshape(camera.height, camera.width).copy()

    def shown(
        self, thing: str, T_world_cam: np.ndarray, camera: PinholeCamera, radius_m: float
    ) -> Tuple[int, int]:
        """How many pixels of the part within ``radius_m`` of the thing's middle the picture shows,
        and how many it would show if it were twice as wide and high."""
        wide = replace(
            camera,
            width=2 * camera.width,
            height=2 * camera.height,
            cx=camera.cx + camera.width / 2,
            cy=camera.cy + camera.height / 2,
        )
        near = self.near(
            thing, self.depth_of(thing, T_world_cam, wide), T_world_cam, wide, radius_m
        )
        h, w = camera.height // 2, camera.width // 2
        return int(near[h : h + camera.height, w : w + camera.width].sum()), int(near.sum())

    def near(
        self,
        thing: str,
        depth: np.ndarray,
        T_world_cam: np.ndarray,
        camera: PinholeCamera,
        radius_m: float,
    ) -> np.ndarray:
        """(H,W) bool: which depths lie within ``radius_m`` of the thing's middle."""
        with np.errstate(invalid="ignore"):
            points = transforms.apply(T_world_cam, camera.rays() * depth[..., None])
            return np.isfinite(depth) & (np.linalg.norm(points - _AT[thing], axis=-1) <= radius_m)


class _Sensor(SimulatedCamera):
    """The simulated camera with another lens, its exposure set by a first picture that nobody
    keeps."""

    def __init__(self, renderer: Renderer, camera: PinholeCamera, seed: int):
        f = CameraParameters(
            width=camera.width, height=camera.height, mount_deg=0.0, exposure_lag_s=0.0
        )
        super().__init__(renderer, np.eye(4), f, seed)
        self.model = camera

    def shoot(self, T_world_cam: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:  # type: ignore[override]
        """Picture and true depth."""
        super().shoot(0.0, T_world_cam, samples=1)
        shot = super().shoot(1.0, T_world_cam)
        return shot.rgb, shot.depth
