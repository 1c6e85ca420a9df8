# SPDX-License-Identifier: Apache-2.0
"""One vehicle's way to a place, way-point by way-point."""

from typing import List, Optional, Sequence

import numpy as np

from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.places import body_set_point
from fcsv_control.mission.ways.routes import Keep, route
from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import MissionError

_ARRIVED_M = 0.5


def go_to(outbox: Outbox, snapshot: Snapshot, name: str, T_home_cam: np.ndarray) -> Order:
    """Order a vehicle's camera to T_home_cam; the set-point is in the vehicle's own odometry
    frame."""
    T_odom_body = body_set_point(T_home_cam, snapshot.T_home_odom[name], snapshot.T_body_cam[name])
    return go_to_body(outbox, snapshot, name, T_odom_body)


def go_to_body(outbox: Outbox, snapshot: Snapshot, name: str, T_odom_body: np.ndarray) -> Order:
    """Order a vehicle's body to T_odom_body, level, in its own odometry frame."""
    return outbox.order(snapshot.now_s, name, "GOTO", target=T_odom_body, frame=frames.odom(name))


_SLOWLY_MPS = 1.0


class Journey:
    """Planned at the first step, from where everybody is then, or ``way`` as it was planned; the
    other vehicles must stay where they are, or on ways that were checked against this one.

    ``timeout_s`` is for each way-point; a long leg has the time of a slow flight.
    """

    def __init__(
        self,
        outbox: Outbox,
        name: str,
        T_home_cam: np.ndarray,
        keep: Keep,
        timeout_s: float,
        way: Optional[Sequence[np.ndarray]] = None,
    ):
        self.name = name
        self._outbox = outbox
        self._T_home_cam = T_home_cam
        self._keep = keep
        self._timeout_s = timeout_s
        self._way: Optional[List[np.ndarray]] = None if way is None else list(way)
        self._order: Optional[Order] = None
        self._started_s: Optional[float] = None
        self._limit_s = timeout_s
        self.behind = 0  # way-points

    @property
    def planned(self) -> bool:
        """Whether its way was found."""
        return self._way is not None

    @property
    def between(self) -> bool:
        """Whether it stands before its first, or between two way-points."""
        return self._order is None

    def step(self, snapshot: Snapshot, others: Sequence[str] = ()) -> bool:
        """Whether the vehicle is there (within 0.5 m, the order acknowledged). Raises
        MissionError."""
        if self._way is None:
            others_m = [snapshot.p_home_cam(n) for n in others]
            self._way = route(
                snapshot.p_home_cam(self.name), self._T_home_cam[:3, 3], others_m, self._keep
            )
        if not self._way:
            return True
        if self._started_s is None:
            leg_m = float(np.linalg.norm(snapshot.p_home_cam(self.name) - self._way[0]))
            self._started_s, self._limit_s = (
                snapshot.now_s,
                max(self._timeout_s, leg_m / _SLOWLY_MPS),
            )
        if self._order is None or self._order.failed:
            T_home_cam = transforms.transform(self._T_home_cam[:3, :3], self._way[0])
            self._order = go_to(self._outbox, snapshot, self.name, T_home_cam)
        away_m = float(np.linalg.norm(snapshot.p_home_cam(self.name) - self._way[0]))
        if self._order.done and away_m < _ARRIVED_M:
            self._way.pop(0)
            self._order, self._started_s = None, None
            self.behind += 1
        elif snapshot.now_s - self._started_s > self._limit_s:
            why = f" ({self._order.outcome})" if self._order.failed else ""
            raise MissionError(
                f"{self.name} did not get to its next way-point in {self._limit_s:.0f} s, {away_m:.1f} m are left{why}"
            )
        return not self._way
