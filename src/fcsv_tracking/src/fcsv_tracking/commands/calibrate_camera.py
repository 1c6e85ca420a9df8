# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_tracking calibrate_camera``: intrinsics, and a stereo pair, from pictures of a chessboard."""

import argparse
from pathlib import Path
from typing import List, Optional, Tuple

from tqdm import tqdm

from fcsv_geometry.camera_file import write_camera
from fcsv_geometry.programs.writing import require_folder
from fcsv_tracking import commands
from fcsv_tracking.cameras.board import Chessboard
from fcsv_tracking.cameras.coverage import write_coverage
from fcsv_tracking.cameras.intrinsics import Intrinsics, IntrinsicsRules, calibrate_intrinsics
from fcsv_tracking.cameras.pair_files import write_pair
from fcsv_tracking.cameras.pictures import (
    BoardViews,
    NamedPicture,
    collect_views,
    folder_pictures,
    read_gray,
    require_one_camera,
)
from fcsv_tracking.cameras.stereo import calibrate_stereo
from fcsv_tracking.errors import CameraCalibrationRefused

_EXAMPLES = """examples:
  calibrate_camera pictures/ -o out/camera --name uav1
  calibrate_camera pictures/ -o out/pair --prefix left --right-prefix right      # left01.jpg with right01.jpg
  calibrate_camera board.bag -o out/camera --topic /uav1/camera/color/image_raw --board 9x6 --square-m 0.025
"""


def main(argv: Optional[List[str]] = None) -> int:
    return commands.run(_parser(), argv, _calibrate)


def _calibrate(args) -> None:
    board = Chessboard(*_board_size(args.board), square_m=args.square_m)
    rules = IntrinsicsRules(least_views=args.least_views)
    out = Path(args.out)
    require_folder(out)
    sides = {"": (args.prefix, args.topic)}
    if args.right_prefix or args.right_topic:
        sides = {"left": (args.prefix, args.topic), "right": (args.right_prefix, args.right_topic)}
    found = {}
    for side, (prefix, topic) in sides.items():
        views = _views(Path(args.input), prefix, topic, board, side)
        found[side] = views, _intrinsics(views, board, rules, side)
    out.mkdir(parents=True, exist_ok=True)
    for side, (views, intrinsics) in found.items():
        name = side or args.name
        write_coverage(out / f"{name}_coverage.png", intrinsics, name)
        write_camera(out / f"{name}.yaml", name, intrinsics.camera)
        _print(name, views, intrinsics)
    if len(found) == 2:
        _stereo(found, board, out)
    print(
        f"wrote {out}: "
        + ", ".join(f"{s or args.name}.yaml, {s or args.name}_coverage.png" for s in found)
    )


def _intrinsics(
    views: BoardViews, board: Chessboard, rules: IntrinsicsRules, side: str
) -> Intrinsics:
    try:
        return calibrate_intrinsics(views.views, board, views.size, rules)
    except CameraCalibrationRefused as error:
        unusable = ", ".join(f"{name} ({why})" for name, why in views.left_out.items())
        where = f"{side} camera: " if side else ""
        raise CameraCalibrationRefused(
            f"{where}{error}" + (f"; not used: {unusable}" if unusable else "")
        ) from error


def _stereo(found, board: Chessboard, out: Path) -> None:
    (left_views, left), (right_views, right) = found["left"], found["right"]
    stereo = calibrate_stereo(left_views.views, right_views.views, board, left.camera, right.camera)
    write_pair(out, left.camera, right.camera, stereo)
    x, y, z = stereo.T_right_left[:3, 3] * 1e3
    print(
        f"stereo: baseline {stereo.baseline_m * 1e3:.2f} mm (left in right: {x:.2f}, {y:.2f}, {z:.2f} mm), "
        f"rms {stereo.rms_px:.3f} px over {len(stereo.pairs)} pairs"
    )
    _print_left_out(stereo.left_out)


