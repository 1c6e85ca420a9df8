# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_tracking calibrate_mounts``: where camera or tag sit on a vehicle, from bags of it moved by hand."""

import argparse
from pathlib import Path
from typing import List, Optional

import numpy as np
from tqdm import tqdm

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.programs.writing import require_file
from fcsv_geometry.vehicles.tracker import load_profile
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_tracking import commands
from fcsv_tracking.errors import ExtrinsicsRefused
from fcsv_tracking.mounts.hand_eye import PARTS, TagView
from fcsv_tracking.mounts.refine import MountRules, calibrate_mount
from fcsv_tracking.mounts.vehicle_file import mount_of, write_mount
from fcsv_tracking.tags import TagDetector

_LEAST_MOVE_M, _LEAST_TURN_RAD, _MOST_VIEWS = 0.03, np.radians(2.0), 150
_EXAMPLES = """the vehicle is carried about a metre in front of what stands still, turned by 20 to 30 degrees about two
axes or more, for half a minute; its tracking camera must see enough to track.

examples:
  calibrate_mounts uav1.bag --vehicle uav1 --part camera --tag-id 7 --tag-size-m 0.16     # tag 7 hangs on a wall
  calibrate_mounts uav1.bag uav2.bag --vehicle uav1 --part tag --watcher uav2             # uav2 stands and watches
"""


def main(argv: Optional[List[str]] = None) -> int:
    return commands.run(_parser(), argv, _calibrate)


def _calibrate(args) -> None:
    folder = Path(args.vehicles_dir)
    vehicle = load_vehicles(folder, [args.vehicle])[args.vehicle]
    source = folder / f"{args.vehicle}.yaml"
    target = Path(args.out) if args.out else source
    if not args.dry_run:
        require_file(target)
    views = _views([Path(b) for b in args.bags], args, vehicle)
    rules = MountRules(least_views=args.least_views, tracker=load_profile(args.tracker_profile))
    solution = calibrate_mount(args.part, views, rules)
    before, after = getattr(vehicle, args.part), mount_of(vehicle, solution)
    print(
        f"{args.part} of {args.vehicle}, {solution.used} views ({solution.rejected} left out), "
        f"rms {solution.reprojection_rms_px:.2f} px"
    )
    print(f"  was  xyz_m {list(before.xyz_m)}, rpy_deg {list(before.rpy_deg)}")
    print(f"  is   xyz_m {list(after.xyz_m)}, rpy_deg {list(after.rpy_deg)}")
    print(
        f"  left over (1 sigma): {solution.position_std_m * 1e3:.1f} mm, {solution.rotation_std_deg:.2f} deg"
    )
    if args.dry_run:
        return
    write_mount(source, target, solution)
    print(f"wrote {target}")


def _views(paths: List[Path], args, vehicle) -> List[TagView]:
    """The tag in the pictures of the moved vehicle or of the watcher, where the body has moved since the last."""
    from fcsv_tracking.ros import bags  # ROS is needed for bags alone

    eye = args.vehicle if args.part == "camera" else args.watcher
    if not eye:
        raise ExtrinsicsRefused(
            "--part tag needs --watcher: the vehicle whose camera stands still and sees the tag"
        )
    tag_id, size_m = _tag(args, vehicle)
    track = bags.odometry(paths, f"/{args.vehicle}/odometry/body")
    camera = bags.camera(paths, f"/{eye}/camera/color/camera_info")
    detector, views, seen, without_pose = TagDetector({tag_id: size_m}), [], 0, 0
    pictures = bags.gray_pictures(paths, f"/{eye}/camera/color/image_raw")
    for stamp_s, gray in tqdm(pictures, unit="picture", desc=eye, disable=None):
        try:
            T_odom_body = track.at(stamp_s)
        except PoseUnavailable:
            without_pose += 1
            continue
        if views and not _moved(views[-1].T_odom_body, T_odom_body):
            continue
        seen += 1
        for tag in detector.detect(gray, camera):
            focal_px = (camera.fx + camera.fy) / 2.0
            views.append(TagView(stamp_s, tag.corners_normalized, size_m, focal_px, T_odom_body))
    if not views:
        raise ExtrinsicsRefused(
            f"tag {tag_id} is in none of {seen} pictures of {eye} ({without_pose} more have no odometry of "
            f"{args.vehicle} at their stamp): check the id, the family (tag36h11), and that the clocks agree"
        )
    return [
        views[i] for i in np.linspace(0, len(views) - 1, min(len(views), _MOST_VIEWS)).astype(int)
    ]


def _tag(args, vehicle):
    """Id and size of the tag that is looked at: the vehicle's own, or the one on the wall."""
    if args.part == "tag":
        return vehicle.tag_id, vehicle.tag_size_m
    if args.tag_id is None or args.tag_size_m is None:
        raise ExtrinsicsRefused(
            "--part camera needs --tag-id and --tag-size-m of the tag that hangs still"
        )
    if not args.tag_size_m > 0:
        raise ExtrinsicsRefused(
            f"--tag-size-m {args.tag_size_m}: must be positive (edge of the black square)"
        )
    return args.tag_id, args.tag_size_m


def _moved(T_before: np.ndarray, T_after: np.ndarray) -> bool:
    moved_m = float(np.linalg.norm(T_after[:3, 3] - T_before[:3, 3]))
    return moved_m > _LEAST_MOVE_M or transforms.rotation_angle(T_before, T_after) > _LEAST_TURN_RAD


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calibrate_mounts",
        description="Where a vehicle's camera or tag sits, from the vehicle moved by hand.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "bags",
        nargs="+",
        help="image_raw and camera_info of the camera, odometry/body of the vehicle",
    )
    parser.add_argument(
        "--vehicle", required=True, help="the one that is moved; its file is updated"
    )
    parser.add_argument("--part", choices=PARTS, required=True)
    parser.add_argument(
        "--vehicles-dir",
        default="config/vehicles",
        help="folder of NAME.yaml (default %(default)s)",
    )
    parser.add_argument("--tag-id", type=int, help="part camera: id of the tag that hangs still")
    parser.add_argument("--tag-size-m", type=float, help="part camera: edge of its black square")
    parser.add_argument("--watcher", help="part tag: the vehicle whose camera stands still")
    parser.add_argument("-o", "--out", help="write here instead of into the vehicle's own file")
    parser.add_argument("--dry-run", action="store_true", help="print only")
    parser.add_argument(
        "--tracker-profile", default="", help="config/trackers/NAME.yaml (default: the T265)"
    )
    parser.add_argument(
        "--least-views", type=int, default=MountRules().least_views, help="(default %(default)s)"
    )
    return parser
