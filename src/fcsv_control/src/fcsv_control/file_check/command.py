# SPDX-License-Identifier: Apache-2.0
"""The command that checks configuration files, with ROS or without: one line for each, exit status
1 on an error."""

import argparse
import sys
from pathlib import Path
from typing import List, Optional

from fcsv_control.file_check.checking import check, files_of
from fcsv_control.file_check.kinds import KINDS
from fcsv_geometry.programs.commands import run

_EXAMPLES = """examples:
  check my_mission.yaml                                    one file; its kind is found out
  check config                                             all files below a folder
  check config/missions/five.yaml --vehicles uav1,uav2,uav3,uav4,uav5     may this column fly it: ways, fence, time
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 where all files are good, 1 where one is not, 2 where there is none to
    check."""
    return run(_parser(), argv, _check)


def _check(args: argparse.Namespace) -> int:
    files = files_of([Path(f) for f in args.file])
    if not files:
        print(f"check: {' '.join(args.file)} holds no YAML and no parameter file", file=sys.stderr)
        return 2
    vehicles = [name for name in args.vehicles.split(",") if name]
    findings = [check(file, args.kind or "", vehicles, args.vehicles_dir) for file in files]
    for finding in findings:
        print(finding.words)
    wrong = sum(bool(finding.problem) for finding in findings)
    if len(findings) > 1:
        print(
            f"{len(findings)} files: {wrong} with an error"
            if wrong
            else f"{len(findings)} files: all ok"
        )
    return 1 if wrong else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="check",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Check configuration files by the parsers that read them in flight; exit status 1 on an error.",
    )
    parser.add_argument(
        "file",
        nargs="+",
        metavar="FILE",
        help="configuration file, or a folder: all files below it",
    )
    parser.add_argument(
        "--kind", choices=list(KINDS), help="kind of the files; default: by content and folder"
    )
    parser.add_argument(
        "--vehicles",
        default="",
        metavar="NAME,...",
        help="of missions check, too, whether this column, front first, can fly them",
    )
    parser.add_argument(
        "--vehicles-dir",
        default="",
        metavar="FOLDER",
        help="files of those vehicles; default: vehicles/ beside the folder of the mission, "
        "else the workspace's config/vehicles",
    )
    return parser
