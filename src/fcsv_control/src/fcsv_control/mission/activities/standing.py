# SPDX-License-Identifier: Apache-2.0
"""Standing at the places of configurations that are flown at once: become calm, record on every
vehicle of them, watch that all hold still."""

from typing import Dict, Mapping, Optional, Sequence

import numpy as np

from fcsv_control.mission.activities.activity import Activity, CaptureWindow, Progress
from fcsv_control.mission.activities.recorders import FIRST_PICTURE_S, LAST_PICTURE_S, Recorders
from fcsv_control.mission.activities.stages import HOLDS, RECORDS
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.watches.calm import CalmCheck
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.streams.stream import Since

_LONGEST = 4.0  # times the wanted recording, where pictures come in slowly


class Standing(Activity):
    """One attempt. ``movers``: index of its configuration by vehicle. GIVEN_UP: the vehicles do not
    become calm, or a recorder refuses for too long."""

    def __init__(
        self,
        mission: Mission,
        movers: Mapping[str, int],
        places: Dict[str, np.ndarray],
        outbox: Outbox,
        last: bool,
    ):
        super().__init__()
        self._bounds = mission.settle
        self._movers = dict(movers)
        listed = [mission.configurations[i] for i in self._movers.values()]
        self._record_s = max(c.record_s for c in listed)
        self._least_pictures = max(c.least_pictures for c in listed)
        self._title = " and ".join(mission.title(i) for i in self._movers.values())
        self._calm = CalmCheck(mission.settle, places)
        self._recorders = Recorders(outbox, list(places), mission.limits.recorder_s)
        self._last = last  # a disturbed recording counts: there is no further attempt
        self._started, self._stands = Since(), Since()
        self._start_s: Optional[float] = None
        self._stop_s: Optional[float] = None
        self._lacking = False  # pictures, when the wanted time was over
        self._unheard = list(places)  # of whom no pose came yet that is newer than the recording
        self._clock_set = 0  # as it began
        self._worst_m = 0.0

    @property
    def stage(self) -> str:
        """Gives the stage as stages.py names it."""
        return HOLDS if self._start_s is None else RECORDS

    def stop(self, snapshot: Snapshot) -> None:
        """Pictures off, where they are on."""
        self._recorders.stop(snapshot)

    def step(self, snapshot: Snapshot, guided: Sequence[str]) -> Progress:
        """Settle, switch the recorders on, watch, switch them off."""
        started_s = self._started.lasts_s(snapshot.now_s)
        if not self._recorders.on:
            return self._settle(snapshot, started_s)
        if self._start_s is None:
            return self._await_recorders(snapshot)
        return self._watch(snapshot)

    def _settle(self, snapshot: Snapshot, started_s: float) -> Progress:
        self.detail = (
            f"{' and '.join(self._movers)} settle{'s' * (len(self._movers) == 1)} at {self._title}"
        )
        if not self._calm.look(snapshot):
            self.detail += f": {self._calm.said}"
            self._stands.end()
            late = started_s > self._bounds.timeout_s
            return (
                self._give_up(f"not calm there: {self._calm.in_the_way}")
                if late
                else Progress.UNDER_WAY
            )
        if self._stands.lasts_s(snapshot.now_s) >= self._bounds.time_s:
            self._recorders.start(snapshot)
        return Progress.UNDER_WAY

    def _give_up(self, why: str) -> Progress:
        self._notes.append(f"{self._title} left out, {why}")
        return Progress.GIVEN_UP

    def _await_recorders(self, snapshot: Snapshot) -> Progress:
        """The window opens when every recorder is known to be on."""
        recorders = self._recorders
        if recorders.started(snapshot):
            self._start_s, self._clock_set = snapshot.now_s + FIRST_PICTURE_S, snapshot.clock_set
        elif not recorders.refused:
            self.detail = f"recorders start for {self._title}"
        else:
            self.detail = f"recorders do not start for {self._title}: {recorders.refused}"
            if recorders.given_up:
                return self._give_up(f"recorders do not start: {recorders.refused}")
        return Progress.UNDER_WAY

    def _watch(self, snapshot: Snapshot) -> Progress:
        if self._unheard:
            self._worst_m = max(self._worst_m, self._calm.error_m(snapshot, self._unheard))
        if self._stop_s is None:
            self.detail = f"recording {self._title}"
            self._stop_s = self._ended_s(snapshot)
        else:  # a radio that holds up tells later who left its place
            self._unheard = [
                n
                for n in self._unheard
                if snapshot.now_s - snapshot.vehicles[n].pose_age_s <= self._stop_s
            ]
        gust = self._worst_m > self._bounds.hold_m and not self._last
        if gust or snapshot.clock_set != self._clock_set:  # no time of day tells such a window
            self.stop(snapshot)
            return Progress.AGAIN
        early = self._stop_s is None or snapshot.now_s < self._stop_s + LAST_PICTURE_S
        if early or self._unheard:
            return Progress.UNDER_WAY
        self.stop(snapshot)
        window = (self._start_s, self._stop_s, self._worst_m)
        self.windows = [CaptureWindow(i, n, *window) for n, i in self._movers.items()]
        return Progress.DONE

    def _ended_s(self, snapshot: Snapshot) -> Optional[float]:
        """When the recording ended: at the wanted time, later where a vehicle did not have its
        pictures then."""
        due_s, now_s = self._start_s + self._record_s, snapshot.now_s
        if now_s < due_s:
            return None
        if self._recorders.enough(snapshot, self._least_pictures):
            return now_s if self._lacking else due_s
        self._lacking = True
        return now_s if now_s >= self._start_s + _LONGEST * self._record_s else None
