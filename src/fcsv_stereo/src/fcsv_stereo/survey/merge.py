# SPDX-License-Identifier: Apache-2.0
"""One cloud from many depths: points join along their rays, by inverse variance.

A cell is a pixel of the surest view that sees the surface, and as deep as sigma says, as in
``products.points``: a view's error grows with the square of the distance, so that no voxel of one
size fits. Each view is joined by itself, with the views that overlap it: a task of its own.
"""

from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.model import Cloud, concatenate
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.adjust import Placed
from fcsv_stereo.survey.views import View

MOST_VIEWS = 255  # a cloud's number of views is one octet
_WINDOW = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class SiteView:
    """A view in the site's metres: camera's ``place`` (3,) less the site's origin, ``R_site_cam``;
    ``depth`` and ``sigma`` (H,W) m, NaN where no depth counts; ``nearest`` (H,W) the least depth of
    3x3 pixels, NaN where one of them has none; ``sky`` (H,W) bool, with all neighbours."""

    view: View
    place: np.ndarray
    R_site_cam: np.ndarray
    depth: np.ndarray
    sigma: np.ndarray
    nearest: np.ndarray
    sky: np.ndarray

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
        c = self.view.camera
        ray = np.column_stack([(columns - c.cx) / c.fx, (rows - c.cy) / c.fy, np.ones(len(rows))])
        return ray @ self.R_site_cam.T

    def look(self, points: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Says, of points (N,3): whether they are in the picture, their pixels' rows and columns,
        and their depths (m)."""
        in_cam = (points - self.place) @ self.R_site_cam
        c, z = self.view.camera, in_cam[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.rint(in_cam[:, 0] / z * c.fx + c.cx)
            v = np.rint(in_cam[:, 1] / z * c.fy + c.cy)
            inside = (z > 0) & (u >= 0) & (u < c.width) & (v >= 0) & (v < c.height)
        return inside, np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int), z


def site_view(view: View, placed: Placed, origin_m: np.ndarray) -> SiteView:
    """A view where the adjustment put it. ``sigma`` is that of the depth and of the view's scale,
    turn and place against the datum."""
    scale = placed.scale
    depth = np.where(view.known, view.depth * scale, np.nan)
    C = placed.relative
    pose = scale**2 * np.trace(C[3:6, 3:6]) / 3.0 + np.square(depth) * (
        C[6, 6] + np.trace(C[:3, :3]) / 3.0
    )
    sigma = np.sqrt(np.square(view.own_sigma * scale) + pose)
    known = np.isfinite(depth).astype(np.uint8)
    least = cv2.erode(np.where(known, depth, 0.0).astype(np.float32), _WINDOW)
    nearest = np.where(cv2.erode(known, _WINDOW) > 0, least, np.nan)
    sky = cv2.erode((view.kind == DepthKind.SKY).astype(np.uint8), _WINDOW) > 0
    place = similarity.place(placed.S_site_cam) - origin_m
    R = similarity.rotation(placed.S_site_cam)
    return SiteView(
        view, place, R, depth.astype(np.float32), sigma.astype(np.float32), nearest, sky
    )


@dataclass(frozen=True)
class Joined:
    """Holds the result of a view's N pixels with a depth: the cloud of those that it keeps
    (``baseline_index`` counts views), how many a surer view tells (``duplicates``), how many others
    see through (``seen_through``), and how many two views see."""

    cloud: Cloud
    duplicates: int
    seen_through: int
    agreed: int


def join_view(own: SiteView, others: Sequence[SiteView]) -> Joined:
    """The points of a view that no surer view tells, and that no other view sees through."""
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
        first = other.view.name < own.view.name
        told |= agrees & ((their_sigma < sigma) | ((their_sigma == sigma) & first))
        near = agrees & (_cosine(ray, points - other.place) > tuning.LEAST_COSINE)
        w = np.where(near, 1.0 / their_sigma**2, 0.0)
        weight += w
        shift += np.where(near, w * (theirs - z), 0.0)
        surest = np.where(near, np.minimum(surest, their_sigma), surest)
    gone = surely_through & (through >= agreeing)
    kept = ~(told | gone)
    joined = np.maximum(1.0 / np.sqrt(weight), tuning.LEAST_JOINED * surest)
    joined = np.where(agreeing > 1, joined, sigma)
    points = points + ray * (shift / weight)[:, None]
    cloud = Cloud(
        points[kept].astype(np.float32),
        own.view.image[rows[kept], columns[kept]],
        joined[kept].astype(np.float32),
        np.minimum(agreeing[kept], MOST_VIEWS).astype(np.uint8),
    )
    return Joined(cloud, int((told & ~gone).sum()), int(gone.sum()), int((agreeing > 1).sum()))


def _cosine(ray: np.ndarray, other: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(ray, axis=1) * np.linalg.norm(other, axis=1)
    return np.einsum("ni,ni->n", ray, other) / np.maximum(lengths, 1e-12)


def corners_of(own: SiteView) -> np.ndarray:
    """(8,3) m, the corners of the box that holds a view's points; (0,3) where it has none."""
    points = own.points()[0]
    if not len(points):
        return np.zeros((0, 3))
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )


def may_contain(other: SiteView, corners: np.ndarray) -> bool:
    """Whether a view may have something of a box (8,3) in its picture: False is certain, as all
    corners are then beyond one side of it."""
    if not len(corners):
        return False
    x, y, z = ((corners - other.place) @ other.R_site_cam).T
    c = other.view.camera
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
    in_site = [site_view(v, placed[v.name], origin_m) for v in views if v.name in placed]
    boxes = [corners_of(own) for own in in_site]
    parts = [
        join_view(own, [o for o in in_site if o is not own and may_contain(o, box)])
        for own, box in zip(in_site, boxes)
    ]
    return concatenate([p.cloud for p in parts]), parts
