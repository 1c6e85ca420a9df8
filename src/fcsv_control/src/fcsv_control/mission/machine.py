# SPDX-License-Identifier: Apache-2.0
"""The mission as a state machine: fed with snapshots and answers, it says what to do next. It knows no clock."""

from dataclasses import dataclass
from typing import Callable, Dict, List, Optional, Sequence

from fcsv_control.mission.config import Mission
from fcsv_control.mission.flight_list import FlightList
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot

PHASES = (
    "WAIT_VEHICLES", "TAKE_OFF", "COLUMN", "CALIBRATE", "MOVE_HOME", "SET_HOME", "GUIDED", "CONFIGURATIONS", "LAND",
    "DONE", "ABORTED",
)  # fmt: skip
_STALE_S = 2.0
_SEEN_S = 2.0
_AIRBORNE_M = 1.5


@dataclass(frozen=True)
class CaptureWindow:
    """A recording window that counts; times in s."""

    index: int
    vehicle: str
    start_s: float
    stop_s: float
    position_error_m: float


class MissionMachine:
    """``step`` advances; ``calibrate`` and ``set_home`` are asked for through ``wants`` and answered by ``answer``."""

    def __init__(self, mission: Mission, vehicles: Sequence[str]):
        if mission.reference not in vehicles or len(vehicles) < 2:
            raise ValueError(
                f"reference: '{mission.reference}' needs to be one of two or more vehicles {list(vehicles)}"
            )
        self.mission = mission
        self.vehicles = list(vehicles)
        self.outbox = Outbox()
        self.phase = "WAIT_VEHICLES"
        self.detail = ""
        self.waits_for = ""
        self.wants = ""  # "calibrate" or "set_home": a service to call now
        self.problems: List[str] = []
        self.captures: List[CaptureWindow] = []
        self._flight_list: Optional[FlightList] = None
        self._orders: Dict[str, object] = {}
        self._aborted = False
        self._next_landing_s = 0.0

    @property
    def over(self) -> bool:
        return self.phase in ("DONE", "ABORTED")

    @property
    def configuration(self) -> int:
        """Index of the running configuration."""
        return 0 if self._flight_list is None else min(self._flight_list.index, len(self.mission.configurations) - 1)

    # ---- what people and services say ----------------------------------------------------------------------

    def proceed(self) -> str:
        """The operator confirms what is waited for; "" when taken, else why not."""
        if not self.waits_for:
            return f"nothing is waited for in {self.phase}"
        confirmed, self.waits_for = self.waits_for, ""
        if confirmed == "execute":
            self._enter("GUIDED", "handing over to the mission")
        else:
            self._enter({"calibrate": "CALIBRATE", "set_home": "SET_HOME"}[confirmed], "running")
            self.wants = confirmed
        return ""

    def answer(self, what: str, success: bool, message: str) -> None:
        """The outcome of a service that was asked for."""
        if self.phase not in ("CALIBRATE", "SET_HOME"):
            return  # aborted meanwhile
        if what == "calibrate" and success:
            self._enter("MOVE_HOME", message, "set_home")
        elif what == "calibrate":
            self._enter("COLUMN", message)
        elif success:
            self._enter("SET_HOME", message, "execute")
        else:
            self._enter("MOVE_HOME", message, "set_home")

    def abort(self, reason: str) -> None:
        """Land everybody, wherever the mission is."""
        if not self.over:
            self._aborted = True
            self._next_landing_s = 0.0
            self._enter("LAND", reason)

    # ---- the story -----------------------------------------------------------------------------------------

    def step(self, snapshot: Snapshot) -> None:
        """Advance by what is seen; orders go to the outbox."""
        self.problems = [] if self.over else self._missing(snapshot)
        story: Dict[str, Callable[[Snapshot], None]] = {
            "WAIT_VEHICLES": self._wait_vehicles,
            "TAKE_OFF": self._take_off,
            "COLUMN": self._column,
            "GUIDED": self._guided,
            "CONFIGURATIONS": self._configurations,
            "LAND": self._land,
        }
        if self.phase in story:
            story[self.phase](snapshot)

    def _enter(self, phase: str, detail: str, waits_for: str = "") -> None:
        self.phase, self.detail, self.waits_for, self.wants = phase, detail, waits_for, ""
        self._orders = {}

    def _missing(self, snapshot: Snapshot) -> List[str]:
        """Vehicles that are not heard well enough to go on."""
        problems = []
        for name in self.vehicles:
            view = snapshot.vehicles[name]
            if view.state_age_s > _STALE_S or view.pose_age_s > _STALE_S:
                heard = min(view.state_age_s, 999.0), min(view.pose_age_s, 999.0)
                problems.append(f"{name}: last state {heard[0]:.1f} s ago, last pose {heard[1]:.1f} s ago")
            elif not view.connected:
                problems.append(f"{name}: no flight controller")
        return problems

    def _wait_vehicles(self, snapshot: Snapshot) -> None:
        self.detail = "waiting for all vehicles"
        if not self.problems:
            self._enter("TAKE_OFF", "operators: take off in ALT_HOLD, then LOITER")

    def _take_off(self, snapshot: Snapshot) -> None:
        views = snapshot.vehicles.items()
        low = [n for n, v in views if not (v.armed and v.height_m > _AIRBORNE_M and v.mode == "LOITER")]
        if not low and not self.problems:
            self._enter("COLUMN", "operators: line up, every tag in view")

    def _column(self, snapshot: Snapshot) -> None:
        blind = [n for n in self.vehicles[1:] if snapshot.vehicles[n].sees_front_s < _SEEN_S]
        if self.problems or blind:
            self.waits_for = ""
        elif self.waits_for != "calibrate":
            self.waits_for = "calibrate"

    def _guided(self, snapshot: Snapshot) -> None:
        now_s = snapshot.now_s
        for name in self.vehicles:
            order = self._orders.get(name)
            if snapshot.vehicles[name].mode == "GUIDED":
                continue
            if order is None or order.outcome is not None:
                if order is not None and not order.done:
                    self.detail = f"{name}: {order.outcome}"
                self._orders[name] = self.outbox.order(now_s, name, "SET_MODE", mode="GUIDED")
        if all(snapshot.vehicles[n].mode == "GUIDED" for n in self.vehicles):
            self._flight_list = FlightList(self.mission, self.vehicles, self.outbox)
            self._enter("CONFIGURATIONS", "")

    def _configurations(self, snapshot: Snapshot) -> None:
        taken_over = [
            f"{n}: left GUIDED ({snapshot.vehicles[n].mode}); switch back to go on, or abort"
            for n in self.vehicles
            if snapshot.vehicles[n].mode != "GUIDED"
        ]
        self.problems += taken_over
        if self.problems:
            self._flight_list.pause(snapshot.now_s)
            return
        capture = self._flight_list.step(snapshot)
        self.detail = self._flight_list.detail
        if capture is not None:
            self.captures.append(CaptureWindow(*capture))
        if self._flight_list.failed:
            self.abort(self._flight_list.failed)
        elif self._flight_list.finished:
            self._enter("LAND", "all configurations flown")

    def _land(self, snapshot: Snapshot) -> None:
        flying = [n for n in self.vehicles if snapshot.vehicles[n].armed]
        if not flying:
            self._enter("ABORTED" if self._aborted else "DONE", self.detail)
            return
        if snapshot.now_s >= self._next_landing_s:
            self._next_landing_s = snapshot.now_s + 3.0
            for name in flying:
                if snapshot.vehicles[name].mode != "LAND":
                    self.outbox.order(snapshot.now_s, name, "LAND")
                self.outbox.order(snapshot.now_s, name, "RECORD", flag=False)
