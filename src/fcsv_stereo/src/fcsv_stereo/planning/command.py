# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_stereo plan --range-m 400 --error 10% ...``."""

import argparse
import os
import sys
from pathlib import Path
from typing import List, Optional, Sequence

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import read_camera
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs.writing import in_words
from fcsv_stereo.equations import parse_threshold
from fcsv_stereo.errors import OutputError, PlanError
from fcsv_stereo.model import AXES
from fcsv_stereo.planning.mission import (
    MIN_SEPARATION_M,
    RECORD_S,
    map_arguments,
    mission_document,
    write_mission,
)
from fcsv_stereo.planning.plan import Plan, PlanRequest, make_plan

_SIZE, _FOV_DEG = (640, 480), 56.0  # of the thesis's camera (table 6.2), where none is named
_EXAMPLES = """examples:
  plan --range-m 400 --error 10%                                      four baselines by equations 3.2 and 3.3
  plan --range-m 400 --error 10% --baselines 2 4 6 8                  by hand (3.2): trim points 120, 240, 360 m
  plan --range-m 40 --error 0.5 --number 3 --figures out/plan         the example of figure 3.7
  plan --range-m 120 --error 10% --baselines 2 4 6 8 --trim 30 60 90 120 --mission my.yaml
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 with a table, 2 with one line on stderr that says what is wrong; then nothing
    is written."""
    args = _parser().parse_args(argv)
    try:
        plan = make_plan(_request(args))
        document = (
            mission_document(plan, args.name, args.record_s, args.min_separation_m)
            if args.mission
            else None
        )
        print("\n".join(filter(None, (table(plan), _whose_camera(args)))))
        if args.figures:
            _write_figures(plan, Path(args.figures))
        if document:
            write_mission(document, Path(args.mission))
            print("\n".join(_next_commands(Path(args.mission), plan)))
    except FcsvError as error:
        print(f"plan: {error}", file=sys.stderr)
        return 2
    return 0


def _next_commands(mission: Path, plan: Plan) -> List[str]:
    """What to do with a mission that was written, as commands to paste."""
    trim = " ".join(map_arguments(plan))
    workspace = os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep)[0]
    return [
        f"wrote {mission}",
        *([f"in a new terminal, first: . {workspace}/setup.sh"] if workspace else []),
        f"rehearse it:            rosrun fcsv_sim rehearse {mission}",
        f"fly it in simulation:   make demo MISSION={mission} OUT=out/{mission.stem}",
        f"fly it with vehicles:   docs/user/flying.md, with mission:={mission.resolve()}",
        "map what was flown:     rosrun fcsv_stereo map SESSION -o OUT",
        f"as the thesis maps:     rosrun fcsv_stereo map SESSION -o OUT --method thesis {trim}",
    ]


def table(plan: Plan) -> str:
    """Text: one line per configuration, then what to know before flying it."""
    request = plan.request
    share = f"{request.threshold.value:.4g} m at every distance (10% is a share of it)"
    if request.threshold.relative:
        share = f"{request.threshold.value * 100:.4g} % of the distance"
    lines = [
        f"focal length {request.camera.fx:.1f} px, disparity error {request.disparity_error_px:g} px, accepted {share}"
    ]
    lines.append(
        f"{'axis':<11}{'baseline':>10}{'tilt':>8}{'effective range':>20}{'limit (eq. 3.1)':>17}"
        f"{'error at its end':>18}{'views overlap from':>20}{'seen by one, near / far':>25}"
    )
    for b in plan.baselines:
        span = f"{_metres(b.range_m[0])} to {_metres(b.range_m[1])} m"
        unshared = f"{b.non_overlap[0]:.0%} / {b.non_overlap[1]:.0%}"
        lines.append(
            f"{b.axis:<11}{f'{b.baseline_m:.2f} m':>10}{f'{np.degrees(b.tilt_rad):.1f} deg':>8}{span:>20}"
            f"{f'{b.farthest_m:.1f} m':>17}{f'{b.error_m:.2f} m':>18}{f'{b.overlap_starts_m:.1f} m':>20}{unshared:>25}"
        )
    return "\n".join([*lines, *(f"note: {n}" for n in plan.notes)])


def _whose_camera(args) -> str:
    """A line that says so where no camera was named."""
    if args.camera or args.focal_px is not None or args.fov_deg is not None:
        return ""
    return f"no camera named: planned for the D435's {_FOV_DEG:g} degrees; --camera FILE plans for your own"


def _metres(z_m: float) -> str:
    return f"{z_m:.0f}" if abs(z_m - round(z_m)) < 1e-6 else f"{z_m:.2f}"


