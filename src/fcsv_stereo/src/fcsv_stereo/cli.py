# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_stereo map INPUT -o OUT``."""

import argparse
import math
import shlex
import sys
from functools import partial
from pathlib import Path
from typing import List, Optional, Union

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs import commands
from fcsv_geometry.programs.live_line import LiveLine, Steps
from fcsv_geometry.version import VERSION
from fcsv_stereo import pipeline
from fcsv_stereo.equations import ErrorThreshold, parse_threshold
from fcsv_stereo.errors import InputError
from fcsv_stereo.joint import JointOptions
from fcsv_stereo.map_files.cloud_bounds import CloudBounds
from fcsv_stereo.map_files.table import demo_table
from fcsv_stereo.model import AXES, RIG, PosePrior
from fcsv_stereo.products import PRODUCTS, parse_products
from fcsv_stereo.rectify import Rectification
from fcsv_stereo.refinement import RefineOptions
from fcsv_stereo.thesis import ThesisOptions
from fcsv_stereo.thesis.matchers import MATCHERS, DisparityWindow

#: Options that only one method knows.
_OPTIONS_OF = {
    "thesis": (
        "matcher",
        "rectify",
        "disparity",
        "across_axes",
        *(f"trim_{k}" for k in (*AXES, "all")),
    ),
    "joint": (
        "bars",
        "complete",
        "no_refine",
        "prior_rotation_deg",
        "prior_position_m",
        "prior_position_percent",
        "prior_scale_percent",
        "rig",
        "refine_focal",
        "keep_camera",
        "refine_time_offset",
    ),
}
_EXAMPLES = """examples:
  map out/demo/session -o out/map
  map photos/ -o out/photos --reference 0003.jpg --method thesis --matcher sgbm --disparity 16 256
  map photos/ -o out/photos --products laz,orthophoto,colmap
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 with a map, 2 with one line on stderr that says what is wrong, 130 on
    Ctrl-C."""
    given = sys.argv[1:] if argv is None else argv
    action = partial(_map, command=command_line(sys.argv[0], given))
    return commands.run(_parser(), argv, action, (FcsvError, ValueError), "nothing was written")


def command_line(program: str, given: List[str]) -> str:
    """What a user pastes to make the map again.

    >>> command_line("/usr/bin/fcsv", ["my photos", "-o", "out"])
    "fcsv map 'my photos' -o out"
    """
    name = "fcsv map" if Path(program).name == "fcsv" else "rosrun fcsv_stereo map"
    return f"{name} {shlex.join(given)}"


def _map(args, command: str) -> None:
    products = parse_products(args.products)
    poi = Path(args.poi) if args.poi else None
    options, instant = _options(args), _instant(args.instant)
    bounds = CloudBounds.of_words(args.cloud_range_m, args.cloud_sigma)
    request = pipeline.MapRequest(
        Path(args.input),
        Path(args.out),
        args.method,
        options,
        reference=args.reference,
        view=args.view,
        poi=poi,
        products=products,
        instant=instant,
        bounds=bounds,
        near=not args.no_near,
        command=command,
        robot=args.robot,
    )
    with Steps(LiveLine(sys.stderr), "reading pictures").shown() as steps:
        document = pipeline.run(request, steps.begin)
    print(demo_table(document))
    written = ["map.ply", "depth.npy", "sigma.npy", "kind.npy", "report.json", "report.html"]
    print(f"wrote {args.out}: {', '.join(written + [f for p in products for f in PRODUCTS[p]])}")


def _instant(word: Optional[str]) -> Optional[str]:
    """Raises InputError where it is neither ``last`` nor a time."""
    try:
        if word in (None, "last") or math.isfinite(float(word)):
            return word
    except ValueError:
        pass
    raise InputError(f"--instant {word}: is neither a stamp in seconds nor 'last'")


def _options(args) -> Union[JointOptions, ThesisOptions]:
    _refuse_foreign(args)
    return _MAKERS[args.method](args, parse_threshold(args.error))


def _joint(args, threshold: ErrorThreshold) -> JointOptions:
    refinement = RefineOptions(
        refine_focal=args.refine_focal,
        correct_camera=not args.keep_camera,
        calibrated=args.rig,
        refine_time_offset=args.refine_time_offset,
    )
    prior = _prior(args)
    kept = {"complete": args.complete, "bars": args.bars}
    return JointOptions(not args.no_refine, refinement, threshold=threshold, prior=prior, **kept)


def _prior(args) -> Optional[PosePrior]:
    """What the user says of the poses; what he does not say stays as it is assumed, of a rig as of
    a rig."""
    rotation_deg, position_m, percent = (
        args.prior_rotation_deg,
        args.prior_position_m,
        args.prior_position_percent,
    )
    scale_percent = args.prior_scale_percent
    assumed = RIG if args.rig else PosePrior()
    if rotation_deg is None and position_m is None and percent is None and scale_percent is None:
        return assumed if args.rig else None
    if position_m is None and percent is None:
        position_m, share = assumed.position_m, assumed.position_share
    else:
        position_m, share = position_m or 0.0, (percent or 0.0) / 100.0
    rotation_rad = assumed.rotation_rad if rotation_deg is None else math.radians(rotation_deg)
    return PosePrior(rotation_rad, position_m, share, (scale_percent or 0.0) / 100.0)


def _thesis(args, threshold: ErrorThreshold) -> ThesisOptions:
    return ThesisOptions(
        matcher=args.matcher or ThesisOptions.matcher,
        rectifier=args.rectify,
        window=DisparityWindow(*args.disparity) if args.disparity else DisparityWindow(),
        threshold=threshold,
        trim_m={k: v for k in (*AXES, "all") for v in [getattr(args, f"trim_{k}")] if v},
        across_axes=args.across_axes,
    )


