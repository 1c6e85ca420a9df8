# SPDX-License-Identifier: Apache-2.0
"""Whether somebody who came up to the robot may stand beside it, where a view from far away does not
tell him from the robot."""

from collections import deque
from typing import Deque, List, NamedTuple, Sequence

import numpy as np

WALKS_MPS = 1.5  # of who comes
_VIEWS_APART_S = 1.0
_MOVED_M = 0.5  # from one sighting to another; less may be noise
_BLOB_M = 2.0  # about the nearest cell: one thing, whose depth is matched worse than its side
_OFF_M = 1.0  # of its middle
_SAME_M, _STAYS = 0.15, 0.1  # share of its cells in which a thing that went is seen still
_PAIR_S, _TREND_S, _TREND_VIEWS = 2.5, 4.0, 3  # one view between two may miss him
_TREND_MPS, _TREND_OFF_M = 0.4, 0.5  # of one who comes slowly; how far sightings lie off it
LOOK_AGAIN_S = 4.0  # without anything near, before somebody's look counts
_STEP_M = WALKS_MPS * _VIEWS_APART_S


class _Sighting(NamedTuple):
    """Cells (N,2) of the thing nearest to the robot, and their middle (2,), m; whether it may be
    beside the robot a view later."""

    stamp_s: float
    cells_m: np.ndarray
    middle_m: np.ndarray
    is_near: bool

    def may_be(self, stamp_s: float, places_m: np.ndarray) -> bool:
        """Whether who walks from here may be seen at one of ``places_m`` (N,2) by then."""
        ways_m = np.hypot(*(places_m - self.middle_m).T)
        return bool((ways_m < WALKS_MPS * (stamp_s - self.stamp_s) + _OFF_M).any())

    def stays(self, things_m: np.ndarray) -> bool:
        """Whether some of it is still seen where it was, among ``things_m`` (N,2)."""
        off_m = np.hypot(*(self.cells_m[:, None] - things_m[None]).transpose(2, 0, 1)).min(1)
        return float((off_m < _SAME_M).mean()) > _STAYS


class BesideWatch:
    """Follows from view to view what moves near the cells in which the robot itself may be seen:
    they reach farther along the line of sight than across."""

    def __init__(self):
        self._sightings: Deque[_Sighting] = deque()
        self._near_s = -np.inf  # when something was seen last that may be there by now
        #: somebody came up, and was not seen to leave
        self.may_stand = False

    def observe(
        self, stamp_s: float, things_m: np.ndarray, off_m: np.ndarray, robot_m: np.ndarray
    ) -> None:
        """A view shows things in cells at ``things_m`` (N,2), ``off_m`` (N,) from the nearest in
        which it may show the robot, which is at ``robot_m`` (2,)."""
        while self._sightings and stamp_s - self._sightings[0].stamp_s > _TREND_S:
            self._sightings.popleft()
        self.may_stand |= self._vanished(stamp_s, things_m, robot_m)
        if not len(things_m):
            return
        k = int(np.argmin(off_m))
        cells_m = things_m[np.hypot(*(things_m - things_m[k]).T) < _BLOB_M]
        new = _Sighting(stamp_s, cells_m, cells_m.mean(0), bool(off_m[k] < _STEP_M))
        nearer_m = self._nearer_m(new, things_m, robot_m)
        self._sightings.append(new)
        if new.is_near:
            self._near_s = stamp_s
            self.may_stand |= nearer_m > 0
        elif nearer_m < 0:
            self.may_stand = False

    def forget(self, now_s: float) -> None:
        """Somebody looked: nobody stands there. That holds once no view of the last LOOK_AGAIN_S
        shows anything near: who is still on his way stands there a moment later."""
        if now_s - self._near_s < LOOK_AGAIN_S:
            return
        self.may_stand = False
        self._sightings.clear()

    def _vanished(self, stamp_s: float, things_m: np.ndarray, robot_m: np.ndarray) -> bool:
        """Whether who was seen twice, the second time nearer, is not seen any more where he may be
        by now. Who was seen for longer was judged by his trend; noise of what stands has none."""
        if not self._sightings or not self._sightings[-1].is_near:
            return False
        last = self._sightings[-1]
        seen = self._seen_of(last)
        if len(seen) != _TREND_VIEWS - 1 or last.may_be(stamp_s, things_m):
            return False
        before_m, last_m = _away_m(seen, robot_m)
        return before_m - last_m >= _TREND_MPS * (last.stamp_s - seen[0].stamp_s)

    def _seen_of(self, new: _Sighting) -> List[_Sighting]:
        """The sightings from which who is seen now may have come."""
        here_m = new.middle_m[None]
        return [s for s in self._sightings if s.may_be(new.stamp_s, here_m)]

    def _nearer_m(self, new: _Sighting, things_m: np.ndarray, robot_m: np.ndarray) -> float:
        """How much nearer to the robot it came since it was seen before, negative where it left; 0
        where it stands, or comes from nowhere, as a wrong depth does."""
        seen = [*self._seen_of(new), new]
        off_s = np.array([s.stamp_s - new.stamp_s for s in seen])
        away_m = _away_m(seen, robot_m)
        for s, nearer_m in zip(seen, away_m - away_m[-1]):
            recent = new.stamp_s - s.stamp_s <= _PAIR_S
            if recent and abs(nearer_m) > _MOVED_M and not s.stays(things_m):
                return float(nearer_m)
        if len(seen) < _TREND_VIEWS:
            return 0.0
        mps, at_m = np.polyfit(off_s, away_m, 1)
        straight = np.abs(away_m - (mps * off_s + at_m)).max() < _TREND_OFF_M
        return float(-mps) if straight and abs(mps) > _TREND_MPS else 0.0


def _away_m(seen: Sequence[_Sighting], robot_m: np.ndarray) -> np.ndarray:
    """(N,) how far from the robot at ``robot_m`` (2,) each is."""
    return np.array([np.hypot(*(s.middle_m - robot_m)) for s in seen])
