# SPDX-License-Identifier: Apache-2.0
"""make study: chapter 3 of the thesis again on the simulated town; docs/lab/study.md and
docs/pictures/study/."""

import argparse
import os
import platform
import sys
import time
from pathlib import Path

import methods
from baselines import growing, house
from fusion import at_once, axes, trimming
from headline import headline
from interest import interest
from nearest import nearest
from page import Page
from rectification import rectification
from seams import seams
from sweeps import sweeps
from tilt import tilt

from fcsv_geometry.errors import FcsvError

SECTIONS = {
    "growing": growing,
    "house": house,
    "trimming": trimming,
    "axes": axes,
    "tilt": tilt,
    "at_once": at_once,
    "rectification": rectification,
    "interest": interest,
    "nearest": nearest,
    "seams": seams,
    "sweeps": sweeps,
}


def main() -> int:
    """Exit status 0 with the page written, 2 with one line that says what is wrong."""
    args = _arguments()
    page = Page(Path(args.out), Path(args.pictures))
    started = time.perf_counter()
    page.text(
        "# Study",
        f"Chapter 3 of the thesis again on the simulated town, by `make study`, {time.strftime('%Y-%m-%d')}, "
        f"{platform.machine()} with {os.cpu_count()} cores, Python {platform.python_version()}; methods: "
        f"{', '.join(methods.names())}. Pictures are 640x480 with 56° (f = 601.8 px), as in table 6.2. Truth is "
        "the renderer's depth. *Covered*, *answered*: a depth was given. *Within 10 %*: of all pixels of the range, "
        "answered or not. *Wrong*: by more than 10 %. "
        "Processor time is that of all threads together.",
    )
    try:
        if args.demo and not (Path(args.demo) / "map" / "report.json").is_file():
            raise FcsvError(
                f"{args.demo}: holds no map/report.json; give the folder that make demo left"
            )
        for name, section in SECTIONS.items():
            if not args.only or name in args.only:
                print(f"[{time.perf_counter() - started:6.1f} s] {name}", flush=True)
                section(page)
        if not args.only or "headline" in args.only:
            headline(page, Path(args.demo) if args.demo else None)
    except FcsvError as error:
        print(f"study: {error}", file=sys.stderr)
        return 2
    page.write()
    print(
        f"[{time.perf_counter() - started:6.1f} s] wrote {args.out} and pictures to {args.pictures}"
    )
    return 0


def _arguments():
    parser = argparse.ArgumentParser(prog="study", description=__doc__)
    parser.add_argument("--out", default="docs/lab/study.md")
    parser.add_argument("--pictures", default="docs/pictures/study")
    parser.add_argument(
        "--demo", metavar="FOLDER", help="what a make demo left: its clock goes into the headline"
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[*SECTIONS, "headline"],
        help="some sections (give another --out)",
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