def _print(name: str, views: BoardViews, found: Intrinsics) -> None:
    camera = found.camera
    print(
        f"{name}: {camera.width}x{camera.height}, rms {found.rms_px:.3f} px over {len(found.views)} views, "
        f"{found.coverage:.0%} of the picture covered"
    )
    for key, value, std in zip(
        ("fx", "fy", "cx", "cy"), (camera.fx, camera.fy, camera.cx, camera.cy), found.stds
    ):
        print(f"  {key} {value:9.3f} px, std {std:.3f}")
    print("  distortion " + " ".join(f"{d:.5f}" for d in camera.distortion))
    print(
        "  error per view [px]: "
        + ", ".join(f"{v.name} {e:.2f}" for v, e in zip(found.views, found.errors_px))
    )
    _print_left_out({**views.left_out, **found.left_out})


def _print_left_out(left_out) -> None:
    for name, why in left_out.items():
        print(f"  left out: {name}: {why}")


def _views(
    source: Path, prefix: Optional[str], topic: Optional[str], board: Chessboard, side: str
) -> BoardViews:
    pictures, total, thin = _pictures(source, prefix or "", topic)
    with tqdm(total=total, unit="picture", desc=side or source.name, disable=None) as bar:
        return collect_views(pictures, board, thin, lambda _name: bar.update())


def _pictures(
    source: Path, prefix: str, topic: Optional[str]
) -> Tuple[List[NamedPicture], Optional[int], bool]:
    if source.is_dir():
        named = folder_pictures(source, prefix)
        if not prefix:
            require_one_camera(source, [path.stem for _, path in named])
        return ((name, read_gray(path)) for name, path in named), len(named), False
    if source.suffix != ".bag":
        raise CameraCalibrationRefused(f"{source}: neither a folder of pictures nor a bag")
    from fcsv_tracking.ros import bags  # ROS is needed for bags alone

    topics = [topic] if topic else bags.topics_of([source], "sensor_msgs/Image")
    if len(topics) != 1:
        raise CameraCalibrationRefused(
            f"{source}: name one of its topics with --topic: {', '.join(topics) or 'none'}"
        )
    return (
        ((f"{stamp_s:.3f}", gray) for stamp_s, gray in bags.gray_pictures([source], topics[0])),
        None,
        True,
    )


def _board_size(text: str) -> Tuple[int, int]:
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise CameraCalibrationRefused(
            f"--board '{text}': give inner corners as COLUMNSxROWS, such as 9x6"
        ) from error
    return columns, rows


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calibrate_camera",
        description="A camera's intrinsics from pictures of a chessboard.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    board, rules = Chessboard(), IntrinsicsRules()
    parser.add_argument("input", help="a folder of pictures, or a bag")
    parser.add_argument(
        "-o", "--out", required=True, help="folder for NAME.yaml and NAME_coverage.png"
    )
    parser.add_argument(
        "--name",
        default="camera",
        help="camera_name in the file (default camera; pairs: left, right)",
    )
    parser.add_argument(
        "--board",
        default=f"{board.columns}x{board.rows}",
        help="inner corners COLUMNSxROWS (default %(default)s)",
    )
    parser.add_argument(
        "--square-m",
        type=float,
        default=board.square_m,
        help="edge of a square (default %(default)s)",
    )
    parser.add_argument(
        "--prefix", help="folder: only pictures whose name begins so; of the left camera in a pair"
    )
    parser.add_argument(
        "--right-prefix", help="folder: pictures of the right camera; what follows pairs them"
    )
    parser.add_argument("--topic", help="bag: Image topic; of the left camera in a pair")
    parser.add_argument(
        "--right-topic", help="bag: Image topic of the right camera; equal stamps pair"
    )
    parser.add_argument(
        "--least-views", type=int, default=rules.least_views, help="(default %(default)s)"
    )
    return parser
