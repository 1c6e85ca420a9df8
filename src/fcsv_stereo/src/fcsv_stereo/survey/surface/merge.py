# SPDX-License-Identifier: Apache-2.0
"""One cloud from many depths: points join along their rays, by inverse variance.

A cell is a pixel of the surest view that sees the surface, and as deep as sigma says, as in
``products.points``: a view's error grows with the square of the distance, so that no voxel of one
size fits. Each view is joined by itself, with the views that overlap it: a task of its own.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Dict, Iterable, List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Cloud, concatenate
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.placing.adjust import Placed
from fcsv_stereo.survey.views.view import View

MOST_VIEWS = 255  # a cloud's number of views is one octet
_WINDOW = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class SiteDepth:
    """The depth of a view in the site's metres: camera's ``place`` (3,) less the site's origin,
    ``R_site_cam``; ``depth`` and ``sigma`` (H,W) m, NaN where no depth counts; ``sky`` (H,W) bool,
    with all neighbours."""

    name: str
    camera: PinholeCamera
    place: np.ndarray
    R_site_cam: np.ndarray
    depth: np.ndarray
    sigma: np.ndarray
    sky: np.ndarray

    @cached_property
    def nearest(self) -> np.ndarray:
        """(H,W) the least depth of 3x3 pixels, NaN where one of them has none."""
        known = np.isfinite(self.depth)
        least = cv2.erode(np.where(known, self.depth, np.float32(0.0)), _WINDOW)
        return np.where(cv2.erode(known.astype(np.uint8), _WINDOW) > 0, least, np.nan)

    @property
    def T_site_cam(self) -> np.ndarray:
        """4x4, less the site's origin."""
        return transforms.transform(self.R_site_cam, self.place)

    def points(self) -> Tuple[np.ndarray, Tuple[np.ndarray, np.ndarray]]:
        """(N,3) m of all pixels with a depth, and their rows and columns."""
        rows, columns = np.nonzero(np.isfinite(self.depth))
        return self.place + self.rays(rows, columns) * self.depth[rows, columns][:, None], (
            rows,
            columns,
        )

    def rays(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(N,3) per metre of depth, in the site's axes."""
        c = self.camera
        ray = np.column_stack([(columns - c.cx) / c.fx, (rows - c.cy) / c.fy, np.ones(len(rows))])
        return ray @ self.R_site_cam.T

    def look(self, points: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Says, of points (N,3): whether they are in the picture, their pixels' rows and columns,
        and their depths (m)."""
        in_cam = (points - self.place) @ self.R_site_cam
        c, z = self.camera, in_cam[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.rint(in_cam[:, 0] / z * c.fx + c.cx)
            v = np.rint(in_cam[:, 1] / z * c.fy + c.cy)
            inside = (z > 0) & (u >= 0) & (u < c.width) & (v >= 0) & (v < c.height)
        return inside, np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int), z


@dataclass(frozen=True)
class SiteView(SiteDepth):
    """The same with all that its ``view`` shows."""

    view: View


def site_place(placed: Placed, origin_m: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """``place`` and ``R_site_cam`` of a view that the adjustment put there."""
    S = placed.S_site_cam
    return similarity.place(S) - origin_m, similarity.rotation(S)


def site_view(view: View, placed: Placed, origin_m: np.ndarray) -> SiteView:
    """A view where the adjustment put it. ``sigma`` is that of the depth and of what the view's
    scale, turn and place against the whole site do to it."""
    scale = placed.scale
    depth = np.where(view.known, view.depth * scale, np.nan)
    pose = tuning.POSE_SIGMA**2 * view.pose_variance(placed.relative)
    sigma = scale * np.sqrt(np.square(view.point_sigma) + pose)
    sky = cv2.erode((view.kind == DepthKind.SKY).astype(np.uint8), _WINDOW) > 0
    arrays = (depth.astype(np.float32), sigma.astype(np.float32), sky)
    return SiteView(view.name, view.camera, *site_place(placed, origin_m), *arrays, view)


@dataclass(frozen=True)
class Joined:
    """Holds the result of a view's N pixels with a depth: the cloud of those that it keeps
    (``baseline_index`` counts views), how many a surer view tells (``duplicates``), how many others
    see through (``seen_through``), and how many two views see."""

    cloud: Cloud
    duplicates: int
    seen_through: int
    agreed: int


def join_view(own: SiteView, others: Iterable[SiteDepth]) -> Joined:
    """The points of a view that no surer view tells, and that no other view sees through; one of
    the ``others`` is looked at a time."""
    points, (rows, columns) = own.points()
    sigma = own.sigma[rows, columns].astype(float)
    ray = own.rays(rows, columns)
    count = len(points)
    agreeing, through, surely_through = (
        np.ones(count, int),
        np.zeros(count, int),
        np.zeros(count, bool),
    )
    told, weight, shift = np.zeros(count, bool), 1.0 / sigma**2, np.zeros(count)
    surest = sigma.copy()
    for other in others:
        inside, v, u, z = other.look(points)
        theirs = np.where(inside, other.depth[v, u], np.nan).astype(float)
        their_sigma = other.sigma[v, u].astype(float)
        between = np.hypot(sigma, their_sigma)
        agrees = np.abs(theirs - z) <= tuning.AGREE_SIGMAS * between
        beyond = inside & (other.nearest[v, u] - z > tuning.THROUGH_SIGMAS * between)
        sky = inside & other.sky[v, u]
        # of its inverse depth, here
        at_point = their_sigma * np.square(z / np.where(theirs > 0, theirs, np.nan))
        agreeing += agrees
        through += beyond | sky
        surely_through |= sky | (beyond & (at_point < sigma))
        first = other.name < own.name
        told |= agrees & ((their_sigma < sigma) | ((their_sigma == sigma) & first))
        near = agrees & (_cosine(ray, points - other.place) > tuning.LEAST_COSINE)
        w = np.where(near, 1.0 / their_sigma**2, 0.0)
        weight += w
        shift += np.where(near, w * (theirs - z), 0.0)
        surest = np.where(near, np.minimum(surest, their_sigma), surest)
    gone = surely_through & (through >= agreeing)
    kept = ~(told | gone)
    points = points + ray * (shift / weight)[:, None]
    cloud = Cloud(
        points[kept].astype(np.float32),
        own.view.image[rows[kept], columns[kept]],
        surest[kept].astype(np.float32),  # what views have in common does not average out
        np.minimum(agreeing[kept], MOST_VIEWS).astype(np.uint8),
    )
    return Joined(cloud, int((told & ~gone).sum()), int(gone.sum()), int((agreeing > 1).sum()))


def _cosine(ray: np.ndarray, other: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(ray, axis=1) * np.linalg.norm(other, axis=1)
    return np.einsum("ni,ni->n", ray, other) / np.maximum(lengths, 1e-12)


def overlapping(own: View, views: Sequence[View], placed: Dict[str, Placed]) -> List[View]:
    """Those other ``views`` that may have a point of ``own`` in their picture: of one that is left
    out it is certain that it has none, as all corners are beyond one side of it."""
    corners = similarity.apply(placed[own.name].S_site_cam, own.corners)
    return [v for v in views if v.name != own.name and _may_contain(v, placed[v.name], corners)]


def _may_contain(other: View, placed: Placed, corners: np.ndarray) -> bool:
    if not len(corners):
        return False
    S, c = placed.S_site_cam, other.camera
    x, y, z = ((corners - similarity.place(S)) @ similarity.rotation(S)).T
    sides = (
        z,
        x * c.fx + (c.cx + 1.0) * z,
        (c.width - c.cx) * z - x * c.fx,
        y * c.fy + (c.cy + 1.0) * z,
        (c.height - c.cy) * z - y * c.fy,
    )
    return all((side > 0).any() for side in sides)


def join(
    views: Sequence[View], placed: Dict[str, Placed], origin_m: np.ndarray
) -> Tuple[Cloud, List[Joined]]:
    """The cloud (m, less ``origin_m``) of all views that have a place, and what became of each
    view's points."""
    here = [v for v in views if v.name in placed]
    at = {v.name: site_view(v, placed[v.name], origin_m) for v in here}
    parts = [
        join_view(at[v.name], [at[o.name] for o in overlapping(v, here, placed)]) for v in here
    ]
    return concatenate([p.cloud for p in parts]), parts
