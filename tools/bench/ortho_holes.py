# SPDX-License-Identifier: Apache-2.0
"""Holes of the orthophoto, with and without evidence: the tables are in docs/lab/products.md.

    tools/run ortho-holes [--scenes WORLD:SEED ...]

First of the cells whose true highest point the reference camera sees, at a pixel whose depth is in
the cloud and within 5 % of the truth: how many are empty, by points alone and with surfaces, and
how many although a surface of the map crosses them. Then all cells of the field of view, and of the
filled ones within 100 m those that lie more than a cell from all that the reference camera truly
sees.
"""

import argparse
from typing import List, Optional

import cv2
import numpy as np
import open3d as o3d

from bench.__main__ import scene_of
from bench.scenes import HORIZONTAL, NOISES, T_WORLD_HOME, SceneName, shoot
from fcsv_geometry import transforms
from fcsv_sim.world.town import Town
from fcsv_stereo.depth import cloud_of
from fcsv_stereo.joint import Joint
from fcsv_stereo.map_files.cloud_bounds import CloudBounds, bound_cloud
from fcsv_stereo.model import Reference
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.products.from_above import Raster, rasterize
from fcsv_stereo.products.holes import OPEN, HoleShares, why_empty
from fcsv_stereo.products.points import merge_duplicates
from fcsv_stereo.products.spanned import Surfaces

_ABOVE_M = 300.0
_NEAR_M = 100.0
_VISIBLE, _RIGHT = 0.02, 0.05  # of the depth
_SCENES = [SceneName(world, 3) for world in ("street", "village", "field")]


def main(argv: Optional[List[str]] = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=scene_of, nargs="+", metavar="WORLD:SEED", default=_SCENES)
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    print(
        "| world | cells that are seen | holes, points alone | with surfaces | of a surface seen there |\n"
        + "|---" * 5
        + "|"
    )
    shares = []
    for name in args.scenes:
        scene = shoot(name, HORIZONTAL)
        result = bound_cloud(Joint().map(scene.given(HORIZONTAL, NOISES[0])), CloudBounds())
        cloud = merge_duplicates(result.cloud, result.reference)
        surfaces, sky = Surfaces.of(cloud, result.reference), result.kind == DepthKind.SKY
        told = []
        for reference in (None, result.reference):
            raster = rasterize(cloud, reference=reference)
            why = why_empty(raster, surfaces, result.reference, sky)
            astray = _astray(raster, result.reference, scene.true_depth)
            shares.append(
                (
                    name,
                    "points alone" if reference is None else "with surfaces",
                    HoleShares.of(why),
                    astray,
                )
            )
            seen = _seen(name, raster, result, scene.true_depth)
            told.append((seen & np.isnan(raster.height)).sum() / seen.sum())
        open_share = (seen & (why == OPEN)).sum() / seen.sum()
        print(
            f"| {name} | {seen.sum():,} | {told[0]:.1%} | {told[1]:.1%} | {open_share:.2%} |",
            flush=True,
        )
    print(
        "\n| world | raster | filled | hidden | no depth | below the picture | of a surface seen there | astray |\n"
        + "|---" * 8
        + "|"
    )
    for name, how, s, astray in shares:
        print(
            f"| {name} | {how} | {s.filled:.1%} | {s.hidden:.1%} | {s.unanswered:.1%} | {s.below:.1%} | {s.open:.2%} "
            f"| {astray:.2%} |"
        )


def _astray(raster: Raster, reference: Reference, true_depth: np.ndarray) -> float:
    """Of the filled cells within _NEAR_M ahead, the share that lies more than a cell from what is
    truly seen."""
    depth = np.where(true_depth < 2.0 * _NEAR_M, true_depth, np.nan).astype(np.float32)
    true = rasterize(
        cloud_of(reference, depth, np.ones_like(depth), np.zeros(depth.shape)),
        raster.cell_m,
        reference,
    )
    row, column = np.nonzero(np.isfinite(true.height))
    row = row + round((raster.y0_m - true.y0_m) / raster.cell_m)
    column = column + round((true.x0_m - raster.x0_m) / raster.cell_m)
    there = np.zeros(raster.height.shape, np.uint8)
    inside = (row >= 0) & (row < there.shape[0]) & (column >= 0) & (column < there.shape[1])
    there[row[inside], column[inside]] = 1
    near = raster.x0_m + (np.arange(there.shape[1]) + 0.5) * raster.cell_m < _NEAR_M
    filled = np.isfinite(raster.height) & near
    return float(
        (filled & (cv2.dilate(there, np.ones((3, 3), np.uint8)) == 0)).sum() / filled.sum()
    )


def _seen(name: SceneName, raster: Raster, result, true_depth: np.ndarray) -> np.ndarray:
    """(H,W) bool of the raster: cells whose true highest point the map holds."""
    p_home = _highest(name, raster)
    view = result.reference
    p_cam = transforms.apply(transforms.invert(view.T_home_cam), p_home)
    z = p_cam[:, 2]
    with np.errstate(invalid="ignore"):
        u, v = np.rint(view.camera.project(p_cam)).T
        inside = (u >= 0) & (v >= 0) & (u < view.camera.width) & (v < view.camera.height)
        u, v = (np.where(inside, x, 0).astype(int) for x in (u, v))
        inside &= np.abs(true_depth[v, u] / z - 1.0) < _VISIBLE
        inside &= np.abs(result.depth[v, u] / z - 1.0) < _RIGHT
    return (inside & _in_cloud(result)[v, u]).reshape(raster.height.shape)


def _highest(name: SceneName, raster: Raster) -> np.ndarray:
    """(H*W, 3) in home: the world's highest point in the middle of each cell."""
    town = Town.generate(name.seed, name.world)
    scene = o3d.t.geometry.RaycastingScene()
    tensor = o3d.core.Tensor
    scene.add_triangles(
        tensor(np.asarray(town.vertices, np.float32)), tensor(np.asarray(town.triangles, np.uint32))
    )
    rows, columns = raster.height.shape
    x, y = np.meshgrid(
        raster.x0_m + (np.arange(columns) + 0.5) * raster.cell_m,
        raster.y0_m - (np.arange(rows) + 0.5) * raster.cell_m,
    )
    above = np.stack([x, y, np.full_like(x, _ABOVE_M)], axis=-1).reshape(-1, 3)
    down = np.broadcast_to([0.0, 0.0, -1.0], above.shape)
    rays = np.concatenate([transforms.apply(T_WORLD_HOME, above), down], axis=1).astype(np.float32)
    above[:, 2] -= scene.cast_rays(tensor(rays))["t_hit"].numpy()
    return above


def _in_cloud(result) -> np.ndarray:
    """(H,W) bool of the reference picture."""
    view = result.reference
    p_cam = transforms.apply(
        transforms.invert(view.T_home_cam), result.cloud.points_home_m.astype(float)
    )
    column, row = np.rint(view.camera.project(p_cam)).astype(int).T
    found = np.zeros(result.depth.shape, bool)
    found[row, column] = True
    return found


if __name__ == "__main__":
    main()
