# SPDX-License-Identifier: Apache-2.0
"""The list of configurations, one after the other: go there, settle, record, go on."""

from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.mission.config import Mission, StereoConfiguration
from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.places import T_HOME_CAM_AT_HOME, body_set_point, camera_place, route
from fcsv_control.mission.snapshot import Snapshot
from fcsv_geometry import frames, transforms

_ARRIVED_M = 0.5
_PICTURES_LAG_S = 0.3  # from the order to the first picture that is written

Capture = Tuple[int, str, float, float, float]


class FlightList:
    """Flies the configurations of a mission in GUIDED; ``step`` returns a capture when a recording counts."""

    def __init__(self, mission: Mission, vehicles: Sequence[str], outbox: Outbox):
        self._mission = mission
        self._vehicles = list(vehicles)
        self._outbox = outbox
        self.index = 0
        self.detail = ""
        self.failed = ""
        self._begin()
        self._reference_order: Optional[Order] = None

    @property
    def finished(self) -> bool:
        return self.index >= len(self._mission.configurations)

    def pause(self, now_s: float) -> None:
        """Something is wrong with a vehicle: what was being recorded does not count."""
        if self._recording_since_s is not None:
            self._record(now_s, False)
        self._begin(self._attempt)

    def step(self, snapshot: Snapshot) -> Optional[Capture]:
        """Advance the running configuration."""
        if self.finished:
            return None
        if not self._hold_reference(snapshot):
            return None
        configuration = self._mission.configurations[self.index]
        mover = self._mover(configuration)
        target = camera_place(configuration)
        if self._way is None:
            return self._plan(snapshot, mover, target)
        if self._way:
            self._travel(snapshot, mover, target)
            return None
        if self._recording_since_s is None:
            self._settle(snapshot, configuration, mover, target)
            return None
        return self._watch_recording(snapshot, configuration, mover, target)

    # ---- parts of one configuration ------------------------------------------------------------------------

    def _begin(self, attempt: int = 0) -> None:
        self._attempt = attempt
        self._way: Optional[List[np.ndarray]] = None
        self._order: Optional[Order] = None
        self._since_s: Optional[float] = None
        self._started_s: Optional[float] = None
        self._recording_since_s: Optional[float] = None
        self._worst_m = 0.0

    def _mover(self, configuration: StereoConfiguration) -> str:
        others = [v for v in self._vehicles if v != self._mission.reference]
        return configuration.vehicle or others[0]

    def _hold_reference(self, snapshot: Snapshot) -> bool:
        """The reference goes to home once and stays: its camera's place, level."""
        if self._reference_order is None or self._reference_order.outcome not in (None, ""):
            name = self._mission.reference
            self._reference_order = self._goto(snapshot, name, T_HOME_CAM_AT_HOME)
        return self._reference_order.done

    def _goto(self, snapshot: Snapshot, name: str, T_home_cam: np.ndarray) -> Order:
        target = body_set_point(T_home_cam, snapshot.T_home_odom[name], snapshot.T_body_cam[name])
        return self._outbox.order(snapshot.now_s, name, "GOTO", target=target, frame=frames.odom(name))

    def _plan(self, snapshot: Snapshot, mover: str, target: np.ndarray) -> None:
        here = snapshot.vehicles[mover].T_home_cam[:3, 3]
        others = [snapshot.vehicles[n].T_home_cam[:3, 3] for n in self._vehicles if n != mover]
        try:
            self._way = route(here, target[:3, 3], others, self._mission.min_separation_m - 0.3)
        except ValueError as error:
            self.failed = f"configuration {self.index + 1}: {error}"
        self._started_s = snapshot.now_s

    def _travel(self, snapshot: Snapshot, mover: str, target: np.ndarray) -> None:
        point = self._way[0]
        last = len(self._way) == 1
        T_home_cam = target if last else transforms.transform(target[:3, :3], point)
        if self._order is None or self._order.outcome not in (None, ""):
            self._order = self._goto(snapshot, mover, T_home_cam)
        here = snapshot.vehicles[mover].T_home_cam[:3, 3]
        self.detail = f"{mover} on its way to {self._mission.configurations[self.index].title}"
        if self._order.done and np.linalg.norm(here - T_home_cam[:3, 3]) < _ARRIVED_M:
            self._way.pop(0)
            self._order = None
        self._check_timeout(snapshot)

    def _errors(self, snapshot: Snapshot, mover: str, target: np.ndarray) -> float:
        """Largest distance (m) of mover and reference from their places."""
        places = {mover: target, self._mission.reference: T_HOME_CAM_AT_HOME}
        return max(float(np.linalg.norm(snapshot.vehicles[n].T_home_cam[:3, 3] - T[:3, 3])) for n, T in places.items())

    def _settle(self, snapshot: Snapshot, configuration, mover: str, target: np.ndarray) -> None:
        bounds = self._mission.settle
        error_m = self._errors(snapshot, mover, target)
        views = [snapshot.vehicles[n] for n in (mover, self._mission.reference)]
        calm = error_m < bounds.position_m and all(
            v.speed_mps < bounds.speed_mps and v.pose_age_s < bounds.pose_age_s for v in views
        )
        self.detail = f"{mover} settles at {configuration.title} ({error_m:.2f} m off)"
        if not calm:
            self._since_s = None
            self._check_timeout(snapshot)
            return
        self._since_s = self._since_s or snapshot.now_s
        if snapshot.now_s - self._since_s >= bounds.time_s:
            self._record(snapshot.now_s, True)
            self._recording_since_s, self._worst_m = snapshot.now_s + _PICTURES_LAG_S, 0.0
            self._attempt += 1

    def _watch_recording(self, snapshot: Snapshot, configuration, mover: str, target) -> Optional[Capture]:
        bounds = self._mission.settle
        self._worst_m = max(self._worst_m, self._errors(snapshot, mover, target))
        self.detail = f"recording {configuration.title}"
        if self._worst_m > bounds.hold_m and self._attempt < bounds.attempts:
            self._record(snapshot.now_s, False)  # a gust: this recording does not count
            attempt = self._attempt
            self._begin(attempt)
            self._way, self._started_s = [], snapshot.now_s
            return None
        if snapshot.now_s - self._recording_since_s < configuration.record_s:
            return None
        self._record(snapshot.now_s, False)
        capture = (self.index, mover, self._recording_since_s, snapshot.now_s, self._worst_m)
        self.index += 1
        self._begin()
        return capture

    def _record(self, now_s: float, on: bool) -> None:
        for name in self._vehicles:
            self._outbox.order(now_s, name, "RECORD", flag=on)

    def _check_timeout(self, snapshot: Snapshot) -> None:
        if snapshot.now_s - self._started_s > self._mission.settle.timeout_s:
            title = self._mission.configurations[self.index].title
            self.failed = f"{title} was not reached within {self._mission.settle.timeout_s:.0f} s ({self.detail})"
