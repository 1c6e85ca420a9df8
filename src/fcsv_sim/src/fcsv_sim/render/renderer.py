# SPDX-License-Identifier: Apache-2.0
"""Pictures of a town, with their true depth, from any pose."""

from typing import Sequence, Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.transforms import require_rigid
from fcsv_sim.render import lens, sampling
from fcsv_sim.render.bodies import RenderedBody, draw_bodies
from fcsv_sim.render.caster import make_caster
from fcsv_sim.render.rays import T, ray_buffer, set_rays
from fcsv_sim.render.shade import shade_rays
from fcsv_sim.render.tables import build_tables
from fcsv_sim.world.town import Town

_EDGE_CONTRAST = 0.06
_MOST_SAMPLES = max(sampling.OFFSETS)
_MOST_EDGES = 0.12  # share of pixels that get extra rays, at most: bounds the time of a picture


def require_samples(samples: int) -> int:
    """The number back where it is one that a picture can be made with; else ValueError."""
    if samples not in (1, *sampling.OFFSETS):
        raise ValueError(f"samples: {samples} must be 1 (previews), 3 or 5 (antialiased edges)")
    return samples


class Renderer:
    """Holds a town's ray caster (of ``threads`` threads), tables and buffers; not thread-safe.

    ``samples``: rays per pixel where surfaces meet: 1 for previews, 3 or 5 for antialiased edges.
    """

    def __init__(self, town: Town, threads: int = 1):
        self._caster = make_caster(town.vertices, town.triangles, threads)
        self._tables = build_tables(town, self._distances)
        self._numbers = sampling.surface_numbers(*self._tables[:3])
        self._camera = None

    def render(
        self,
        T_world_cam: np.ndarray,
        camera: PinholeCamera,
        exposure: float = 1.0,
        bodies: Sequence[RenderedBody] = (),
        samples: int = 5,
    ) -> Tuple[np.ndarray, np.ndarray]:
        """rgb (H,W,3) uint8 and depth (H,W) float32: metres along the optical axis, NaN for sky."""
        values, depth = self.values(T_world_cam, camera, exposure, bodies, samples)
        return (values * 255.0 + 0.5).astype(np.uint8), depth

    def values(
        self,
        T_world_cam: np.ndarray,
        camera: PinholeCamera,
        exposure: float = 1.0,
        bodies: Sequence[RenderedBody] = (),
        samples: int = 5,
    ) -> Tuple[np.ndarray, np.ndarray]:
        """The same before it is made into bytes: float32 0..1. Raises GeometryError where the pose
        is none."""
        T_world_cam = require_rigid(T_world_cam, "T_world_cam")
        require_samples(samples)
        self._prepare(camera)
        R, p = np.ascontiguousarray(T_world_cam[:3, :3]), np.ascontiguousarray(T_world_cam[:3, 3])
        sampling.fill_rays(self._directions.reshape(-1, 3), self._order, R, p, self._rays)
        self._caster.cast(self._rays)
        values = np.empty((camera.height, camera.width, 3), np.float32)
        depth = np.empty((camera.height, camera.width), np.float32)
        self._shade(self._rays, self._all, self._order, R, exposure, values.reshape(-1, 3))
        sampling.collect(
            self._rays, self._order, self._numbers, depth.ravel(), self._surface.ravel()
        )
        if samples > 1:
            self._refine_edges(values, R, p, exposure, samples)
        draw_bodies(bodies, T_world_cam, camera, self._directions, exposure, values, depth)
        if self._dark is not None:
            values[self._dark], depth[self._dark] = 0.0, np.nan
        return values, depth

    def _prepare(self, camera: PinholeCamera) -> None:
        """What depends on the camera alone."""
        if camera == self._camera:
            return
        self._camera = camera
        rays, seen = lens.directions(camera)
        self._directions = np.ascontiguousarray(rays, np.float32)
        self._dark = None if seen.all() else ~seen
        self._order = sampling.tiled(camera.height, camera.width)
        self._all = np.arange(len(self._order), dtype=np.int32)
        self._rays = ray_buffer(len(self._order))
        self._surface = np.empty((camera.height, camera.width), np.int64)
        self._marked = np.empty((camera.height, camera.width), np.bool_)
        # kept from picture to picture: fresh pages for tens of megabytes cost a quarter of a
        # picture's time
        most = (int(_MOST_EDGES * len(self._order)) + 1) * _MOST_SAMPLES
        self._edge_rays = ray_buffer(most)
        self._source, self._wanted = np.empty(most, np.int32), np.empty(most, np.int32)
        self._extra = np.empty((most, 3), np.float32)

    def _shade(
        self,
        rays: np.ndarray,
        wanted: np.ndarray,
        places: np.ndarray,
        R_world_cam: np.ndarray,
        exposure: float,
        out: np.ndarray,
    ) -> None:
        """Picture values of what the wanted ones of cast rays hit, into rows ``places`` of
        ``out``."""
        shade_rays(
            *self._tables,
            R_world_cam,
            self._camera.fx,
            self._camera.fy,
            rays,
            wanted,
            places,
            float(exposure),
            out,
        )

    def _refine_edges(
        self, values: np.ndarray, R: np.ndarray, p: np.ndarray, exposure: float, samples: int
    ) -> None:
        """More rays where surfaces meet in different colours; the strongest edges first."""
        threshold, most = _EDGE_CONTRAST, _MOST_EDGES * self._marked.size
        while True:
            count = sampling.find_edges(values, self._surface, threshold, self._marked)
            if count <= most:
                break
            threshold *= 1.5
        offsets = sampling.OFFSETS[samples]
        each = len(offsets)
        rays, source = self._edge_rays[: count * each], self._source[: count * each]
        sampling.fill_edge_rays(self._directions, self._marked, self._order, offsets, R, p, rays)
        self._caster.cast(rays)
        new = sampling.new_surfaces(
            rays,
            self._numbers,
            self._surface,
            self._marked,
            self._order,
            each,
            source,
            self._wanted,
        )
        self._shade(rays, self._wanted[:new], self._all, R, exposure, self._extra)
        sampling.average_edges(values, self._marked, self._order, self._extra, source, each)

    def _distances(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Distances (N), in units of the directions, from origins (N,3); inf where nothing is
        hit."""
        rays = ray_buffer(len(origin))
        set_rays(rays, origin, direction)
        self._caster.cast(rays)
        return rays[:, T]
