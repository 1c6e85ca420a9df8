# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_guidance ground MAP... --robot NAME -o OUT``."""

import argparse
import re
import sys
from decimal import Decimal
from pathlib import Path
from typing import List, Optional

import numpy as np

from fcsv_geometry.programs.commands import run
from fcsv_geometry.programs.interruption import termination_raised
from fcsv_geometry.programs.live_line import LiveLine, Steps
from fcsv_geometry.programs.writing import require_folder
from fcsv_guidance.errors import GroundError
from fcsv_guidance.files.folder import (
    GroundOptions,
    GroundWritten,
    RouteAsked,
    require_new,
    write_ground,
)
from fcsv_guidance.files.stations import joining_commands
from fcsv_guidance.ground.site_views import read_views
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route.look_from import next_commands
from fcsv_guidance.route.search import NoRoute
from fcsv_tracking.robot_tags import readable_m

_EXAMPLES = """examples:
  ground out/map --robot config/robots/rescue.yaml -o out/ground
  ground out/map1 out/map2 --robot config/robots/small.yaml --cell-m 0.05 -o out/ground
  ground out/map --robot config/robots/rescue.yaml --route 20 0 38 4 -o out/ground
  ground out/map --robot config/robots/rescue.yaml --route 20 0 38 4 --look-from out/look.yaml -o out/ground
  ground out/map --robot config/robots/rescue.yaml --octomap 0.2 -o out/ground
  ground out/site --robot config/robots/rescue.yaml --route 20 0 80 30 -o out/ground
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0; 1 where a route was asked for and none is known; 2 with one line on stderr on
    bad input."""
    words = [_plain(word) for word in (sys.argv[1:] if argv is None else argv)]
    return run(_parser(), words, _ground, left="nothing was written")


def _plain(word: str) -> str:
    """A negative number with an exponent written without: argparse takes it for an option.

    >>> _plain("-1e0"), _plain("-2.5E-3"), _plain("-o"), _plain("1e0")
    ('-1.0', '-0.0025', '-o', '1e0')
    """
    if not re.fullmatch(r"-(\d+\.?\d*|\.\d+)[eE][-+]?\d+", word) or np.isinf(float(word)):
        return word
    return f"{Decimal(repr(float(word))):f}"


@termination_raised()
def _ground(args: argparse.Namespace) -> int:
    robot, out = load_robot(args.robot), Path(args.out)
    require_new(out)
    require_folder(out.absolute().parent)
    options = GroundOptions.of_robot(robot, args.cell_m, args.reach_m, args.octomap)
    asked = _route(args)
    with Steps(LiveLine(sys.stderr), "reading maps").shown() as steps:
        views, place = read_views(args.maps)
        written = write_ground(views, robot, out, options, asked, steps.begin, place)
    found = written.found
    print(written.summary)
    if robot.tags:
        far_m = readable_m(robot.tags, views[0].K[0, 0])
        print(f"cameras like the map's read the tags of {robot.name} to {far_m:.0f} m")
    if isinstance(found, NoRoute):
        print(f"{found.reason}; ground.json lists them")
        if args.look_from is not None:
            _print_look_from(written, Path(args.look_from), args.maps)
    elif found is not None:
        unseen_m = options.cell_m * len(found.unknown_cells)
        unseen = f"; some {unseen_m:.1f} m of it were never seen" if unseen_m else ""
        print(
            f"route of {found.length_m:.1f} m, {len(found.points_home_m)} corners, worst seen cell's risk "
            f"{found.risk:.3f}{unseen}"
        )
    print(f"wrote {len(written.paths)} files to {out}")
    return 1 if isinstance(found, NoRoute) else 0


def _route(args: argparse.Namespace) -> Optional[RouteAsked]:
    """What is asked for; None: no route. Raises GroundError on an option that would be ignored."""
    if args.route:
        return RouteAsked(
            tuple(args.route[:2]),
            tuple(args.route[2:]),
            args.place_sigma_m,
            args.through_unknown,
            Path(args.look_from) if args.look_from is not None else None,
        )
    if args.look_from is not None:
        raise GroundError("--look-from: says where to look for a route; give --route, too")
    for option, given in (
        ("--place-sigma-m", args.place_sigma_m != 0.0),
        ("--through-unknown", args.through_unknown is not None),
    ):
        if given:
            raise GroundError(f"{option} is of --route X0 Y0 X1 Y1, which is not given")
    return None


def _print_look_from(written: GroundWritten, mission: Path, maps: List[str]) -> None:
    if written.looks is None:
        why = "no place shows a cell that must be seen"
        print(f"{mission}: not written: {why}" if len(written.found.to_see) else "nothing to see")
        return
    lines = [written.looks.in_words(), f"wrote {mission}", *next_commands(mission)]
    if written.stations:
        lines += joining_commands(written.stations, maps)
    print("\n".join(lines))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ground",
        description="The ground that a robot can drive on, from maps; a route across it.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "maps",
        nargs="+",
        metavar="MAP",
        help="folders that 'map' wrote, or the one that 'survey' wrote",
    )
    add("--robot", required=True, metavar="FILE", help="the robot (config/robots/NAME.yaml)")
    add("-o", "--out", required=True, metavar="OUT", help="an empty or new folder")
    add(
        "--cell-m",
        type=float,
        help="side of a cell, at most the robot's radius (default 0.1 m, or that where it is less)",
    )
    add(
        "--reach-m",
        type=float,
        default=60.0,
        help="how far from a camera the grid reaches (default 60 m)",
    )
    add(
        "--octomap",
        type=float,
        metavar="VOXEL_M",
        help="also map.bt and map.ot, an OctoMap of voxels of so many m",
    )
    add(
        "--route",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="from start to goal, home (m)",
    )
    add(
        "--look-from",
        metavar="MISSION",
        help="where no route is known: a mission file of the place that shows most of what lacks",
    )
    add(
        "--place-sigma-m",
        type=float,
        default=0.0,
        help="sigma of the robot's place (m); the way keeps two of it clear",
    )
    add(
        "--through-unknown",
        type=float,
        metavar="COST",
        help="cost of a metre not seen; without it none is crossed",
    )
    return parser
