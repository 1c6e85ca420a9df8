# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_guidance ground MAP... --robot NAME -o OUT``."""

import argparse
import json
from pathlib import Path
from typing import List, Optional

import numpy as np

from fcsv_geometry.programs.commands import run
from fcsv_guidance import tuning
from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground import Ground, ground_from, stand_probability
from fcsv_guidance.map_files import occupancy, write_layers, write_map_server
from fcsv_guidance.picture import draw
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route import NoRoute, plan_route
from fcsv_guidance.views import read_map

_EXAMPLES = """examples:
  ground out/map --robot config/robots/rescue.yaml -o out/ground
  ground out/map1 out/map2 --robot config/robots/small.yaml --cell-m 0.05 -o out/ground
  ground out/map --robot config/robots/rescue.yaml --route 20 0 38 4 -o out/ground
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0; 1 where a route was asked for and none is known; 2 with one line on stderr on bad input."""
    return run(_parser(), argv, _ground)


def _ground(args: argparse.Namespace) -> int:
    robot, out = load_robot(args.robot), Path(args.out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise GroundError(f"{out}: exists and is not an empty folder; give another with -o")
    ground = ground_from([read_map(folder) for folder in args.maps], args.cell_m, reach_m=args.reach_m)
    stands = stand_probability(ground, robot)
    found = None
    if args.route:
        found = plan_route(ground, robot, args.route[:2], args.route[2:], args.place_sigma_m, args.through_unknown)
    out.mkdir(parents=True, exist_ok=True)
    occupied = occupancy(ground, robot)
    written = write_map_server(occupied, ground.grid, out, "map")
    written += write_map_server(occupied, ground.grid, out, "map_scaled", scaled=True)
    written += write_layers(ground, stands, out)
    route = None if found is None or isinstance(found, NoRoute) else found
    draw(ground, robot, stands, out / "ground.png", route)
    (out / "ground.json").write_text(json.dumps(_document(ground, stands, robot.name, found), indent=1))
    print(_summary(ground, stands))
    if isinstance(found, NoRoute):
        print(f"{found.reason}; ground.json lists them")
    elif found is not None:
        print(
            f"route of {found.length_m:.1f} m, {len(found.points_home_m)} corners, worst cell's risk {found.risk:.3f}"
        )
    print(f"wrote {len(written) + 2} files to {out}")
    return 1 if isinstance(found, NoRoute) else 0


def _summary(ground: Ground, stands: np.ndarray) -> str:
    grid, free = ground.grid, stands >= tuning.FREE_P
    size = f"{grid.columns * grid.cell_m:.0f} x {grid.rows * grid.cell_m:.0f} m in cells of {grid.cell_m:g} m"
    return f"{size}: {ground.known.mean():.0%} known, {free.mean():.0%} free to stand on (p >= {tuning.FREE_P})"


def _document(ground: Ground, stands: np.ndarray, robot: str, found) -> dict:
    grid = ground.grid
    document = {
        "robot": robot, "maps": list(ground.views),
        "grid": {"x0_m": grid.x0_m, "y0_m": grid.y0_m, "cell_m": grid.cell_m, "shape": list(grid.shape)},
        "known": float(ground.known.mean()), "free": float((stands >= tuning.FREE_P).mean()),
    }  # fmt: skip
    if isinstance(found, NoRoute):
        document["no_route"] = {"reason": found.reason, "to_see_m": grid.middle_of(*found.to_see.T).tolist()}
    elif found is not None:
        document["route"] = {
            "points_m": found.points_home_m.tolist(), "length_m": found.length_m, "risk": found.risk,
            "unknown_m": grid.middle_of(*found.unknown_cells.T).tolist(),
        }  # fmt: skip
    return document


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ground", description="The ground that a robot can drive on, from maps; a route across it.",
        epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    add = parser.add_argument
    add("maps", nargs="+", metavar="MAP", help="folders that 'map' wrote")
    add("--robot", required=True, metavar="FILE", help="the robot (config/robots/NAME.yaml)")
    add("-o", "--out", required=True, metavar="OUT", help="an empty or new folder")
    add("--cell-m", type=float, default=0.1, help="side of a cell (default 0.1 m)")
    add("--reach-m", type=float, default=60.0, help="how far from a camera the grid reaches (default 60 m)")
    add("--route", type=float, nargs=4, metavar=("X0", "Y0", "X1", "Y1"), help="from start to goal, home (m)")
    add(
        "--place-sigma-m", type=float, default=0.0, help="sigma of the robot's place (m); the way keeps two of it clear"
    )
    add("--through-unknown", type=float, metavar="COST", help="cost of a metre not seen; without it none is crossed")
    return parser
