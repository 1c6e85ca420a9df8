# SPDX-License-Identifier: Apache-2.0
"""Compares the cells that ground models call free with the truth of drawn places; the table of
docs/lab/guidance.md.

python tools/bench_ground.py [--worlds maze rubble] [--seeds 1 2 3] [--robot
config/robots/rescue.yaml] python tools/bench_ground.py --map out/demo/map out/demo/session/truth
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import rankdata

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import (
    Ground,
    cell_probability,
    ground_from,
    renewed,
    stand_probability,
)
from fcsv_guidance.ground.occupancy import FREE_PERCENT, occupancy
from fcsv_guidance.ground.standing import disk, least
from fcsv_guidance.ground.tuning import FREE_P
from fcsv_guidance.ground.views import read_map
from fcsv_guidance.robot import Robot, load_robot
from fcsv_sim.robot.places.survey import stations, survey
from fcsv_sim.world.footing import Footing, footprints
from fcsv_sim.world.town import PLACES, Town
from fcsv_stereo.evaluating.truth import load_truth

_BANDS_M = (0, 30, 40, 60)
_TRUE_SIGMA_M = 1e-3
_TIMES = 5  # the least counts
_P_EDGES = (0.0, 0.2, 0.5, 0.8, 0.9, 0.95, FREE_P, 1.0)


def grid_of(plan, cell_m: float) -> Grid:
    """The grid of a place's area."""
    x0, x1, y0, y1 = plan.area_m
    return Grid.around((x0, y0), (x1, y1), cell_m)


def true_stands(ground: Ground, robot: Robot, mesh: Path) -> np.ndarray:
    """(rows, columns) bool: whether the robot truly can stand in a cell; the rays begin at its
    height above the ground as mapped, so that what hangs higher does not count. False where no
    ground is known."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(o3d.t.io.read_triangle_mesh(str(mesh)))
    grid = ground.grid
    xy = grid.middle_of(*np.indices(grid.shape))
    top = np.where(ground.known, ground.height_m, 0.0) + robot.height_m
    rays = np.concatenate(
        [xy, top[..., None], np.broadcast_to([0.0, 0.0, -1.0], (*grid.shape, 3))], -1
    )
    reach = scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)), nthreads=1)["t_hit"].numpy()
    z = np.where(ground.known & np.isfinite(reach), top - reach, np.nan).astype(np.float32)
    flat = np.full(grid.shape, _TRUE_SIGMA_M, np.float32)
    truth = replace(
        ground,
        height_m=z,
        sigma_m=flat,
        low_m=z,
        high_m=z,
        overhead_m=np.full_like(z, np.inf),
        trust=np.ones_like(z),
        maps=(),
    )
    passes = np.nan_to_num(cell_probability(truth, robot)) > 0.5
    return least(passes.astype(np.float32), disk(robot.radius_m, grid.cell_m), 0.0) > 0


def table(name: str, ground: Ground, p: np.ndarray, true: np.ndarray, inside: np.ndarray) -> None:
    """Prints what is called free by band of distance, and how often that is true by probability."""
    for near, far in zip(_BANDS_M[:-1], _BANDS_M[1:]):
        band = inside & (ground.distance_m >= near) & (ground.distance_m < far)
        free = (p >= FREE_P) & band
        wrong, found = (free & ~true).sum(), (free & true).sum() / max((band & true).sum(), 1)
        share = f"{wrong / max(free.sum(), 1):.2%}"
        print(f"| {name} | {near} to {far} | {free.sum()} | {wrong} | {share} | {found:.0%} |")


def inflated(ground: Ground, robot: Robot, p: np.ndarray) -> np.ndarray:
    """As ``p``, what map.pgm says to a planner that keeps the whole footprint in its free cells:
    FREE_P or 0."""
    cells = occupancy(ground, robot, p)
    free = (cells >= 0) & (cells <= FREE_PERCENT)
    return FREE_P * (least(free, disk(robot.radius_m, ground.grid.cell_m), 0.0) > 0)


def reliability(rows) -> None:
    """Prints for classes of p how many of the footprints can truly be stood on; rows of (p,
    true)."""
    p, true = (np.concatenate(part) for part in zip(*rows))
    print("| p | footprints | truly free |\n| --- | --- | --- |")
    for low, high in zip(_P_EDGES[:-1], _P_EDGES[1:]):
        cells = (p >= low) & (p < high if high < 1 else p <= 1)
        print(
            f"| {low} to {high} | {cells.sum()} | {true[cells].mean() if cells.any() else np.nan:.1%} |"
        )
    n = true.sum()
    print(f"AUC {(rankdata(p)[true].sum() - n * (n + 1) / 2) / max(n * (len(p) - n), 1):.3f}")


def main(argv=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", nargs="+", choices=PLACES, default=["maze", "rubble"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument(
        "--map", type=Path, nargs=2, metavar=("MAP", "TRUTH"), help="a map and its session's truth"
    )
    parser.add_argument("--robot", default="config/robots/rescue.yaml")
    parser.add_argument("--cell-m", type=float, default=0.1)
    args = parser.parse_args(argv)
    robot = load_robot(args.robot)
    print(
        "| place | m from a camera | called free | not free | share | of what is free |\n"
        + "| --- " * 6
        + "|"
    )
    rows = []
    for name, ground, true, inside in (
        _mapped(*args.map, robot, args.cell_m) if args.map else _drawn(args, robot)
    ):
        p = stand_probability(ground, robot)
        table(name, ground, p, true, inside)
        table(f"{name}, map.pgm", ground, inflated(ground, robot, p), true, inside)
        judged = inside & np.isfinite(p)
        rows.append((p[judged], true[judged]))
    reliability(rows)
    if not args.map:
        costs(args, robot)
    return 0


def costs(args, robot: Robot) -> None:
    """Prints what the ground of one map costs, and to renew it from an instant."""
    town = Town.generate(args.seeds[0], args.worlds[0])
    (view,) = survey(town, stations(town.plan)[:1], args.seeds[0])
    grid = grid_of(town.plan, args.cell_m)
    ground, spent = ground_from([view], grid=grid), []
    for _ in range(_TIMES):
        at_s = [time.process_time()]
        stand_probability(ground_from([view], grid=grid), robot)
        at_s.append(time.process_time())
        renewed(ground, view)
        spent.append(np.diff([*at_s, time.process_time()]))
    whole_s, renewal_s = np.min(spent, axis=0)
    print(f"one map's ground: {whole_s:.2f} s of the processor, its renewal {renewal_s:.3f} s")


def _drawn(args, robot: Robot):
    for world in args.worlds:
        for seed in args.seeds:
            town = Town.generate(seed, world)
            grid = grid_of(town.plan, args.cell_m)
            clear = Footing.of(town.plan).clearance(robot)
            inside, true = footprints(town.plan, clear, grid)
            yield (
                f"{world} {seed}",
                ground_from(survey(town, stations(town.plan), seed), grid=grid),
                true,
                inside,
            )


def _mapped(folder: Path, truth: Path, robot: Robot, cell_m: float):
    vehicle, stamp = json.loads((folder / "report.json").read_text())["reference"]["image"].split(
        "/"
    )
    view = replace(
        read_map(folder), T_home_cam=load_truth(truth).T_world_cam(vehicle, float(stamp))
    )
    ground = ground_from([view], cell_m)
    yield (
        folder.name,
        ground,
        true_stands(ground, robot, truth / "scene.ply"),
        np.ones(ground.grid.shape, bool),
    )


if __name__ == "__main__":
    sys.exit(main())
