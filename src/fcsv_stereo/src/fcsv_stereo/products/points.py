# SPDX-License-Identifier: Apache-2.0
"""Points that several configurations saw, made one."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.model import Cloud, Reference

# depths that differ by less than so many standard deviations of their difference are of one point
_AGREE = 2.0


def merge_duplicates(cloud: Cloud, reference: Reference, cell_px: float = 1.0) -> Cloud:
    """Points on one line of sight whose depths agree become their mean, weighted by 1/sigma**2.

    A voxel is a pixel of the reference picture (``cell_px`` wide) and as deep as sigma says: a cube
    as small as the one would keep every far point twice, one as large as the other would blur what
    stands side by side. The merged sigma is that of the mean for independent errors, but not less
    than half of the smallest: what several configurations share (the reference picture, its pose)
    does not average out. Colour and baseline are those of the surest point. Points behind the
    reference camera are kept as they are.
    """
    if not len(cloud):
        return cloud
    p_cam = transforms.apply(
        transforms.invert(reference.T_home_cam), cloud.points_home_m.astype(float)
    )
    depth = p_cam[:, 2]
    sigma = np.maximum(cloud.sigma_m.astype(float), 1e-6)
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = reference.camera.project(p_cam) / cell_px
    ahead = (depth > 0) & np.isfinite(uv).all(axis=1)
    cell = np.where(ahead[:, None], np.rint(uv), 0.0).astype(np.int64)
    cell[~ahead] = np.stack(
        [-np.arange(1, (~ahead).sum() + 1), np.full((~ahead).sum(), -(1 << 40))], -1
    )
    order = np.lexsort((depth, cell[:, 0], cell[:, 1]))
    first = np.empty(len(order), bool)
    first[0] = True
    gap = np.diff(depth[order])
    agree = gap <= _AGREE * np.hypot(sigma[order][1:], sigma[order][:-1])
    first[1:] = (np.diff(cell[order], axis=0) != 0).any(axis=1) | ~agree
    return _means(cloud, sigma, order, np.flatnonzero(first))


def _means(cloud: Cloud, sigma: np.ndarray, order: np.ndarray, starts: np.ndarray) -> Cloud:
    """One point for each run of ``order`` that begins at ``starts``."""
    if len(starts) == len(order):
        return cloud
    weight = 1.0 / sigma[order] ** 2
    total = np.add.reduceat(weight, starts)
    points = (
        np.add.reduceat(cloud.points_home_m[order] * weight[:, None], starts, axis=0)
        / total[:, None]
    )
    run = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(order))))
    surest = order[np.lexsort((sigma[order], run))][starts]
    merged = np.maximum(1.0 / np.sqrt(total), 0.5 * sigma[surest])
    single = np.diff(np.append(starts, len(order))) == 1
    merged[single] = sigma[surest][single]
    return Cloud(
        points.astype(np.float32),
        cloud.colors[surest],
        merged.astype(np.float32),
        cloud.baseline_index[surest],
    )
