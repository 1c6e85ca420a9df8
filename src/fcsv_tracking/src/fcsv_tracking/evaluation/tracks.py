# SPDX-License-Identifier: Apache-2.0
"""Stamped poses and their files: TUM's format (as evo reads it), and the simulation's
truth/cameras.csv."""

from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.errors import EvaluationError


@dataclass(frozen=True)
class Track:
    """Stamps (N,) s, rising, and poses T_a_b (N,4,4)."""

    stamps_s: np.ndarray
    T_a_b: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps_s)

    @property
    def path_m(self) -> np.ndarray:
        """Distance (N,) gone up to each pose."""
        steps = np.linalg.norm(np.diff(self.T_a_b[:, :3, 3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])


def track_from(stamps_s, p_a_b_m, q_a_b_xyzw, name: str) -> Track:
    """Raises EvaluationError naming the source and the first line that is wrong."""
    stamps_s, p, q = (np.asarray(v, float) for v in (stamps_s, p_a_b_m, q_a_b_xyzw))
    if len(stamps_s) < 2:
        raise EvaluationError(f"{name}: {len(stamps_s)} poses; two or more are needed")
    finite = np.isfinite(stamps_s) & np.isfinite(p).all(axis=1) & np.isfinite(q).all(axis=1)
    if not finite.all():
        raise EvaluationError(f"{name}: pose {int(np.argmin(finite)) + 1} is not finite")
    norms = np.linalg.norm(q, axis=1)
    if (np.abs(norms - 1.0) > 0.01).any():
        worst = int(np.argmax(np.abs(norms - 1.0)))
        raise EvaluationError(
            f"{name}: the quaternion of pose {worst + 1} has length {norms[worst]:.3g}, not 1"
        )
    back = np.flatnonzero(np.diff(stamps_s) <= 0)
    if len(back):
        raise EvaluationError(
            f"{name}: the stamp of pose {int(back[0]) + 2} does not come after the one before"
        )
    T = np.tile(np.eye(4), (len(p), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = Rotation.from_quat(q).as_matrix(), p
    return Track(stamps_s, T)


def read_tum(path: Path) -> Track:
    """``stamp x y z qx qy qz qw`` per line, # begins a comment."""
    rows: List[List[float]] = []
    try:
        lines = Path(path).read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise EvaluationError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or 'not text'})"
        ) from error
    for number, line in enumerate(lines, 1):
        line = line.split("#")[0].strip()
        if not line:
            continue
        try:
            row = [float(value) for value in line.replace(",", " ").split()]
        except ValueError:
            row = []
        if len(row) != 8:
            raise EvaluationError(f"{path}, line {number}: not 'stamp x y z qx qy qz qw'")
        rows.append(row)
    values = np.array(rows).reshape(-1, 8)
    return track_from(values[:, 0], values[:, 1:4], values[:, 4:], str(path))


def write_tum(path: Path, track: Track) -> None:
    """Nanoseconds and nanometres are kept."""
    q = Rotation.from_matrix(track.T_a_b[:, :3, :3]).as_quat()
    lines = [
        f"{s:.9f} " + " ".join(f"{v:.9f}" for v in (*T[:3, 3], *r))
        for s, T, r in zip(track.stamps_s, track.T_a_b, q)
    ]
    Path(path).write_text("# stamp_s x y z qx qy qz qw\n" + "\n".join(lines) + "\n")


def read_truth(path: Path, vehicle: Optional[str]) -> Track:
    """T_world_cam of one vehicle from truth/cameras.csv (stamp_s,vehicle,x,y,z,qx,qy,qz,qw)."""
    try:
        rows = [line.split(",") for line in Path(path).read_text().splitlines() if line]
    except (OSError, UnicodeDecodeError) as error:
        raise EvaluationError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or 'not text'})"
        ) from error
    if not rows or rows[0][:2] != ["stamp_s", "vehicle"]:
        raise EvaluationError(f"{path}: does not begin with 'stamp_s,vehicle,...'")
    names = sorted({row[1] for row in rows[1:] if len(row) == 9})
    if vehicle not in names:
        raise EvaluationError(
            f"{path}: holds {', '.join(names) or 'no vehicle'}; name one with --vehicle"
        )
    try:
        values = np.array(
            [[float(row[0]), *map(float, row[2:])] for row in rows[1:] if row[1] == vehicle]
        )
    except (ValueError, IndexError) as error:
        raise EvaluationError(
            f"{path}: a line of {vehicle} is not nine values ({error})"
        ) from error
    values = values[np.unique(values[:, 0], return_index=True)[1]]
    return track_from(values[:, 0], values[:, 1:4], values[:, 4:], str(path))


def at_stamps(track: Track, stamps_s: np.ndarray, gap_s: float) -> Tuple[np.ndarray, np.ndarray]:
    """Which of the stamps (N,) lie inside the track without a gap, and T_a_b (M,4,4) interpolated
    at those."""
    line = Trajectory(gap_s=gap_s)
    for stamp_s, T in zip(track.stamps_s, track.T_a_b):
        line.add(float(stamp_s), T)
    inside, poses = np.zeros(len(stamps_s), bool), []
    for i, stamp_s in enumerate(stamps_s):
        try:
            poses.append(line.at(float(stamp_s)))
        except PoseUnavailable:
            continue
        inside[i] = True
    return inside, np.array(poses).reshape(-1, 4, 4)
