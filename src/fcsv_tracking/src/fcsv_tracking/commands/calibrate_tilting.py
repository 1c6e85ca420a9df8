# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_tracking calibrate_tilting``: axes and mounts of a tilting stereo camera from a
board of tags."""

import argparse
import time
from pathlib import Path
from typing import List, Optional

from fcsv_geometry.programs.writing import require_folder
from fcsv_tracking import commands
from fcsv_tracking.errors import CalibrationRefused
from fcsv_tracking.tilting.board import VIEWS, TagBoard, read_views
from fcsv_tracking.tilting.calibrate import TiltRules, calibrate
from fcsv_tracking.tilting.rig import SIDES, load_rig
from fcsv_tracking.tilting.rig_file import write_rig

_EXAMPLES = f"""examples:
  calibrate_tilting config/tilting/rig.yaml board/ -o my_rig.yaml --board 4x3 --size-m 0.06 --gap-m 0.02

{VIEWS} in the folder lists the pictures: picture,station,side,angle_deg. Rig and board stand still within a station.
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 with a rig's file written, 2 with one line that says why not."""
    return commands.run(_parser(), argv, _calibrate)


def _calibrate(args) -> None:
    out = Path(args.out)
    if out.is_dir():
        raise CalibrationRefused(f"{out}: is a folder; give a file with -o")
    require_folder(out.absolute().parent)
    rig = load_rig(args.rig)
    board = TagBoard(*_size(args.board), args.size_m, args.gap_m, args.first_id)
    views = read_views(Path(args.pictures), rig, board)
    found = calibrate(rig, views, TiltRules(least_views=args.least_views))
    written = write_rig(
        out,
        found.rig,
        f"calibrate_tilting {args.pictures}, {time.strftime('%Y-%m-%d')}: {len(views)} views",
    )
    print(
        f"{len(views)} views, {found.used} corners used, {found.rejected} left out, rms {found.rms_px:.3f} px"
    )
    for side in SIDES:
        axis = getattr(written, side).axis
        print(f"  {side} axis at {_words(axis.xyz_m)} m, direction {_words(axis.direction)}")
    mount = written.right.mount
    print(
        f"  right camera at {_words(mount.xyz_m)} m, {_words(mount.rpy_deg)} deg; baseline {written.baseline_m:.4f} m"
    )
    print(
        f"  known to {written.known.rotation_deg:.3f} deg and {written.known.position_m * 1e3:.2f} mm per axis"
    )
    print(f"wrote {out}")


def _words(values) -> str:
    return ", ".join(f"{v:.4f}" for v in values)


def _size(text: str):
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise CalibrationRefused(
            f"--board '{text}': give tags as COLUMNSxROWS, such as 4x3"
        ) from error
    return columns, rows


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calibrate_tilting",
        description="Axes and mounts of a tilting stereo camera from a board of tags.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    board, rules = TagBoard(), TiltRules()
    parser.add_argument(
        "rig", help="the rig's file as measured by hand: centimetres and degrees are good enough"
    )
    parser.add_argument("pictures", help=f"a folder of pictures of the board, and {VIEWS}")
    parser.add_argument("-o", "--out", required=True, help="the rig's file with what was found")
    parser.add_argument(
        "--board",
        default=f"{board.columns}x{board.rows}",
        help="tags COLUMNSxROWS (default %(default)s)",
    )
    parser.add_argument(
        "--size-m",
        type=float,
        default=board.size_m,
        help="edge of a black square (default %(default)s)",
    )
    parser.add_argument(
        "--gap-m",
        type=float,
        default=board.gap_m,
        help="between black squares (default %(default)s)",
    )
    parser.add_argument(
        "--first-id",
        type=int,
        default=board.first_id,
        help="of the top left tag (default %(default)s)",
    )
    parser.add_argument(
        "--least-views",
        type=int,
        default=rules.least_views,
        help="of a camera (default %(default)s)",
    )
    return parser
