# SPDX-License-Identifier: Apache-2.0
"""The mission as a state machine: fed with snapshots and answers, it says what to do next. It knows no clock."""

from typing import Callable, Dict, List, Optional, Sequence

from fcsv_control.mission import watch
from fcsv_control.mission.flight_list import FlightList
from fcsv_control.mission.hands import GIVEN_BACK, Hands
from fcsv_control.mission.landing import Landing
from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.standing import CaptureWindow
from fcsv_geometry.errors import MissionError
from fcsv_geometry.mission import Mission

PHASES = (
    "WAIT_VEHICLES", "TAKE_OFF", "COLUMN", "CALIBRATE", "MOVE_HOME", "SET_HOME", "GUIDED", "CONFIGURATIONS", "LAND",
    "DONE", "ABORTED",
)  # fmt: skip
_FLOWN_BY_US = ("GUIDED", "CONFIGURATIONS", "LAND")
_SEEN_S = 2.0
_AIRBORNE_M = 1.5
_CONFIRMED_ONCE_S = 1.0  # a second confirmation within this time is a slip of the finger
_MODE_SHOWS_S = 2.0  # a heartbeat a second tells the mode: so long after the acknowledgement it must show


class MissionMachine:
    """``step`` advances; ``calibrate`` and ``set_home`` are asked for through ``wants`` and answered by ``answer``.

    Raises MissionError where the mission names vehicles that are not in the fleet.
    """

    def __init__(self, mission: Mission, vehicles: Sequence[str]):
        mission.check_vehicles(vehicles)
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
        self._hands = Hands()
        self._landing = Landing(vehicles, self.outbox, mission.min_separation_m, self._hands)
        self._mode_orders: Dict[str, Order] = {}
        self._aborted = False
        self._stopped = ""  # why everybody was stopped from outside; nothing is ordered until it is over
        self._now_s = 0.0
        self._confirmed_s = float("-inf")

    @property
    def over(self) -> bool:
        return self.phase in ("DONE", "ABORTED")

    @property
    def configuration(self) -> int:
        """Index of the running configuration."""
        return 0 if self._flight_list is None else self._flight_list.index

    # ---- what people and services say ----------------------------------------------------------------------

    def proceed(self, step: str) -> str:
        """The operator confirms the step that he names; "" when taken, else why not."""
        if self._now_s - self._confirmed_s < _CONFIRMED_ONCE_S:
            return "the step before was confirmed a moment ago; look at the vehicles, then confirm again"
        if not self.waits_for:
            return f"nothing is waited for in {self.phase}"
        if step != self.waits_for:
            return f"'{self.waits_for}' is waited for, not '{step}'"
        self._confirmed_s = self._now_s
        if step in ("execute", "resume"):
            self._hands.give_back()
            self._stopped = self.waits_for = ""
            if self.phase != "LAND":
                self._enter("GUIDED", "handing over to the mission")
        else:
            self._enter({"calibrate": "CALIBRATE", "set_home": "SET_HOME"}[step], "running")
            self.wants = step
        return ""

    def answer(self, what: str, success: bool, message: str) -> None:
        """The outcome of a service that was asked for; one that failed is waited for again."""
        if self.phase != {"calibrate": "CALIBRATE", "set_home": "SET_HOME"}[what]:
            return  # aborted meanwhile
        if what == "calibrate":
            self._enter(*(("MOVE_HOME", message, "set_home") if success else ("COLUMN", message)))
        else:
            self._enter(*(("SET_HOME", message, "execute") if success else ("MOVE_HOME", message, "set_home")))

    def abort(self, reason: str) -> None:
        """Land everybody whom the mission flies, wherever it is; who is flown by hand is told to land."""
        if not self.over:
            self._aborted, self._stopped = True, ""
            self._enter("LAND", reason)

    def stopped(self, reason: str) -> None:
        """Somebody has stopped everybody (/stop_all): no order until the operator confirms ``resume``, or aborts."""
        if self.phase in _FLOWN_BY_US:
            self._stopped = reason
            self.outbox.withdraw(f"everybody was stopped: {reason}")
            self._hands.all_asked("BRAKE")

    # ---- the story -----------------------------------------------------------------------------------------

    def step(self, snapshot: Snapshot) -> None:
        """Advance by what is seen; orders go to the outbox."""
        self._now_s = snapshot.now_s
        self._hands.see(snapshot)
        self.problems = [] if self.over else watch.problems(self.mission, self.phase, snapshot)
        if self._stopped:
            self._stand_still(snapshot)
            return
        story: Dict[str, Callable[[Snapshot], None]] = {
            "WAIT_VEHICLES": self._wait_vehicles,
            "TAKE_OFF": self._take_off,
            "COLUMN": self._column,
            "GUIDED": self._guided,
            "CONFIGURATIONS": self._configurations,
            "LAND": self._land,
        }
        try:
            watch.require_flyable(self.mission, self.phase, snapshot)
            if self.phase in story:
                story[self.phase](snapshot)
        except MissionError as error:
            self.abort(str(error))

    def _enter(self, phase: str, detail: str, waits_for: str = "") -> None:
        self.phase, self.detail, self.waits_for, self.wants = phase, detail, waits_for, ""
        self._mode_orders = {}

    def _wait_vehicles(self, _snapshot: Snapshot) -> None:
        self.detail = "waiting for all vehicles"
        if not self.problems:
            self._enter("TAKE_OFF", "operators: take off in ALT_HOLD, then LOITER")

    def _take_off(self, snapshot: Snapshot) -> None:
        views = snapshot.vehicles.values()
        up = all(v.armed and v.height_m > _AIRBORNE_M and v.mode == "LOITER" for v in views)
        if up and not self.problems:
            self._enter("COLUMN", "operators: line up, every tag in view")

    def _column(self, snapshot: Snapshot) -> None:
        blind = [n for n in self.vehicles[1:] if snapshot.vehicles[n].sees_front_s < _SEEN_S]
        self.waits_for = "" if self.problems or blind else "calibrate"

    def _guided(self, snapshot: Snapshot) -> None:
        if self._taken() or self.problems:
            return
        waiting = [n for n in self.vehicles if snapshot.vehicles[n].mode != "GUIDED"]
        for name in waiting:
            self._switch_to_guided(snapshot, name)
        if not waiting:
            if self._flight_list is None:
                self._flight_list = FlightList(self.mission, self.vehicles, self.outbox, snapshot)
            self._enter("CONFIGURATIONS", "")

    def _stand_still(self, snapshot: Snapshot) -> None:
        """Everybody was stopped: recorders off, and no more than that."""
        if self.phase == "CONFIGURATIONS":
            self._flight_list.pause(snapshot)
        if not self._taken():
            self.waits_for = "resume"
        self.detail = f"everybody was stopped ({self._stopped}): confirm 'resume', or abort to land"
        self.problems.append(self.detail)

    def _taken(self) -> bool:
        """Whether somebody else has a vehicle; the operator can confirm once each is given back."""
        taken = self._hands.taken
        self.problems += [
            f"{name}: {mode} was not asked for by the mission; "
            + ("confirm 'resume'" if mode in GIVEN_BACK else "give it back in LOITER or GUIDED, or abort")
            for name, mode in taken.items()
        ]
        self.waits_for = "resume" if taken and all(m in GIVEN_BACK for m in taken.values()) else ""
        return bool(taken)

    def _switch_to_guided(self, snapshot: Snapshot, name: str) -> None:
        now_s, order = snapshot.now_s, self._mode_orders.get(name)
        if order is not None and order.failed:
            self.detail = f"{name} does not go to GUIDED: {order.outcome}"
        unheard = order is not None and order.outcome is None
        if order is None or not (unheard or now_s - order.ordered_s < _MODE_SHOWS_S):
            self._mode_orders[name] = self.outbox.order(now_s, name, "SET_MODE", mode="GUIDED")
            self._hands.asked(name, "GUIDED", snapshot.vehicles[name].mode)

    def _configurations(self, snapshot: Snapshot) -> None:
        if self._taken() or self.problems:
            self._flight_list.pause(snapshot)
            return
        capture = self._flight_list.step(snapshot)
        self.detail = self._flight_list.detail
        if capture is not None:
            self.captures.append(capture)
        if self._flight_list.finished:
            self._flight_list.require_some(len(self.captures))
            self._enter("LAND", "; ".join(["all configurations flown", *self._flight_list.notes]))

    def _land(self, snapshot: Snapshot) -> None:
        landed = self._landing.step(snapshot)
        self.problems += self._landing.problems
        if landed:
            self._enter("ABORTED" if self._aborted else "DONE", self.detail)
