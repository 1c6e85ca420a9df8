# SPDX-License-Identifier: Apache-2.0
"""Where simulated bodies truly are, shared between processes through a memory-mapped ring per
vehicle.

One writer, any readers, no locks: a record is written before the counter that announces it, and the
ring is long enough that a reader never meets the writer.
"""

import time
from pathlib import Path
from typing import Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import rotations, transforms
from fcsv_geometry.errors import PoseUnavailable

_RING = 2048  # 5 s at 400 Hz
_RECENT = 16  # records (40 ms) among which a reader looks first
_FIELDS = 11  # stamp_s, position (3), quaternion xyzw (4), world velocity (3)
_FUTURE_S = 0.05  # how far beyond the newest record a pose is extrapolated


def _path(folder, vehicle: str) -> Path:
    return Path(folder) / f"{vehicle}.truth"


class TruthWriter:
    """Writes the poses of one vehicle: stamps (s, wall clock) must rise."""

    def __init__(self, folder, vehicle: str):
        Path(folder).mkdir(parents=True, exist_ok=True)
        path = _path(folder, vehicle)
        shape = (_RING * _FIELDS + 1,)
        begun = path.with_suffix(".begun")
        # a memmap's own slices are slow
        self._map = np.memmap(begun, np.float64, "w+", shape=shape).view(np.ndarray)
        # whole from the first look; readers of an earlier run keep their own file
        begun.replace(path)
        self._ring = self._map[1:].reshape(_RING, _FIELDS)
        self._count = 0

    def write(self, stamp_s: float, T_world_body: np.ndarray, v_world_mps) -> None:
        q = Rotation.from_matrix(T_world_body[:3, :3]).as_quat()
        self.write_records(np.concatenate([[stamp_s], T_world_body[:3, 3], q, v_world_mps])[None])

    def write_records(self, records: np.ndarray) -> None:
        """Several poses at once, for the fast loop: (n, 11) of stamp, position, quaternion xyzw,
        velocity."""
        at = self._count % _RING
        fits = min(len(records), _RING - at)
        self._ring[at : at + fits] = records[:fits]
        self._ring[: len(records) - fits] = records[fits:]
        self._count += len(records)
        self._map[0] = self._count


class TruthReader:
    """Reads the poses of one vehicle, also while its writer has not started yet (PoseUnavailable
    then)."""

    def __init__(self, folder, vehicle: str):
        self._path = _path(folder, vehicle)
        self._vehicle = vehicle
        self._map = None

    def latest(self) -> Tuple[float, np.ndarray]:
        """Newest stamp (s) and T_world_body."""
        record = self._record(self._count() - 1)
        return float(record[0]), _pose(record)

    def wait_for(self, stamp_s: float, patience_s: float = 0.2) -> np.ndarray:
        """T_world_body at a stamp that the vehicle may not have reached yet: a sensor never runs
        ahead of the world."""
        for _ in range(int(patience_s / 0.002)):
            if self._stamp(self._count() - 1) >= stamp_s:
                break
            time.sleep(0.002)
        return self.at(stamp_s)

    def velocity(self) -> np.ndarray:
        """Newest velocity (m/s, world)."""
        return self._record(self._count() - 1)[8:11]

    def at(self, stamp_s: float) -> np.ndarray:
        """T_world_body at a stamp (s), interpolated; extrapolated at most 50 ms beyond the newest
        record."""
        count = self._count()
        newest = self._record(count - 1)
        if stamp_s > newest[0]:
            if stamp_s - newest[0] > _FUTURE_S:
                raise PoseUnavailable(f"{self._vehicle}: truth is {stamp_s - newest[0]:.3f} s old")
            T = _pose(newest)
            T[:3, 3] += newest[8:11] * (stamp_s - newest[0])
            return T
        oldest = max(0, count - _RING + 64)  # keep clear of the writer
        low, high = oldest, count - 1
        if stamp_s < self._stamp(low):
            raise PoseUnavailable(
                f"{self._vehicle}: truth at {stamp_s:.3f} s is no longer (or not yet) kept"
            )
        if low < high - _RECENT and self._stamp(high - _RECENT) <= stamp_s:
            low = high - _RECENT  # what sensors ask for nearly always
        while high - low > 1:
            middle = (low + high) // 2
            if self._stamp(middle) <= stamp_s:
                low = middle
            else:
                high = middle
        before, after = self._record(low), self._record(high)
        alpha = min(1.0, max(0.0, (stamp_s - before[0]) / max(after[0] - before[0], 1e-9)))
        # records are 2.5 ms apart: between them a straight line is the slerp, to 1e-9
        if before[4:8] @ after[4:8] < 0:
            after[4:8] *= -1.0
        return _pose((1.0 - alpha) * before + alpha * after)

    def _count(self) -> int:
        if self._map is None:
            if not self._path.exists():
                raise PoseUnavailable(
                    f"{self._vehicle}: no simulated vehicle of that name ({self._path})"
                )
            # a memmap's own slices are slow
            self._map = np.memmap(self._path, np.float64, "r").view(np.ndarray)
        count = int(self._map[0])
        if count == 0:
            raise PoseUnavailable(f"{self._vehicle}: no truth yet")
        return count

    def _stamp(self, index: int) -> float:
        return self._map[1 + (index % _RING) * _FIELDS]

    def _record(self, index: int) -> np.ndarray:
        start = 1 + (index % _RING) * _FIELDS
        return np.array(self._map[start : start + _FIELDS])


def _pose(record: np.ndarray) -> np.ndarray:
    """T_world_body of a record."""
    q = record[4:8] / np.sqrt(record[4:8] @ record[4:8])
    return transforms.transform(rotations.matrix_of_quaternion(q.tolist()), record[1:4])