#: Options out of arguments, by method.
_MAKERS = {"joint": _joint, "thesis": _thesis}


def _refuse_foreign(args) -> None:
    """An option of another method would be ignored in silence. Raises InputError."""
    for method, names in _OPTIONS_OF.items():
        given = [n for n in names if getattr(args, n) is not None and getattr(args, n) is not False]
        if method != args.method and given:
            option = "--" + given[0].replace("_", "-")
            raise InputError(
                f"{option} belongs to --method {method}; the method here is {args.method}"
            )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="map",
        description="Depth, a cloud and a report from posed pictures.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    window = DisparityWindow()
    parser.add_argument(
        "input",
        help="a session folder, a bag, or a folder of posed photographs (COLMAP text model)",
    )
    parser.add_argument(
        "-o", "--out", required=True, help="folder for the map; an earlier map in it is replaced"
    )
    parser.add_argument("--version", action="version", version=f"fcsv {VERSION}")
    parser.add_argument(
        "--method", choices=sorted(pipeline.METHODS), default=pipeline.DEFAULT_METHOD
    )
    parser.add_argument(
        "--reference",
        help="photographs: name of the reference picture (default: first in images.txt)",
    )
    parser.add_argument(
        "--view",
        default="",
        metavar="NAME",
        help="sessions with stations: which is mapped, such as 'north at 30 deg' (all of them: survey)",
    )
    parser.add_argument(
        "--instant",
        nargs="?",
        const="last",
        metavar="STAMP",
        help="sessions: only the pictures of one instant (within 20 ms), so that what moves is mapped where it was; "
        "by default that of the middle of the last recording",
    )
    parser.add_argument(
        "--no-near",
        action="store_true",
        help="sessions: leave out what depth cameras recorded; default: it is joined with the map (docs/user/maps.md)",
    )
    listed = f"also: {','.join(PRODUCTS)}; all: without ground"
    parser.add_argument("--products", default="", metavar="LIST", help=listed)
    parser.add_argument(
        "--robot", type=Path, metavar="FILE", help="ground: the robot (config/robots/NAME.yaml)"
    )
    parser.add_argument(
        "--cloud-range-m",
        default="auto",
        metavar="M",
        help="farthest depth of the clouds (map.ply, products); 'none': any; by default where one pixel of disparity "
        "on the widest baseline is 20 %% of the distance",
    )
    parser.add_argument(
        "--cloud-sigma",
        metavar="SHARE",
        help="largest standard deviation of the clouds' points: a share of the depth (default 20%%), metres, or 'none'",
    )
    parser.add_argument("--matcher", choices=sorted(MATCHERS), help="thesis: default quasi-dense")
    parser.add_argument(
        "--rectify",
        choices=sorted(r.value for r in Rectification),
        help="thesis: default home for sessions, bouguet for photographs",
    )
    parser.add_argument(
        "--error",
        default="10%",
        help="accepted depth error: metres, or a share of the distance (10%%)",
    )
    parser.add_argument(
        "--disparity",
        nargs=2,
        type=float,
        metavar=("LEAST", "MOST"),
        help=f"thesis: disparities in px that count (default {window.least_px:g} {window.most_px:g})",
    )
    for name in (*AXES, "all"):
        parser.add_argument(
            f"--trim-{name}",
            nargs="+",
            type=float,
            metavar="M",
            help=f"thesis: far end (m) of each {'' if name == 'all' else name + ' '}baseline's range, shortest first",
        )
    parser.add_argument(
        "--across-axes",
        action="store_true",
        help="thesis: horizontal and vertical baselines share out the range (several configurations at once)",
    )
    parser.add_argument(
        "--poi",
        metavar="FILE",
        help="points of interest to evaluate (default: INPUT/poi.yaml, if any)",
    )
    parser.add_argument(
        "--complete",
        action="store_true",
        help="joint: also depths that no pair's texture supports (hidden, plain, outside); kind.npy marks them",
    )
    parser.add_argument(
        "--bars",
        action="store_true",
        help="joint: also match straight thin things (conductors, rails) by their edges, where the map has no depth",
    )
    parser.add_argument(
        "--no-refine", action="store_true", help="joint: take the poses as they come"
    )
    parser.add_argument(
        "--rig",
        action="store_true",
        help="joint, photographs: of a calibrated stereo rig: intrinsics are known, poses to "
        f"{math.degrees(RIG.rotation_rad):.2g} degrees and {100 * RIG.position_share:.2g} %% of the baseline per axis "
        "(--prior-... says otherwise)",
    )
    for name, words in (
        ("rotation-deg", "degrees, standard deviation per axis"),
        ("position-m", "m, standard deviation per axis"),
        (
            "position-percent",
            "of the distance from the reference picture, standard deviation per axis",
        ),
        ("scale-percent", "of one scale that all positions share, standard deviation"),
    ):
        parser.add_argument(
            f"--prior-{name}",
            type=float,
            metavar="X",
            help=f"joint, photographs: how good the poses are ({words}; by default 0.3 degrees, 1 %% of the distance "
            "and 0.5 %% of the median distance); priors.csv says it for each",
        )
    parser.add_argument(
        "--refine-focal", action="store_true", help="joint: also adjust the focal length"
    )
    parser.add_argument(
        "--keep-camera",
        action="store_true",
        help="joint: do not correct a rolling shutter or a wrong focal length that the pictures show",
    )
    parser.add_argument(
        "--refine-time-offset", action="store_true", help="joint: also adjust each vehicle's clock"
    )
    return parser
