# SPDX-License-Identifier: Apache-2.0
"""How well set-points were held while pictures were recorded, by the truth: from a flown session's
bags."""

import csv
from bisect import bisect_right
from pathlib import Path
from typing import Dict, List, Mapping, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.bags.reading import messages
from fcsv_geometry.messages import pose_to_transform, seconds
from fcsv_geometry.rotations import wrap
from fcsv_stereo.sessions.files import bags_of

#: Stamp (s) and a pose, in order of time.
Track = List[Tuple[float, np.ndarray]]
_SET_POINT, _CAPTURE = "mavros/setpoint_position/local", "/mission/capture"


def errors(
    windows: Sequence[Tuple[float, float]], set_points: Track, true: Track, T_world_odom: np.ndarray
):
    """(n, 2): distance (m) and heading (deg) between the true T_world_body and the newest set-point
    (T_odom_body) before it, at every moment inside a window whose truth is known."""
    stamps_s, found = [s for s, _ in set_points], []
    for stamp_s, T_world_body in true:
        k = bisect_right(stamps_s, stamp_s) - 1
        if k < 0 or not any(start_s <= stamp_s <= stop_s for start_s, stop_s in windows):
            continue
        T = T_world_odom @ set_points[k][1]
        off_rad = wrap(transforms.yaw(T_world_body) - transforms.yaw(T))
        found.append(
            (float(np.linalg.norm(T_world_body[:3, 3] - T[:3, 3])), abs(float(np.degrees(off_rad))))
        )
    return np.reshape(np.array(found), (-1, 2))


def held(
    session: Path, sim_folder: Path, T_body_cam: Mapping[str, np.ndarray], T_world_odom: np.ndarray
):
    """``errors`` by vehicle, of a session in which all fly in one odometry frame. Raises BagError,
    InputError."""
    windows: List[Tuple[float, float]] = []
    set_points: Dict[str, Track] = {n: [] for n in T_body_cam}
    topics = {f"/{n}/{_SET_POINT}": n for n in T_body_cam}
    for bag in bags_of(session, []):
        for topic, message in messages(
            bag, lambda topic, _kind: topic == _CAPTURE or topic in topics
        ):
            if topic == _CAPTURE:
                windows.append((seconds(message.start), seconds(message.stop)))
            else:
                set_points[topics[topic]].append(
                    (seconds(message.header.stamp), pose_to_transform(message.pose))
                )
    return {
        n: errors(windows, set_points[n], _true(sim_folder, n, T), T_world_odom)
        for n, T in T_body_cam.items()
    }


def held_in_words(found: Mapping[str, np.ndarray]) -> str:
    """One line for the end of a demo.

    >>> held_in_words({"tello1": np.array([[0.01, 0.2], [0.04, 0.1]]), "tello2": np.zeros((0, 2))})
    'set-points held, by the truth: tello1 within 0.04 m and 0.2 deg (2 moments), tello2 not seen'
    """
    words = [f"{n} {_within(e)}" for n, e in found.items()]
    return f"set-points held, by the truth: {', '.join(words)}"


def _within(errors_m_deg: np.ndarray) -> str:
    if not len(errors_m_deg):
        return "not seen"
    most_m, most_deg = errors_m_deg.max(axis=0)
    return f"within {most_m:.2f} m and {most_deg:.1f} deg ({len(errors_m_deg)} moments)"


def _true(sim_folder: Path, name: str, T_body_cam: np.ndarray) -> Track:
    """T_world_body at each picture that was truly taken."""
    T_cam_body, track = transforms.invert(T_body_cam), []
    with open(Path(sim_folder) / f"truth_cameras_{name}.csv", newline="") as notes:
        for row in csv.DictReader(notes):
            if None in row.values():
                continue  # it was cut off while it was written
            q = [float(row[k]) for k in ("qx", "qy", "qz", "qw")]
            T_world_cam = transforms.from_xyz_quaternion([float(row[k]) for k in "xyz"], q)
            track.append((float(row["stamp_s"]), T_world_cam @ T_cam_body))
    return track