def _request(args) -> PlanRequest:
    axes = AXES if args.axis == "both" else (args.axis,)
    return PlanRequest(
        range_m=args.range_m,
        threshold=parse_threshold(args.error),
        camera=_camera(args),
        nearest_m=args.nearest_m,
        count=args.number,
        baselines_m=args.baselines,
        trim_m=args.trim,
        whole=args.whole,
        disparity_error_px=args.disparity_error_px,
        axes=axes,
        tilt_per_m_rad=float(np.radians(args.tilt_per_m_deg)),
    )


def _camera(args) -> PinholeCamera:
    """Makes the camera of the calibration file, without its distortion: pairs are matched
    undistorted; or of an angle of view."""
    if args.camera:
        if any(given is not None for given in (args.focal_px, args.fov_deg, args.size)):
            raise PlanError(
                "--camera has size and focal length: leave --focal-px, --fov-deg and --size out"
            )
        return read_camera(Path(args.camera))[1].undistorted()
    return _by_angle(
        args.size or _SIZE, _FOV_DEG if args.fov_deg is None else args.fov_deg, args.focal_px
    )


def _by_angle(size: Sequence[int], fov_deg: float, focal_px: Optional[float]) -> PinholeCamera:
    width, height = size
    if width < 1 or height < 1 or not 1 <= fov_deg <= 170:
        raise PlanError(f"--size {width} {height} --fov-deg {fov_deg:g} is not a camera")
    camera = PinholeCamera.from_fov(width, height, np.radians(fov_deg))
    return (
        camera
        if focal_px is None
        else PinholeCamera(width, height, focal_px, focal_px, camera.cx, camera.cy)
    )


def _write_figures(plan: Plan, folder: Path) -> None:
    from fcsv_stereo.planning import figures  # matplotlib is slow to load, and a table needs none

    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, draw in (
            ("error_curves.png", figures.error_curves),
            ("segments.png", figures.segments),
        ):
            draw(plan).savefig(folder / name, dpi=110, bbox_inches="tight")
            print(f"wrote {folder / name}")
    except OSError as error:
        raise OutputError(in_words(error, folder)) from error


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="plan",
        description="The baselines to fly, their effective ranges, the predicted error.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "--range-m",
        type=float,
        required=True,
        help="largest distance (m) at which the error must hold",
    )
    add(
        "--error",
        default="10%",
        help="accepted error of depth: metres (0.5), or a share of the distance (10%%)",
    )
    add(
        "--nearest-m", type=float, default=0.0, help="smallest distance (m) of interest (default 0)"
    )
    add(
        "--number",
        "-n",
        type=int,
        help="how many baselines (default 4, without those that are too short to be flown)",
    )
    add(
        "--whole",
        action="store_true",
        help="round baselines up to whole metres, trim points down to two digits (6.6)",
    )
    add(
        "--baselines",
        type=float,
        nargs="+",
        metavar="M",
        help="baselines (m) by hand, instead of --number",
    )
    add(
        "--trim",
        type=float,
        nargs="+",
        metavar="M",
        help="far end (m) of each baseline's range by hand",
    )
    add("--axis", choices=[*AXES, "both"], default=AXES[0])
    add(
        "--tilt-per-m-deg",
        type=float,
        default=0.0,
        help="inward tilt (degrees) per metre of baseline (1 in 3.5)",
    )
    add("--disparity-error-px", type=float, default=1.0, help="error of matching (default 1 px)")
    add(
        "--camera",
        metavar="FILE",
        help="your own camera's calibration (calibrate_camera, camera_calibration)",
    )
    add("--focal-px", type=float, help="focal length (px), instead of --fov-deg")
    add(
        "--fov-deg", type=float, help="horizontal angle of view (default 56: the D435's at 640x480)"
    )
    add(
        "--size",
        type=int,
        nargs=2,
        metavar=("WIDTH", "HEIGHT"),
        help="picture (px; default 640 480)",
    )
    add(
        "--figures",
        metavar="FOLDER",
        help="draw error_curves.png (figure 2.3) and segments.png (figure 3.7) there",
    )
    add("--mission", metavar="FILE", help="write the mission that flies this plan")
    add("--name", default="planned", help="the mission's name")
    add(
        "--record-s",
        type=float,
        default=RECORD_S,
        help="mission: seconds of recording at each place",
    )
    add(
        "--min-separation-m",
        type=float,
        default=MIN_SEPARATION_M,
        help="mission: least distance between vehicles",
    )
    return parser
