# SPDX-License-Identifier: Apache-2.0
"""The geometry of the plane sweep: how pixels of the reference move in the other pictures with
inverse depth."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Callable, Dict, Iterable, List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint.tuning import VIEWS
from fcsv_stereo.model import Picture, as_grey, as_rgb

# how finely what is smooth is sampled: points across and down, inverse depths
_GRID, _SAMPLES, _TOP_SAMPLES = (17, 13), 192, 128


@dataclass(frozen=True)
class Views:
    """Grey pictures at one scale and how they see the reference's pixels.

    ``reference`` is HxW float32; ``others`` NxHoxWo float32 (the largest size, ``sizes`` Nx2 holds
    each one's height and width). ``projections`` is Nx12 float32: a 3x3 matrix A by rows and a
    vector b, so that the reference's pixel (u, v) at inverse depth w (1/m) is at ``A @ [u, v, 1] +
    w b`` (homogeneous) in the other picture. ``falling`` (3,) says how level planes lie: one at
    height h (m) under the reference has inverse depth ``falling @ [u, v, 1] / h``.
    """

    reference: np.ndarray
    others: np.ndarray
    sizes: np.ndarray
    projections: np.ndarray
    falling: np.ndarray

    @property
    def shape(self) -> Tuple[int, int]:
        return self.reference.shape

    @property
    def falls(self) -> np.ndarray:
        """(H,) by how much the rays of the rows' middles fall per metre of depth; not above 0 above
        the horizon."""
        height, width = self.shape
        return self.falling @ np.stack(
            [np.full(height, (width - 1) / 2), np.arange(height), np.ones(height)]
        )

    @cached_property
    def fastest_px_m(self) -> float:
        """Says by how many pixels a pixel moves per 1/m of inverse depth in the pair in which it
        moves fastest (px m)."""
        return float(np.hypot(self.projections[:, 9], self.projections[:, 10]).max())

    @cached_property
    def _made(self) -> Dict[str, np.ndarray]:
        return {}

    def once(self, name: str, make: Callable[[], np.ndarray]) -> np.ndarray:
        """What ``make`` gives of the reference, made once and kept with it."""
        if name not in self._made:
            self._made[name] = make()
        return self._made[name]

    def __len__(self) -> int:
        return len(self.others)

    def only(self, pair: int) -> "Views":
        """The same of one pair."""
        one = slice(pair, pair + 1)
        return replace(
            self, others=self.others[one], sizes=self.sizes[one], projections=self.projections[one]
        )

    def rows(self, rows: slice) -> "Views":
        """The same pictures with a part of the reference's rows."""
        projections, falling = self.projections.copy(), self.falling.copy()
        projections[:, 2:9:3] += projections[:, 1:9:3] * np.float32(rows.start)
        falling[2] += falling[1] * rows.start
        reference = np.ascontiguousarray(self.reference[rows])
        return replace(self, reference=reference, projections=projections, falling=falling)

    def with_poses(self, reference: Picture, others: Sequence[Picture]) -> "Views":
        """The same pictures from where ``others`` now say that they were taken."""
        return replace(self, projections=projections(reference, others, self.shape, self.sizes))


def grey(picture: Picture) -> np.ndarray:
    """HxW float32, 0 to 255."""
    return as_grey(picture.image).astype(np.float32)


def colours(picture: Picture, shape: Tuple[int, int], kind=np.float32) -> np.ndarray:
    """HxWx3 float32, or of another ``kind`` of signed number, at a reduced size, 0 to 255."""
    return cv2.resize(as_rgb(picture.image), shape[::-1], interpolation=cv2.INTER_AREA).astype(kind)


def views(
    reference: Picture, others: Sequence[Picture], scale: float, greys: Iterable[np.ndarray]
) -> Views:
    """Makes the views at ``scale`` of the full size; ``greys`` are the full-size grey pictures, the
    reference's first, taken one by one."""
    small = (_resize(g, scale) for g in greys)
    first = next(small)
    sizes = np.array([_size(o.image.shape[:2], scale) for o in others], np.int64).reshape(-1, 2)
    stack = np.zeros((len(others), *sizes.max(axis=0)), np.float32)
    for s, g in zip(stack, small):
        s[: g.shape[0], : g.shape[1]] = g
    K = camera_matrix(reference.camera, first.shape)
    falling = -reference.T_home_cam[2, :3] @ np.linalg.inv(K)
    return Views(first, stack, sizes, projections(reference, others, first.shape, sizes), falling)


def projections(
    reference: Picture, others: Sequence[Picture], shape: Tuple[int, int], sizes: np.ndarray
) -> np.ndarray:
    """Nx12 float32 as ``Views`` has them, of pictures resized to ``shape`` (the reference) and
    ``sizes`` (Nx2)."""
    K = camera_matrix(reference.camera, shape)
    each = [
        projection(reference, o, K, camera_matrix(o.camera, tuple(size)))
        for o, size in zip(others, sizes)
    ]
    return np.array(each, np.float32).reshape(-1, 12)


def projection(
    reference: Picture, other: Picture, K_reference: np.ndarray, K_other: np.ndarray
) -> np.ndarray:
    """(12,) A and b of ``Views.projections``, from the relative pose."""
    T_other_ref = transforms.invert(other.T_home_cam) @ reference.T_home_cam
    A = K_other @ T_other_ref[:3, :3] @ np.linalg.inv(K_reference)
    return np.concatenate([A.ravel(), K_other @ T_other_ref[:3, 3]])


def inverse_depths(found: Views, step_px: float, most: int, nearest: float = np.inf) -> np.ndarray:
    """(D,) float32 inverse depths (1/m) from 0, such that the fastest pair in view moves by at most
    ``step_px``.

    None is above ``nearest`` (1/m). Steps are widened where there would be more than ``most``.
    Inverse depths that no pair sees are left out.
    """
    grid, tops = _grid(found.shape), nearest_in_view(found)
    top = min(max(tops), nearest)
    if top <= 0:
        return np.zeros(1, np.float32)
    samples = top * np.linspace(0.0, 1.0, _SAMPLES) ** 2
    rate = np.max(
        [_rate(p, grid, s, samples) for p, s in zip(found.projections, found.sizes)], axis=0
    )
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(samples))])
    count = int(np.clip(np.ceil(moved[-1] / step_px), 2, most))
    return np.interp(np.linspace(0.0, moved[-1], count + 1), moved, samples).astype(np.float32)


