# SPDX-License-Identifier: Apache-2.0
"""Compares the cells that a map's ground model calls free with the true mesh of its simulated world.

python tools/bench_ground.py out/demo/map out/demo/session/truth --robot config/robots/rescue.yaml
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from fcsv_guidance.ground import Ground, ground_from, stand_probability
from fcsv_guidance.robot import Robot, load_robot
from fcsv_guidance.tuning import FREE_P
from fcsv_guidance.views import read_map
from fcsv_stereo.truth import load_truth

_BANDS_M = (0, 20, 30, 40, 60)
_TRUE_SIGMA_M = 1e-3
_P_EDGES = (0.0, 0.2, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)


def true_stands(ground: Ground, robot: Robot, mesh: Path) -> np.ndarray:
    """(rows, columns) bool: whether the robot truly can stand in a cell; the rays begin at its height above the
    ground as mapped, so that what hangs higher does not count. False where no ground is known."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(o3d.t.io.read_triangle_mesh(str(mesh)))
    grid = ground.grid
    xy = grid.middle_of(*np.indices(grid.shape))
    top = np.where(ground.known, ground.height_m, 0.0) + robot.height_m
    rays = np.concatenate([xy, top[..., None], np.broadcast_to([0.0, 0.0, -1.0], (*grid.shape, 3))], -1)
    reach = scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)), nthreads=1)["t_hit"].numpy()
    z = np.where(ground.known & np.isfinite(reach), top - reach, np.nan).astype(np.float32)
    flat = np.full(grid.shape, _TRUE_SIGMA_M, np.float32)
    truth = replace(
        ground, height_m=z, sigma_m=flat, low_m=z, high_m=z, overhead_m=np.full_like(z, np.inf), trust=np.ones_like(z)
    )
    return np.nan_to_num(stand_probability(truth, robot)) > 0.5


def main(argv=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("truth", type=Path, help="folder with scene.ply and cameras.csv")
    parser.add_argument("--robot", required=True)
    parser.add_argument("--cell-m", type=float, default=0.2)
    args = parser.parse_args(argv)
    robot = load_robot(args.robot)
    name = json.loads((args.map / "report.json").read_text())["reference"]["image"]
    vehicle, stamp = name.split("/")
    view = replace(read_map(args.map), T_home_cam=load_truth(args.truth).T_world_cam(vehicle, float(stamp)))
    ground = ground_from([view], args.cell_m)
    p = stand_probability(ground, robot)
    true = true_stands(ground, robot, args.truth / "scene.ply")
    print(f"{'band':>12} {'called free':>12} {'not free':>9} {'share':>7}")
    for near, far in zip(_BANDS_M[:-1], _BANDS_M[1:]):
        free = (p >= FREE_P) & (ground.distance_m >= near) & (ground.distance_m < far)
        wrong = (free & ~true).sum()
        print(f"{f'{near} to {far} m':>12} {free.sum():>12} {wrong:>9} {wrong / max(free.sum(), 1):>7.2%}")
    print(f"{'p':>12} {'cells':>12} {'truly free':>21}")
    for low, high in zip(_P_EDGES[:-1], _P_EDGES[1:]):
        cells = (p >= low) & (p < high if high < 1 else p <= 1)
        print(f"{f'{low} to {high}':>12} {cells.sum():>12} {true[cells].mean() if cells.any() else np.nan:>21.2%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
