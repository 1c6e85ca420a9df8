# SPDX-License-Identifier: Apache-2.0
"""Sweeps that are flown at once: the movers follow set-points that glide along their ways in step,
while every vehicle records."""

from typing import List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.mission.activities.activity import Activity, CaptureWindow, Progress
from fcsv_control.mission.activities.recorders import FIRST_PICTURE_S, LAST_PICTURE_S, Recorders
from fcsv_control.mission.activities.stages import MOVES, RECORDS
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.gliding import GlideRate
from fcsv_control.mission.ways.journey import go_to
from fcsv_control.mission.ways.routes import distance_to_segments
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.camera_places import in_home, reference_place, sweep_place
from fcsv_geometry.missions.configuration import StereoConfiguration
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.sweep import Sweep

_ORDER_EVERY_S = 0.2  # set-points: one that is lost on the radio is followed by the next
# so far behind its set-point a vehicle may be: an autopilot follows at 1/s
_LAG_S, _LAG_M = 2.0, 0.5
_THERE_M = 0.5
_LONGEST_STEP_S = 0.5  # after a pause of the mission's own process the set-point does not jump
_TOLD_EVERY_S = 2.0  # what is recorded so far: for the map that grows meanwhile


class Sweeping(Activity):
    """One attempt. ``movers``: index of its configuration by
    vehicle. ``last``: there is no further attempt, and what was recorded counts."""

    def __init__(self, mission: Mission, movers: Mapping[str, int], outbox: Outbox, last: bool):
        super().__init__()
        self._mission, self._movers, self._outbox, self._last = mission, dict(movers), outbox, last
        self._of = {n: mission.configurations[i] for n, i in self._movers.items()}
        names = [*self._movers, mission.reference]
        self._recorders = Recorders(outbox, names, mission.limits.recorder_s)
        self._title = " and ".join(mission.title(i) for i in self._movers.values())
        self._rates = _rate_of([c.sweep for c in self._of.values()], mission.flight)
        self._share = self._rate = 0.0  # of the way, and of it per second
        self._now_s: Optional[float] = None
        self._ordered_s = float("-inf")
        self._moved_s: Optional[float] = None  # when the set-points moved last
        self._start_s: Optional[float] = None
        self._stop_s: Optional[float] = None
        self._clock_set = 0  # as it began
        self._worst_m = 0.0

    @property
    def stage(self) -> str:
        """Gives the stage as stages.py names it."""
        return MOVES if self._start_s is None else RECORDS

    def stop(self, snapshot: Snapshot) -> None:
        """Pictures off, where they are on."""
        self._recorders.stop(snapshot)
        self.so_far = []

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        """Recorders on, along the way, recorders off. Raises MissionError where a vehicle does not
        follow."""
        if self._start_s is None:
            return self._await_recorders(snapshot)
        if snapshot.clock_set != self._clock_set:  # no time of day tells its window
            self.stop(snapshot)
            return Progress.AGAIN
        if self._stop_s is None:
            self._glide(snapshot)
            return Progress.UNDER_WAY
        return self._end(snapshot)

    def _await_recorders(self, snapshot: Snapshot) -> Progress:
        self.detail = f"{' and '.join(self._movers)} at the beginning of {self._title}"
        recorders = self._recorders
        if not recorders.on:
            recorders.start(snapshot)
        elif recorders.started(snapshot):
            self._start_s, self._now_s, self._moved_s = (
                snapshot.now_s + FIRST_PICTURE_S,
                snapshot.now_s,
                snapshot.now_s,
            )
            self._clock_set = snapshot.clock_set
        elif recorders.refused:
            self.detail = f"recorders do not start for {self._title}: {recorders.refused}"
            if recorders.given_up:
                why = f"recorders do not start: {recorders.refused}"
                self._notes.append(f"{self._title} left out, {why}")
                return Progress.GIVEN_UP
        return Progress.UNDER_WAY

    # ---- along the way ---------------------------------------------------------------------------

    def _glide(self, snapshot: Snapshot) -> None:
        now_s = snapshot.now_s
        dt_s, self._now_s = min(now_s - self._now_s, _LONGEST_STEP_S), now_s
        behind = [
            n
            for n in self._movers
            if self._lag_m(snapshot, n) > _LAG_M + _LAG_S * self._of[n].sweep.speed_mps
        ]
        before = self._share
        self._share, self._rate = self._rates.advanced(self._share, self._rate, dt_s, bool(behind))
        self._moved_s = now_s if self._share > before else self._moved_s
        self._worst_m = max(self._worst_m, self._off_m(snapshot))
        waits = f" (waiting for {' and '.join(behind)})" if behind else ""
        self.detail = f"recording {self._title}{waits}"
        if now_s - self._ordered_s >= _ORDER_EVERY_S - 1e-6:
            self._ordered_s = now_s
            for name, configuration in self._of.items():
                go_to(self._outbox, snapshot, name, self._place(configuration, self._share))
        self._tell_so_far(now_s - LAST_PICTURE_S)
        away = {n: self._lag_m(snapshot, n) for n in self._movers}
        if self._share >= 1.0 and max(away.values()) < _THERE_M:
            self._stop_s = now_s
        elif now_s - self._moved_s > self._mission.settle.timeout_s:
            name = max(away, key=lambda n: away[n])
            raise MissionError(
                f"{name} does not follow {self._of[name].title}: {away[name]:.1f} m behind"
            )

    def _tell_so_far(self, stop_s: float) -> None:
        told_s = self.so_far[0].stop_s if self.so_far else self._start_s
        if stop_s - told_s >= _TOLD_EVERY_S:
            self.so_far = self._windows(stop_s)

    def _windows(self, stop_s: float) -> List[CaptureWindow]:
        return [
            CaptureWindow(i, n, self._start_s, stop_s, self._worst_m)
            for n, i in self._movers.items()
        ]

    def _lag_m(self, snapshot: Snapshot, name: str) -> float:
        place_m = self._place(self._of[name], self._share)[:3, 3]
        return float(np.linalg.norm(snapshot.p_home_cam(name) - place_m))

    def _place(self, configuration: StereoConfiguration, share: float) -> np.ndarray:
        """T_home_cam on a mover's way."""
        return in_home(self._mission, configuration.view, sweep_place(configuration, share))

    def _off_m(self, snapshot: Snapshot) -> float:
        """Largest distance (m) of a mover from its line, or of the reference from its place."""
        view = next(iter(self._of.values())).view
        T_home_reference = reference_place(self._mission, view)
        home_m = snapshot.p_home_cam(self._mission.reference) - T_home_reference[:3, 3]
        off = [float(np.linalg.norm(home_m))]
        for name, configuration in self._of.items():
            start_m, end_m = (self._place(configuration, share)[:3, 3] for share in (0.0, 1.0))
            off.append(
                float(distance_to_segments(snapshot.p_home_cam(name), start_m, end_m[None])[0])
            )
        return max(off)

    def _end(self, snapshot: Snapshot) -> Progress:
        if snapshot.now_s < self._stop_s + LAST_PICTURE_S:
            return Progress.UNDER_WAY
        least = max(c.least_pictures for c in self._of.values())
        again = not self._last and not self._recorders.enough(snapshot, least)
        self.stop(snapshot)
        if again:
            return Progress.AGAIN
        self.windows = self._windows(self._stop_s)
        return Progress.DONE


def _rate_of(sweeps: Sequence[Sweep], flight: FlightBounds) -> GlideRate:
    """The same for all movers: none is faster than its sweep or than it can brake."""
    return GlideRate(
        min(s.bounds(flight).along(*_level_up(s))[0] / s.length_m for s in sweeps),
        min(flight.along(*_level_up(s))[1] / s.length_m for s in sweeps),
    )


def _level_up(sweep: Sweep) -> Tuple[float, float]:
    """How far (m) it goes horizontally and upwards."""
    x, y, z = (sweep.place_m(1.0) - sweep.place_m(0.0)).tolist()
    return float(np.hypot(x, y)), z
