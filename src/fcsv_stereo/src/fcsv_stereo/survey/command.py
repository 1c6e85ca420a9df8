# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_stereo survey INPUT... -o OUT``."""

import argparse
import sys
from pathlib import Path
from typing import List, Optional

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs import commands
from fcsv_geometry.programs.live_line import LiveLine, Steps
from fcsv_stereo.survey.document import Site, overlaps
from fcsv_stereo.survey.survey import FILES, run

_EXAMPLES = """examples:
  survey flights/north flights/east flights/south -o out/site
  survey out/map1 out/map2 photos/ -o out/site
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0; 1 where an input is not in the site; 2 with one line on stderr on bad input;
    130 on Ctrl-C."""
    left = "maps that were finished are kept in OUT/views: the same command goes on"
    return commands.run(_parser(), argv, _survey, (FcsvError, ValueError), left)


def _survey(args: argparse.Namespace) -> int:
    with Steps(LiveLine(sys.stderr), "reading inputs").shown() as steps:
        site = run([Path(p) for p in args.inputs], Path(args.out), begin=steps.begin)
    print("\n".join(summary(site)))
    print(f"wrote {args.out}: {', '.join(FILES)}")
    return 1 if site.missing else 0


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
            f"{len(site.joined[name].cloud):,} points"
        )
    kept = sum(e.kept for e in adjusted.edges)
    lines.append(f"{kept} of {len(adjusted.edges)} pairs of views are joined")
    if adjusted.loops:
        worst = max(adjusted.loops, key=lambda loop: loop.closing_m)
        lines.append(
            f"{len(adjusted.loops)} loops; the worst closes to {worst.closing_m:.2f} m and {worst.closing_scale:.2%} "
            f"of scale: {', '.join(worst.views)}"
        )
    lines += adjusted.remarks
    lines += [f"MISSING {m.name}: {m.reason}" for m in site.missing]
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
    return parser
