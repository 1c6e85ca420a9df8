# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_tracking export_trajectories``: every trajectory of a session or of bags as TUM
files, for evo."""

import argparse
from pathlib import Path
from typing import Dict, List, Optional

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.messages import pose_to_transform, seconds
from fcsv_geometry.programs.writing import require_folder
from fcsv_tracking import commands
from fcsv_tracking.errors import EvaluationError
from fcsv_tracking.evaluation.tracks import Track, read_truth, write_tum

_TOPICS = {
    "odometry/body": "odometry",
    "odometry/state": "state",
    "camera_pose": "camera",
    "mavros/local_position/pose": "autopilot",
}


def main(argv: Optional[List[str]] = None) -> int:
    return commands.run(_parser(), argv, _export)


def _export(args) -> None:
    source, out = Path(args.input), Path(args.out)
    require_folder(out)
    paths = sorted(source.glob("*.bag")) if source.is_dir() else [source]
    tracks = _tracks(paths)
    truth = source / "truth" / "cameras.csv"
    if source.is_dir() and truth.is_file():
        vehicles = sorted({name.rsplit("_", 1)[0] for name in tracks})
        for vehicle in vehicles:
            try:
                tracks[f"{vehicle}_truth"] = read_truth(truth, vehicle)
            except EvaluationError as error:
                print(f"no truth of {vehicle}: {error}")
    if not tracks:
        raise EvaluationError(
            f"{source}: no trajectory in it; topics looked for: /VEHICLE/" + ", ".join(_TOPICS)
        )
    out.mkdir(parents=True, exist_ok=True)
    for name, track in sorted(tracks.items()):
        write_tum(out / f"{name}.tum", track)
        print(f"{name}.tum: {len(track)} poses, {track.path_m[-1]:.1f} m")
    print(f"wrote {out}")


def _tracks(paths: List[Path]) -> Dict[str, Track]:
    from fcsv_tracking.ros import bags  # ROS is needed for bags alone

    kinds = (
        "nav_msgs/Odometry",
        "geometry_msgs/PoseStamped",
        "geometry_msgs/PoseWithCovarianceStamped",
    )
    topics = [
        t
        for k in kinds
        for t in bags.topics_of(paths, k)
        if t.strip("/").partition("/")[2] in _TOPICS
    ]
    found: Dict[str, Dict[float, np.ndarray]] = {}
    if not topics:
        return {}
    for topic, message in bags.messages(paths, topics):
        vehicle, _, rest = topic.strip("/").partition("/")
        pose = message.pose if hasattr(message.pose, "position") else message.pose.pose
        try:
            T = pose_to_transform(pose)
        except GeometryError as error:
            raise EvaluationError(f"topic {topic}: {error}") from error
        stamp_s = seconds(message.header.stamp)
        found.setdefault(f"{vehicle}_{_TOPICS[rest]}", {})[stamp_s] = transforms.require_rigid(
            T, topic
        )
    return {name: _sorted(poses) for name, poses in found.items() if len(poses) > 1}


def _sorted(poses: Dict[float, np.ndarray]) -> Track:
    stamps_s = sorted(poses)
    return Track(np.array(stamps_s), np.stack([poses[s] for s in stamps_s]))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="export_trajectories",
        description="Trajectories as TUM files: T_odom_body, T_home_cam, and the truth.",
        epilog="example: export_trajectories out/demo/session -o out/tum && evo_traj tum out/tum/*.tum",
    )
    parser.add_argument("input", help="a session folder or a bag")
    parser.add_argument("-o", "--out", required=True, help="folder for VEHICLE_WHAT.tum")
    return parser
