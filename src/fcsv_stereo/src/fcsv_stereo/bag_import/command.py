# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_stereo import_bag BAG --camera TOPIC --pose SOURCE -o OUT`` (``fcsv
import-bag``).
"""

import argparse
import shlex
import sys
from pathlib import Path
from typing import List, Optional

import numpy as np

from fcsv_geometry.programs import commands
from fcsv_geometry.programs.live_line import LiveLine, Steps
from fcsv_stereo.bag_import.importing import ImportedBag, import_bag
from fcsv_stereo.bag_import.request import AXES, CameraRequest, ImportRequest, each
from fcsv_stereo.errors import InputError

_EXAMPLES = """examples:
  import_bag walk.mcap --camera /cam/image_raw --pose /odom --range-m 30 -o photos      mount by tf
  import_bag two.bag --camera /a/image_raw --pose a_optical_frame --camera /b/image_raw --pose b_optical_frame ...
  import_bag fly.bag --camera /cam/image_raw --pose track.tum --mount optical --range-m 100 -o photos
  map photos -o out/photos
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 with a folder that ``map`` reads; 2 with one line on stderr, 130 on Ctrl-C, and
    nothing is left.
    """
    return commands.run(_parser(), argv, _import, left="nothing was written")


def _import(args) -> None:
    request, paths = _request(args), [Path(p) for p in args.bags]
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: does not exist")
    with Steps(LiveLine(sys.stderr), "opening the bag").shown() as steps:
        done = import_bag(paths, Path(args.out), request, steps.begin)
    print(table(done))
    files = "images/ ({}), cameras.txt, images.txt{}".format(
        len(done.pictures), ", priors.csv" * done.has_priors
    )
    print(f"wrote {args.out}: {files}")
    print(f"map it: map {shlex.quote(args.out)} -o OUT --reference {done.pictures[0].name}")


def table(done: ImportedBag) -> str:
    """Text: pictures with stamp and baseline to the reference, the lag of each topic, warnings."""
    reference = done.pictures[0].posed
    R_cam_world, p = reference.T_world_cam[:3, :3].T, reference.T_world_cam[:3, 3]
    lines = [
        f"{'picture':<16}{'stamp (s)':>18}{'right':>9}{'down':>9}{'ahead':>9}   m from the reference"
    ]
    for d in done.pictures:
        away = "".join(f"{a:>+9.3f}" for a in R_cam_world @ (d.posed.T_world_cam[:3, 3] - p))
        lines.append(f"{d.name:<16}{d.posed.own_stamp_s:>18.6f}{away}   {d.topic}")
    lags = [f"{topic} {1e3 * lag:.0f} ms" for topic, lag in done.lags_s.items() if np.isfinite(lag)]
    lines.append(f"recorded after their stamps: {', '.join(lags)}")
    lines.append(
        f"home: frame '{done.world}'"
        if done.world
        else "home: the world of the poses, which has no name"
    )
    return "\n".join([*lines, *(f"WARNING: {w}" for w in done.warnings)])


def _request(args) -> ImportRequest:
    count = len(args.camera)
    poses, mounts = each("--pose", args.pose, count), each("--mount", args.mount, count)
    infos, axes = each("--info", args.info, count), each("--axes", args.axes, count)
    offsets = each("--offset-s", args.offset_s, count, 0.0)
    cameras = tuple(map(CameraRequest, args.camera, poses, mounts, infos, axes, offsets))
    return ImportRequest(
        cameras, args.range_m, args.most, args.reference, args.world, args.gap_s, args.by_receipt
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="import_bag",
        description="Pictures of posed cameras in any bag (ROS 1, ROS 2, MCAP) as a folder that map "
        "reads. Options of a camera: once for all, or once for each --camera, in its order.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("bags", nargs="+", metavar="BAG", help="a bag, or several of one recording")
    add(
        "-o",
        "--out",
        required=True,
        metavar="PHOTOS",
        help="new folder for images/, cameras.txt, images.txt",
    )
    add(
        "--camera",
        action="append",
        required=True,
        metavar="TOPIC",
        help="its pictures, sensor_msgs/Image or CompressedImage; the first camera has the reference picture",
    )
    add(
        "--pose",
        action="append",
        required=True,
        metavar="SOURCE",
        help="nav_msgs/Odometry, PoseStamped, PoseWithCovarianceStamped or TransformStamped; a FRAME of tf; or a FILE "
        "of TUM's format",
    )
    add(
        "--range-m",
        type=float,
        required=True,
        metavar="M",
        help="distance of the scene: baselines of 1 to 10 %% of it are chosen",
    )
    add(
        "--mount",
        action="append",
        metavar="HOW",
        help="what the pose is of: optical (the camera, z forward), camera (the camera, x forward), "
        "x,y,z,roll,pitch,yaw of the camera (x forward) in it (m, degrees), or a FRAME of tf; by "
        "default the frame that the pose names, joined with that of the pictures by tf",
    )
    add(
        "--axes",
        action="append",
        choices=sorted(AXES),
        help="of the pictures' frame, where it isn't named ...optical",
    )
    add(
        "--info",
        action="append",
        metavar="TOPIC",
        help="camera_info (default: beside the pictures)",
    )
    add(
        "--offset-s",
        action="append",
        type=float,
        metavar="S",
        help="is added to the stamps of the pictures",
    )
    add("--by-receipt", action="store_true", help="the time of recording counts, not the stamp")
    add(
        "--gap-s",
        type=float,
        metavar="S",
        help="longest silence of poses that is bridged (default: 4 of their periods)",
    )
    add(
        "--world",
        metavar="FRAME",
        help="frame of all poses (default: that of the first, or the root of tf)",
    )
    add(
        "--most",
        type=int,
        default=ImportRequest.most,
        metavar="N",
        help="pictures in all (default %(default)s)",
    )
    add(
        "--reference",
        type=float,
        metavar="STAMP",
        help="reference picture: that of the first camera nearest to STAMP",
    )
    return parser
