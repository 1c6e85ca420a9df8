# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_stereo map INPUT -o OUT``."""

import argparse
import sys
from pathlib import Path
from typing import List, Optional

from tqdm import tqdm

from fcsv_geometry.errors import FcsvError
from fcsv_stereo import pipeline
from fcsv_stereo.equations import parse_threshold
from fcsv_stereo.matchers import MATCHERS, DisparityWindow
from fcsv_stereo.rectify import RECTIFIERS
from fcsv_stereo.table import demo_table
from fcsv_stereo.thesis import ThesisOptions

_EXAMPLES = """examples:
  map out/demo/session -o out/map
  map photos/ -o out/photos --reference 0003.jpg --matcher sgbm --disparity 16 256
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 with a map, 2 with one line on stderr that says what is wrong, 130 on Ctrl-C."""
    args = _parser().parse_args(argv)
    bar = None

    def progress(name: str, done: int, total: int) -> None:
        nonlocal bar
        if bar is None:
            bar = tqdm(total=total, unit="pair", disable=None)
        bar.set_description(name)
        bar.update(done - bar.n)
        if done == total:
            bar.close()

    try:
        document = pipeline.run(Path(args.input), Path(args.out), args.method, _options(args), args.reference, progress)
    except (FcsvError, ValueError) as error:
        print(f"map: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("map: interrupted; nothing was written", file=sys.stderr)
        return 130
    print(demo_table(document))
    print(f"wrote {args.out}: map.ply, depth.npy, sigma.npy, report.json, report.html")
    return 0


def _options(args) -> ThesisOptions:
    return ThesisOptions(
        matcher=args.matcher,
        rectifier=args.rectify,
        window=DisparityWindow(*args.disparity),
        threshold=parse_threshold(args.error),
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="map", description="Depth, a cloud and a report from posed pictures.", epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    window = DisparityWindow()
    parser.add_argument("input", help="a session folder, a bag, or a folder of posed photographs (COLMAP text model)")
    parser.add_argument("-o", "--out", required=True, help="folder for the map; an earlier map in it is replaced")
    parser.add_argument("--method", choices=sorted(pipeline.METHODS), default="thesis")
    parser.add_argument("--reference", help="photographs: name of the reference picture (default: first in images.txt)")
    parser.add_argument("--matcher", choices=sorted(MATCHERS), default="quasi-dense")
    parser.add_argument(
        "--rectify", choices=sorted(RECTIFIERS), help="default: home for sessions, bouguet for photographs"
    )
    parser.add_argument(
        "--error", default="10%", help="accepted depth error: metres, or a share of the distance (10%%)"
    )
    parser.add_argument(
        "--disparity", nargs=2, type=float, metavar=("LEAST", "MOST"), default=[window.least_px, window.most_px],
        help=f"disparities in px that count (default {window.least_px:g} {window.most_px:g})",
    )  # fmt: skip
    return parser
