# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_control gather_session``: the bags of all machines into one folder, checked, with
session.yaml."""

import argparse
import sys
from pathlib import Path
from typing import List, Optional

from tqdm import tqdm

from fcsv_control.errors import SessionError
from fcsv_control.gathering import RSH, Gatherer, parse_source
from fcsv_geometry.programs import commands


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0; 1 where something is missing or was damaged, 2 where nothing can be
    gathered."""
    return commands.run(_parser(), argv, _gather)


def _gather(args) -> int:
    sources = [parse_source(text) for text in args.sources]
    names = [s.machine for s in sources]
    twice = [n for n in names if names.count(n) > 1]
    if twice:
        raise SessionError(f"'{twice[0]}' is named twice")
    gatherer = Gatherer(args.out, args.rsh)
    there = {s: gatherer.list(s) for s in sources}
    gatherer.require_room(
        {n: size for bags in there.values() for n, size in gatherer.lacking(bags).items()}
    )
    for source, bags in there.items():
        size = sum(gatherer.lacking(bags).values())
        with tqdm(total=size, unit="B", unit_scale=True, desc=source.machine) as bar:
            gatherer.fetch(source, bags, lambda at, bar=bar: bar.update(max(at - bar.n, 0)))
        if source.machine == "control":
            gatherer.fetch_description(source)
    described = gatherer.describe()
    gathered = gatherer.gathered
    for machine, bags in gathered.bags.items():
        print(f"{machine}: {', '.join(bags)}")
    if gathered.bags:
        print(
            f"wrote {described or args.out}; next: rosrun fcsv_stereo map {args.out} -o OUT",
            flush=True,
        )
    for problem in gathered.problems:  # last: what is missing must not be overlooked
        print(problem, file=sys.stderr)
    if not gathered.bags:
        raise SessionError(f"{args.out}: no bag was gathered")
    return 1 if gathered.problems else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="gather_session",
        description="Collects the bags of a flight from all machines. A transfer that was cut off goes on when it is "
        "started again. Nothing is removed from the machines.",
        epilog="example: gather_session out/flight uav1=pilot@192.168.8.11:fcsv/session "
        "uav2=pilot@192.168.8.12:fcsv/session control=fcsv/session",
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the session")
    parser.add_argument(
        "sources", nargs="+", metavar="NAME=PLACE", help="HOST:FOLDER over ssh, or a folder"
    )
    parser.add_argument(
        "--rsh", default=RSH, help="remote shell, as rsync's --rsh (default: %(default)s)"
    )
    return parser
