# SPDX-License-Identifier: Apache-2.0
"""The operator's half of the mission: confirmations, which configurations to fly, pause, skip and
the like."""

from typing import List, Optional, Sequence

from fcsv_control.mission.activities.flight_list import FlightList
from fcsv_control.mission.activities.standing import CaptureWindow
from fcsv_control.mission.plans.plan_gate import PlanGate
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.watches import watch
from fcsv_control.mission.watches.check_gate import OpenGate
from fcsv_control.mission.watches.fleet_modes import FleetModes
from fcsv_control.mission.watches.patience import PauseTimers
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.phases import FLOWN

OPERATIONS = ("pause", "resume", "skip", "repeat", "next", "previous", "abort")
_CONFIRMED_ONCE_S = 1.0  # a second confirmation within this time is a slip of the finger


class OperatorCommands:
    """What MissionMachine answers to people; each returns "" when it is done, else why not."""

    mission: Mission
    phase: str
    detail: str
    waits_for: str
    wants: str
    over: bool
    _aborted: bool
    gate: OpenGate
    _modes: FleetModes
    _plan: PlanGate
    _patience: PauseTimers
    _snapshot: Optional[Snapshot]
    _flight_list: Optional[FlightList]
    _confirmed_s: float
    _paused_by_operator: bool
    _stopped: str
    _indices: Optional[List[int]]

    @property
    def configuration(self) -> int:
        """Index of the running configuration."""
        return 0 if self._flight_list is None else self._flight_list.index

    @property
    def progress(self) -> float:
        """0..1 of the configurations that are recorded or left out."""
        return 0.0 if self._flight_list is None else self._flight_list.share

    @property
    def stage(self) -> str:
        """What is done for it now, as stages.py names it; "" where no list is flown."""
        return (
            self._flight_list.stage
            if self._flight_list is not None and self.phase == "CONFIGURATIONS"
            else ""
        )

    @property
    def so_far(self) -> List[CaptureWindow]:
        """Windows of sweeps under way, for who maps meanwhile: pictures until then are taken."""
        return [] if self._flight_list is None else self._flight_list.so_far

    def _enter(self, phase: str, detail: str, waits_for: str = "") -> None:
        raise NotImplementedError

    def proceed(self, step: str) -> str:
        """The operator confirms the step that he names; "" when taken, else why not."""
        now_s = 0.0 if self._snapshot is None else self._snapshot.now_s
        if now_s - self._confirmed_s < _CONFIRMED_ONCE_S:
            return "the step before was confirmed a moment ago; look at the vehicles, then confirm again"
        lost = watch.lost(self._snapshot) if self.phase != "LAND" else ""
        if lost:
            return f"'{step}' is refused: {lost}"
        if not self.waits_for:
            return f"nothing is waited for in {self.phase}"
        if step != self.waits_for:
            return f"'{self.waits_for}' is waited for, not '{step}'"
        locked = self._locked(now_s, step)
        if locked:
            return locked
        wrong = self._plan.from_here(self._snapshot, self._indices) if step == "execute" else ""
        if wrong:
            self._enter("MOVE_HOME", f"the list cannot be flown from here: {wrong}", "set_home")
            return self.detail
        self._confirmed_s = now_s
        if step in ("execute", "resume"):
            self._modes.give_back()
            self._paused_by_operator, self._stopped, self.waits_for = False, "", ""
            if self.phase != "LAND":
                self._enter("GUIDED", "handing over to the mission")
        else:
            self._enter({"calibrate": "CALIBRATE", "set_home": "SET_HOME"}[step], "running")
            self.wants = step
        return ""

    def _locked(self, now_s: float, step: str) -> str:
        """Why the flight check hands over nobody; "" where it does, and in steps that hand over
        nobody."""
        if step == "execute":
            return self.gate.before_list(now_s)
        return self.gate.before_resuming(now_s) if step == "resume" and self.phase != "LAND" else ""

    def execute(self, indices: Sequence[int]) -> str:
        """Begins the list as ``proceed("execute")``, for these configurations in this order (none:
        all)."""
        most = len(self.mission.configurations) - 1
        wrong = [i for i in indices if not 0 <= i <= most]
        if wrong or len(set(indices)) != len(indices):
            return f"configurations are numbered 0..{most}, each once; got {list(indices)}"
        if self.waits_for != "execute" and not watch.lost(self._snapshot):
            return f"'execute' is not waited for in {self.phase}"
        before, self._indices = self._indices, list(indices) or None
        refusal = self.proceed("execute")
        if refusal:
            self._indices = before  # what was refused is not flown by a later ``proceed``
        return refusal

    def control(self, operation: str) -> str:
        """One of OPERATIONS; "" when done, else why not."""
        if operation == "abort":
            if self.over:
                return f"the mission is over ({self.phase})"
            self.abort("aborted by the operator: landing")
            return ""
        if operation not in OPERATIONS:
            return f"'{operation}' is not one of {', '.join(OPERATIONS)}"
        if operation == "resume":
            return self.proceed("resume")
        flown = self._flight_list
        if flown is None or self.phase not in FLOWN:
            return f"'{operation}' is for vehicles that fly the list; this is {self.phase}"
        if flown.going_back:
            return f"the list is over, the vehicles go back and land: {flown.going_back}"
        if operation == "pause":
            self._paused_by_operator = True
            return ""
        return flown.change(self._snapshot, operation)

    def abort(self, reason: str) -> None:
        """Land everybody whom the mission flies, wherever it is; who is flown by hand is told to
        land."""
        if not self.over:
            self._aborted, self._stopped = True, ""
            self._enter("LAND", reason)

    def finish(self, reason: str) -> None:
        """Fly nothing more: back to the column and land; where the list is not flown, as
        ``abort``."""
        if self.phase == "CONFIGURATIONS" and self._flight_list is not None:
            self._flight_list.go_back(self._snapshot, reason)
            self._paused_by_operator = False
            self._patience.begin_anew()
        else:
            self.abort(f"{reason}: landing")
