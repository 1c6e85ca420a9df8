# SPDX-License-Identifier: Apache-2.0
"""Points between neighbouring pixels of one surface: from above, rows of far ground lie metres apart."""

from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.model import Cloud, Reference
from fcsv_stereo.products.points import concatenate

_MOST_PARTS = 64  # between two pixels: beyond it the surface is seen too much from the side to tell where it is
_BEND = 2.0  # a step of inverse depth between two pixels may be so much larger than the smaller one beside it


def with_surfaces(cloud: Cloud, reference: Reference, cell_m: float, step: float) -> Cloud:
    """The cloud, and points every ``cell_m`` (m, from above) between pixels of ``reference`` that are of one surface.

    A plane is linear in inverse depth. So four neighbouring pixels are of one surface where no step of inverse depth
    (1/m) between two of them is larger than ``step`` and twice the smaller of the steps
    that lie before and behind it. Points in between are bilinear in inverse depth and colour.
    """
    w, colours, index = _grids(cloud, reference)
    across, down = _joined(w, step), _joined(w.T, step).T
    quads = across[:-1] & across[1:] & down[:, :-1] & down[:, 1:]
    rows, columns = np.nonzero(quads)
    parts = _parts(w, reference, rows, columns, cell_m)
    found = [cloud]
    for down_parts, across_parts in np.unique(parts, axis=0):
        chosen = (parts == (down_parts, across_parts)).all(axis=1)
        if max(down_parts, across_parts) <= _MOST_PARTS and max(down_parts, across_parts) > 1:
            found.append(
                _between(cloud, index, w, colours, reference, (rows[chosen], columns[chosen]),
                         (int(down_parts), int(across_parts)))
            )  # fmt: skip
    return concatenate(found)


def _grids(cloud: Cloud, reference: Reference) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverse depth (HxW, NaN where none), colours (HxWx3 float), and the nearest point (HxW) of each pixel."""
    camera = reference.camera
    p_cam = transforms.apply(transforms.invert(reference.T_home_cam), cloud.points_home_m.astype(float))
    ahead = np.flatnonzero(p_cam[:, 2] > 0)
    uv = camera.project(p_cam[ahead]) if len(ahead) else np.empty((0, 2))
    u, v = np.rint(uv).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    kept = ahead[inside]
    order = np.argsort(-p_cam[kept, 2], kind="stable")  # the nearest is written last
    kept, u, v = kept[order], u[inside][order], v[inside][order]
    w = np.full((camera.height, camera.width), np.nan)
    colours, index = np.zeros((*w.shape, 3)), np.zeros(w.shape, int)
    w[v, u], colours[v, u], index[v, u] = 1.0 / p_cam[kept, 2], cloud.colors[kept], kept
    return w, colours, index


def _joined(w: np.ndarray, step: float) -> np.ndarray:
    """H x (W-1) bool: whether a pixel and the next of its row are of one surface."""
    steps = np.abs(np.diff(w, axis=1))
    unknown = np.full((len(w), 1), np.nan)
    beside = np.fmin(np.hstack([unknown, steps[:, :-1]]), np.hstack([steps[:, 1:], unknown]))
    return steps <= step + _BEND * np.nan_to_num(beside)  # NaN is not joined


def _parts(w: np.ndarray, reference: Reference, rows: np.ndarray, columns: np.ndarray, cell_m: float) -> np.ndarray:
    """Nx2: into how many parts each quad is cut, down and across; powers of two."""
    corner = {(i, j): _points(w[rows + i, columns + j], rows + i, columns + j, reference)[:, :2]
              for i in (0, 1) for j in (0, 1)}  # fmt: skip
    down_m = [np.linalg.norm(corner[1, j] - corner[0, j], axis=1) for j in (0, 1)]
    across_m = [np.linalg.norm(corner[i, 1] - corner[i, 0], axis=1) for i in (0, 1)]
    lengths = np.stack([np.maximum(*down_m), np.maximum(*across_m)], axis=1)
    return 2 ** np.ceil(np.log2(np.maximum(lengths / cell_m, 1.0))).astype(int)


def _points(w: np.ndarray, v: np.ndarray, u: np.ndarray, reference: Reference) -> np.ndarray:
    c = reference.camera
    rays = np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy, np.ones(len(w))], axis=1)
    return transforms.apply(reference.T_home_cam, rays / w[:, None])


def _between(cloud: Cloud, index, w, colours, reference: Reference, quads, parts: Tuple[int, int]) -> Cloud:
    """Points within quads (their upper left pixels) that are cut into as many parts."""
    a, b = (g.ravel()[1:] for g in np.meshgrid(*(np.arange(n) / n for n in parts), indexing="ij"))  # without the pixel
    v, u = (np.repeat(x, len(a)) for x in quads)
    a, b = np.tile(a, len(quads[0])), np.tile(b, len(quads[0]))

    def bilinear(of: np.ndarray) -> np.ndarray:
        s, t = (x.reshape(-1, *[1] * (of.ndim - 2)) for x in (a, b))
        upper = (1 - t) * of[v, u] + t * of[v, u + 1]
        return (1 - s) * upper + s * ((1 - t) * of[v + 1, u] + t * of[v + 1, u + 1])

    points = _points(bilinear(w), v + a, u + b, reference)
    of = index[v, u]
    rgb = np.rint(bilinear(colours)).astype(np.uint8)
    return Cloud(points.astype(np.float32), rgb, cloud.sigma_m[of], cloud.baseline_index[of])
