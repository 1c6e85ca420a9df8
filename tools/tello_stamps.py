# SPDX-License-Identifier: Apache-2.0
"""What wrong stamps of a Tello's video cost: of flown demos (make demo SYSTEM=tello, mocap or gimbal) how far stamps of
recorded pictures are from the moments at which they were truly taken, and how far the tracker's camera pose is from the
truth at either. Home is laid over the world by the mean rotation.

    python tools/tello_stamps.py out/demo [FOLDER ...]
"""

import csv
import sys
from collections import defaultdict
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from fcsv_geometry.bags.reading import messages
from fcsv_geometry.messages import pose_to_transform, seconds

NAMES = ("tello1", "tello2")
_BESIDE_S = 0.3  # of a recording
Pose = Tuple[Rotation, np.ndarray]


def heard(session: Path):
    """Stamps of pictures and T_home_cam by stamp, both by vehicle; start and end of each recording (s)."""
    stamps_s, poses, windows = defaultdict(list), defaultdict(dict), []
    wanted = {f"/{n}/camera/color/camera_info": n for n in NAMES}
    wanted.update({f"/{n}/camera_pose": n for n in NAMES}, **{"/mission/capture": ""})
    for bag in sorted(session.glob("*.bag")):
        for topic, m in messages(bag, lambda topic, _kind: topic in wanted):
            if topic == "/mission/capture":
                windows.append((seconds(m.start), seconds(m.stop)))
            elif topic.endswith("camera_pose"):
                poses[wanted[topic]][seconds(m.header.stamp)] = pose_to_transform(m.pose.pose)
            else:
                stamps_s[wanted[topic]].append(seconds(m.header.stamp))
    return stamps_s, poses, windows


def true_shots(folder: Path, name: str) -> List[Tuple[float, Pose]]:
    with open(folder / "run" / "sim" / f"truth_cameras_{name}.csv", newline="") as notes:
        rows = [row for row in csv.DictReader(notes) if None not in row.values()]
    return [
        (float(r["stamp_s"]), (Rotation.from_quat([float(r[k]) for k in ("qx", "qy", "qz", "qw")]),
                               np.array([float(r[k]) for k in "xyz"])))
        for r in rows
    ]  # fmt: skip


def pairs(folder: Path) -> List[Tuple[float, Pose, Pose, Pose]]:
    """Of each recorded picture: how late its stamp is (s), its true pose, the tracker's at its stamp and at the true
    moment, which is taken to be the nearest one."""
    stamps_s, poses, windows = heard(folder / "session")
    found = []
    for name in NAMES:
        shots, known_s = true_shots(folder, name), np.array(sorted(poses[name]))
        track = np.array([poses[name][s] for s in known_s])
        turns = Slerp(known_s, Rotation.from_matrix(track[:, :3, :3]))
        for stamp_s in stamps_s[name]:
            true_s, true = min(shots, key=lambda shot: abs(shot[0] - stamp_s))
            recorded = any(a - _BESIDE_S <= stamp_s <= b + _BESIDE_S for a, b in windows)
            if recorded and known_s[0] < min(stamp_s, true_s) and max(stamp_s, true_s) < known_s[-1]:
                at = [
                    (turns(s), np.array([np.interp(s, known_s, track[:, k, 3]) for k in range(3)]))
                    for s in (stamp_s, true_s)
                ]
                found.append((stamp_s - true_s, true, *at))
    return found


def errors(true: List[Pose], tracked: List[Pose]) -> Dict[str, float]:
    """Medians: rotation (deg) and position (cm), apart from what all pictures share."""
    off = Rotation.concatenate([t[0] * k[0].inv() for t, k in zip(true, tracked)])
    T_world_home = off.mean()
    turned = np.degrees((T_world_home.inv() * off).magnitude())
    away = np.array([t[1] - T_world_home.apply(k[1]) for t, k in zip(true, tracked)])
    away_m = np.linalg.norm(away - np.median(away, axis=0), axis=1)
    return {"deg": float(np.median(turned)), "cm": 100.0 * float(np.median(away_m))}


def main() -> int:
    for folder in map(Path, sys.argv[1:]):
        late_s, true, at_stamp, at_moment = zip(*pairs(folder))
        late_ms = 1e3 * np.array(late_s)
        print(f"{folder}: {len(late_ms)} pictures, stamps late by {np.median(late_ms):.0f} ms (median), "
              f"{np.abs(late_ms).max():.0f} ms at most")  # fmt: skip
        for words, tracked in (("at the stamps", at_stamp), ("at the true moments", at_moment)):
            print("  {}: poses off by {deg:.2f} deg, {cm:.1f} cm (medians)".format(words, **errors(true, tracked)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
