# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_stereo survey INPUT... -o OUT``."""

import argparse
import sys
from pathlib import Path
from typing import ContextManager, List, Optional

import numpy as np

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs import commands
from fcsv_geometry.programs.interruption import ended_soon
from fcsv_geometry.programs.live_line import LiveLine, Steps
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.document import Site, overlaps
from fcsv_stereo.survey.output.extras import EXTRAS, ExtraOptions, parse_extras
from fcsv_stereo.survey.placing.georeference import HEIGHTS, WorldOptions
from fcsv_stereo.survey.placing.world import unlikely_points
from fcsv_stereo.survey.survey import FILES, run
from fcsv_stereo.survey.tasks.crew import WorkOptions, kill_processes

_EXAMPLES = """examples:
  survey flights/north flights/east flights/south -o out/site
  survey out/map1 out/map2 photos/ -o out/site
  survey flights/* -o out/site --products mcap,mesh,ground --robot config/robots/rescue.yaml
"""


_LEFT = "what was finished is kept in OUT: the same command goes on"
_END_S = 4.0  # after Ctrl-C


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0; 1 where an input is not in the site; 2 with one line on stderr on bad input;
    130 on Ctrl-C."""
    return commands.run(_parser(), argv, _survey, (FcsvError, ValueError), _LEFT)


def _survey(args: argparse.Namespace) -> int:
    live = LiveLine(sys.stderr)
    with _ended_soon(live), Steps(live, "reading inputs").shown() as steps:
        paths = [Path(p) for p in args.inputs]
        site = run(
            paths,
            Path(args.out),
            begin=steps.begin,
            world=_world(args),
            work=_work(args),
            every=args.every,
            extras=_extras(args),
            neighbours=args.neighbours,
        )
    print("\n".join(summary(site)))
    print(f"wrote {args.out}: {', '.join(f for f in FILES if (Path(args.out) / f).exists())}")
    return 1 if site.missing else 0


def _ended_soon(live: LiveLine) -> ContextManager[None]:
    def give_up() -> None:
        kill_processes()
        live.say(f"survey: interrupted; {_LEFT}")

    said = (
        "survey: stopping; it waits for a step that cannot be left at once, at most "
        f"{_END_S:.0f} s (Ctrl-C again: now)"
    )
    return ended_soon(_END_S, lambda: live.say(said), give_up)


def _world(args: argparse.Namespace) -> WorldOptions:
    """Raises SurveyError."""
    control = Path(args.gcp) if args.gcp else None
    return WorldOptions(
        control, args.check_points, args.crs, args.control_sigma_m, args.heights, not args.no_gps
    )


def _extras(args: argparse.Namespace) -> ExtraOptions:
    """Raises InputError, SurveyError or ConfigError."""
    robot = Path(args.robot) if args.robot else None
    return ExtraOptions(parse_extras(args.products), robot, args.mesh_sigma_m)


def _work(args: argparse.Namespace) -> WorkOptions:
    """Raises SurveyError."""
    return WorkOptions(args.workers, args.memory_per_worker, args.scheduler)


def summary(site: Site) -> List[str]:
    """What the terminal shows: a line for each view, loops, remarks, what is missing."""
    adjusted, lines = site.adjusted, []
    for name, p in adjusted.placed.items():
        held = (
            "overlaps no other: stays at its station"
            if p.alone
            else f"joined with {len(overlaps(adjusted, name))}"
        )
        lines.append(
            f"{name}: scale {p.scale:.4f} +- {p.sigma_scale:.4f}, place +- {p.sigma_m:.2f} m, {held}; "
            f"{site.joined[name].count:,} points"
        )
    kept = sum(e.kept for e in adjusted.edges)
    lines.append(f"{kept} of {len(adjusted.edges)} pairs of views are joined")
    if adjusted.loops:
        worst = max(adjusted.loops, key=lambda loop: loop.closing_m)
        lines.append(
            f"{len(adjusted.loops)} loops; the worst closes to {worst.closing_m:.2f} m and {worst.closing_scale:.2%} "
            f"of scale: {', '.join(worst.views)}"
        )
    lines += [*_world_lines(site), *adjusted.remarks]
    lines += [f"{name}: {said}" for name, said in site.extras.items()]
    lines += [f"MISSING {m.name}: {m.reason}" for m in site.missing]
    if site.missing:
        lines.append(f"{len(site.missing)} missing: {', '.join(m.name for m in site.missing)}")
    return lines


def _world_lines(site: Site) -> List[str]:
    if site.world is None:
        return []
    fit = site.world.fit
    heading_deg = np.degrees(fit.sigma_heading_rad)
    lines = [
        f"in {site.world.crs}: place +- {fit.sigma_m:.2f} m, heading +- {heading_deg:.2f} degrees, "
        f"scale +- {fit.sigma_scale:.4f}; heights {site.world.heights}"
    ]
    for p in fit.points:
        east, north, up = p.off_m
        far = f"; MORE THAN {tuning.UNLIKELY_SIGMAS:g} SIGMA OFF" if p.unlikely else ""
        lines.append(
            f"{p.kind} {p.name}: {east:+.3f} east, {north:+.3f} north, {up:+.3f} up, "
            f"+- {np.max(p.sigma_m):.3f} m{far}"
        )
    lines += unlikely_points(fit.points)
    return lines


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="survey",
        description="One site of several views: their maps joined by similarities, and one cloud.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "inputs",
        nargs="+",
        metavar="INPUT",
        help="sessions, folders of posed photographs, or folders that 'map' wrote; each may hold station.yaml",
    )
    add(
        "-o",
        "--out",
        required=True,
        metavar="OUT",
        help="folder for the site; a stopped survey goes on there",
    )
    add(
        "--every",
        type=int,
        default=0,
        metavar="N",
        help="of folders of photographs each N-th picture is the reference of a view (the first alone)",
    )
    add(
        "--neighbours",
        type=int,
        default=tuning.NEIGHBOURS,
        metavar="N",
        help="each view is compared with the N that by the stations look most alike (%(default)s); 0: with all",
    )
    products = parser.add_argument_group("products besides")
    products.add_argument(
        "--products",
        default="",
        metavar="LIST",
        help=f"{', '.join(f'{n} ({f})' for n, f in EXTRAS.items())}, after commas, or all (but ground)",
    )
    products.add_argument(
        "--mesh-sigma-m",
        type=float,
        metavar="M",
        help="of mesh: depths with a smaller sigma are in it (the median of the cloud's)",
    )
    products.add_argument(
        "--robot", metavar="FILE", help="of ground: the robot (config/robots/NAME.yaml)"
    )
    world = parser.add_argument_group("the world's coordinates (docs/user/survey.md)")
    world.add_argument("--gcp", metavar="FILE", help="ground control points: ODM's gcp_list.txt")
    world.add_argument(
        "--check-points",
        default="",
        metavar="NAMES",
        help="control points that only check: names after commas, or a share of all (0.3)",
    )
    world.add_argument(
        "--control-sigma-m",
        type=float,
        default=tuning.CONTROL_SIGMA_M,
        metavar="M",
        help="standard deviation of control points per axis (%(default)s)",
    )
    world.add_argument(
        "--crs",
        default="",
        metavar="EPSG:N",
        help="projected reference system of the output (that of the control points, else UTM's zone)",
    )
    world.add_argument(
        "--heights",
        default="",
        choices=("", *HEIGHTS),
        metavar="SURFACE",
        help="what given heights count from: ellipsoid or geoid; it is passed on, nothing is converted",
    )
    world.add_argument(
        "--no-gps", action="store_true", help="GPS of photographs and flights does not count"
    )
    work = parser.add_argument_group("who computes")
    work.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes of this machine (one a core; 0: this one alone)",
    )
    work.add_argument(
        "--memory-per-worker",
        default="",
        metavar="SIZE",
        help="bound of each, as 4GB (an equal share of the machine's)",
    )
    work.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="a Dask cluster instead, as tcp://host:8786, whose workers see inputs and OUT by the same paths",
    )
    return parser
