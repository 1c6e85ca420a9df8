# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_control repair_bag``: bags that were never closed, or are damaged, become
readable."""

import argparse
import sys
from pathlib import Path
from typing import List, Optional

from tqdm import tqdm

from fcsv_control.errors import SessionError
from fcsv_geometry.bags.repair import ACTIVE, KEPT, repaired
from fcsv_geometry.errors import BagError
from fcsv_geometry.programs import commands


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0; 1 where a bag could not be repaired, 2 where there is none."""
    return commands.run(_parser(), argv, _repair)


def _repair(args) -> int:
    failed = 0
    for path in _bags(args.paths):
        try:
            size = path.stat().st_size
            with tqdm(total=size, unit="B", unit_scale=True, desc=path.name, leave=False) as bar:
                target, salvaged = repaired(
                    path, lambda at, bar=bar: bar.update(max(at - bar.n, 0))
                )
        except (BagError, OSError) as error:
            print(f"not repaired: {error}", file=sys.stderr)
            failed += 1
            continue
        if salvaged is None:
            print(f"{path}: whole" + (f"; now {target.name}" if target != path else ""))
        else:
            print(f"{target}: {salvaged}; the original is {target.name}{KEPT}")
            print("".join(f"  {text}\n" for text in salvaged.problems), end="")
    return 1 if failed else 0


def _bags(paths: List[Path]) -> List[Path]:
    bags = []
    for path in paths:
        if not path.exists():
            raise SessionError(f"{path}: does not exist")
        bags += (
            [p for e in ("", ACTIVE) for p in sorted(path.glob(f"*.bag{e}"))]
            if path.is_dir()
            else [path]
        )
    if not bags:
        raise SessionError(f"{paths[0]}: there is no bag in it")
    return bags


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="repair_bag",
        description="Makes bags readable that were cut off or damaged; the originals are kept as NAME.bag.broken.",
    )
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="BAG", help="bags, or folders of bags (a session)"
    )
    return parser