def nearest_in_view(found: Views) -> List[float]:
    """The largest inverse depth (1/m) at which each pair sees enough of the picture, 0 where at
    none."""
    grid = _grid(found.shape)
    return [_top(p, grid, s) for p, s in zip(found.projections, found.sizes)]


def seen_by_any(found: Views, w: float) -> np.ndarray:
    """HxW bool: whether some pair sees the pixel if it is at inverse depth w (1/m)."""
    height, width = found.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    inside = [_inside(_project(p, pixels, w), s) for p, s in zip(found.projections, found.sizes)]
    return np.any(inside, axis=0).reshape(found.shape)


def _resize(image: np.ndarray, scale: float) -> np.ndarray:
    if scale == 1.0:
        return image
    return cv2.resize(image, _size(image.shape, scale)[::-1], interpolation=cv2.INTER_AREA)


def _size(shape: Tuple[int, int], scale: float) -> Tuple[int, ...]:
    return tuple(max(1, int(round(n * scale))) for n in shape)


def camera_matrix(camera: PinholeCamera, shape: Tuple[int, int]) -> np.ndarray:
    """K of the picture resized to ``shape``."""
    return camera.resized(shape[1], shape[0]).K


def _grid(shape: Tuple[int, int]) -> np.ndarray:
    across, down = _GRID
    u, v = np.meshgrid(np.linspace(0, shape[1] - 1, across), np.linspace(0, shape[0] - 1, down))
    return np.stack([u.ravel(), v.ravel(), np.ones(u.size)])


def _project(p: np.ndarray, grid: np.ndarray, w) -> np.ndarray:
    """(..., 2, n) pixels in the other picture, NaN behind it."""
    w = np.asarray(w, float)
    q = p[:9].reshape(3, 3) @ grid + w[..., None, None] * p[9:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = q[..., :2, :] / q[..., 2:, :]
        return np.where(q[..., 2:, :] > 1e-9, uv, np.nan)


def _inside(uv: np.ndarray, size: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        x, y = uv[..., 0, :], uv[..., 1, :]
        return (x >= 0) & (x <= size[1] - 1) & (y >= 0) & (y <= size[0] - 1)


def _top(p: np.ndarray, grid: np.ndarray, size: np.ndarray) -> float:
    """The largest inverse depth at which the pair still sees enough of the picture."""
    length = np.linalg.norm(p[9:]) / max(np.linalg.norm(p[:9].reshape(3, 3), 2), 1e-12)
    if length <= 0:
        return 0.0
    # p[9:] is K t: in units of pixels times metres; a point nearer than half the baseline is no
    # stereo
    top = 2.0 * size.max() / np.linalg.norm(p[9:])
    w = top * np.linspace(0.0, 1.0, _TOP_SAMPLES)
    enough = _inside(_project(p, grid, w), size).mean(axis=-1) >= VIEWS.least_seen
    return float(w[enough].max()) if enough.any() else 0.0


def _rate(p: np.ndarray, grid: np.ndarray, size: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Pixels per unit of inverse depth that the pair's faster grid points move, 0 where it sees too
    little."""
    uv = _project(p, grid, w)
    dw = 1e-4 * w[-1]
    speed = np.linalg.norm(_project(p, grid, w + dw) - uv, axis=-2) / dw
    inside = _inside(uv, size) & np.isfinite(speed)
    fast = _percentile(speed, inside, VIEWS.fast_share)
    return np.where(inside.mean(axis=-1) >= VIEWS.least_seen, fast, 0.0)


def _percentile(values: np.ndarray, chosen: np.ndarray, share: float) -> np.ndarray:
    """Gives the percentile of the chosen ones of each row, 0 where there are none."""
    rows = np.sort(np.where(chosen, values, np.inf), axis=1)
    at = share * np.maximum(chosen.sum(axis=1) - 1, 0)
    low = np.floor(at).astype(int)
    low, high = (
        np.take_along_axis(rows, i[:, None], 1)[:, 0] for i in (low, np.ceil(at).astype(int))
    )
    with np.errstate(invalid="ignore"):
        return np.where(chosen.any(axis=1), low + (at - np.floor(at)) * (high - low), 0.0)
