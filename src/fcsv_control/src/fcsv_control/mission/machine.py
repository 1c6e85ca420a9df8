# SPDX-License-Identifier: Apache-2.0
"""The mission as a state machine: fed with snapshots and answers, it says what to do next. It knows
no clock."""

from typing import Callable, Dict, List, Mapping, Optional, Sequence, Set

from fcsv_control.mission import restart
from fcsv_control.mission.activities.activity import CaptureWindow
from fcsv_control.mission.activities.flight_list import FlightList
from fcsv_control.mission.activities.handover import Handover
from fcsv_control.mission.activities.holding import Holding
from fcsv_control.mission.activities.landing import Landing
from fcsv_control.mission.memory import Memory, digest, unfinished_stations
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.plans.plan_gate import PlanGate
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.watches import watch
from fcsv_control.mission.watches.check_gate import OpenGate
from fcsv_control.mission.watches.dropouts import Dropouts
from fcsv_control.mission.watches.fleet_modes import FleetModes
from fcsv_control.mission.watches.pause_timers import BACK, LAND, Pause, PauseTimers, what_follows
from fcsv_control.mission.ways.places import FollowPlace
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.mission import GROUND, ON_BOARD, Mission
from fcsv_geometry.missions.phases import BY_HOME, FLOWN, OVER
from fcsv_geometry.missions.stations import Viewpoint
from fcsv_geometry.vehicles.modes import Mode

_BY_HAND = ("TAKE_OFF", "COLUMN", "CALIBRATE", "MOVE_HOME", "SET_HOME")  # people fly
CALIBRATE_IN_FLIGHT = "calibrate_in_flight"
_SEEN_S = 2.0
_LINE_UP = {
    ON_BOARD: "operators: line up, every tag in view",
    GROUND: "operators: where the tracker sees everybody",
}
_AIRBORNE_M = 1.5


class MissionMachine:
    """``step`` advances; ``calibrate`` and ``set_home`` are asked for through ``wants`` and
    answered by ``answer``.

    ``radius_m`` by vehicle; ``gate``: what the flight check says. Raises MissionError where the
    mission names vehicles that are not in the fleet, or where a leg of it cannot be flown.
    """

    def __init__(
        self,
        mission: Mission,
        vehicles: Sequence[str],
        radius_m: Optional[Mapping[str, float]] = None,
        gate: Optional[OpenGate] = None,
    ):
        mission.check_vehicles(vehicles)
        self.mission, self._digest = mission, digest(mission)
        self.vehicles = list(vehicles)
        self.outbox = Outbox()
        self.phase = "WAIT_VEHICLES"
        self.detail = ""
        self.waits_for = ""
        # "calibrate", "set_home" or "calibrate_in_flight": a service to call now
        self.wants = ""
        self.problems: List[str] = []
        self.captures: List[CaptureWindow] = []
        self.gate = gate or OpenGate()
        self._plan = PlanGate(mission, vehicles, radius_m)
        self._flight_list: Optional[FlightList] = None
        self._modes = FleetModes(vehicles)
        self._landing = Landing(mission, vehicles, self.outbox, self._modes)
        self._dropouts = Dropouts(mission.reference, vehicles)
        self._patience = PauseTimers(mission.limits)
        self._pauses: Set[Pause] = set()
        self._handover = Handover(self.outbox, self._modes)
        self._aborted = False
        # why everybody was stopped from outside; nothing is ordered until it is over
        self._stopped = ""
        self._paused_by_operator = False
        self._snapshot: Optional[Snapshot] = None
        self._indices: Sequence[int] = ()  # of the configurations to fly; none: all
        self._not_reached = ""  # stations that are left to another flight, and why
        # configurations of stations that a flight before left, and those of which this one is
        self.unfinished: List[int] = []
        self._whole: Sequence[int] = range(len(mission.configurations))
        self._memory: Optional[Memory] = None
        self.said: List[str] = []  # for the log
        self.unexplained: List[str] = []  # fly in GUIDED, and nothing is known of their mission

    # ---- what it shows ---------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """Time of the last step."""
        return 0.0 if self._snapshot is None else self._snapshot.now_s

    @property
    def over(self) -> bool:
        return self.phase in OVER

    @property
    def lands_flown(self) -> bool:
        """Whether it lands because the list is flown."""
        return self.phase == "LAND" and not self._aborted

    @property
    def lost(self) -> str:
        """Who lost its position, and what to do; "" where nobody did."""
        return watch.lost(self._snapshot)

    @property
    def configuration(self) -> int:
        """Index of the running configuration."""
        return 0 if self._flight_list is None else self._flight_list.index

    @property
    def viewpoint(self) -> Viewpoint:
        """Viewpoint of the running configuration."""
        return self.mission.viewpoint(self.configuration)

    @property
    def resumes_at(self) -> str:
        """Name of the station at which a flight before stopped; empty where none is left."""
        return self.mission.viewpoint(self.unfinished[0]).station if self.unfinished else ""

    @property
    def progress(self) -> float:
        """0..1 of the configurations that are recorded or left out."""
        return 0.0 if self._flight_list is None else self._flight_list.share

    @property
    def stage(self) -> str:
        """What is done for it now, as stages.py names it; "" where no list is flown."""
        flown = self._flight_list
        return "" if flown is None or self.phase != "CONFIGURATIONS" else flown.stage

    @property
    def so_far(self) -> List[CaptureWindow]:
        """Windows of sweeps under way, for who maps meanwhile: pictures until then are taken."""
        return [] if self._flight_list is None else self._flight_list.so_far

    # ---- what people want: each answers "" when it is done, else why not -------------------------

    def call(self, service: str) -> str:
        """Asks for "calibrate" or "set_home"."""
        self._enter({"calibrate": "CALIBRATE", "set_home": "SET_HOME"}[service], "running")
        self.wants = service
        return ""

    def begin_list(self, indices: Sequence[int], resumes: bool = False) -> str:
        """Hands over to the mission, which flies these configurations (none: all). ``resumes``: what
        a flight before left, as much of it as the batteries allow."""
        locked = self.gate.before_list(self.now_s)
        if locked:
            return locked
        as_many = resumes or not indices
        wrong = self._plan.from_here(self._snapshot, indices or None, as_many)
        if wrong:
            self._enter("MOVE_HOME", f"the list cannot be flown from here: {wrong}", "set_home")
            return self.detail
        self._indices, self._not_reached = indices, ""
        if as_many:
            within, self._not_reached = self._plan.within_batteries(self._snapshot, indices or None)
            self._indices = within or indices
        if resumes:
            self._whole = list(indices)
        self._regain_control()
        return ""

    def resume(self) -> str:
        """Goes on with the list, or with the landing."""
        locked = "" if self.phase == "LAND" else self.gate.before_resuming(self.now_s)
        if not locked:
            self._regain_control()
        return locked

    def _regain_control(self) -> None:
        """Takes the vehicles back from pilots, and from who stopped everybody."""
        self._modes.give_back()
        self._paused_by_operator, self._stopped, self.waits_for = False, "", ""
        if self.phase != "LAND":
            self._enter("GUIDED", "handing over to the mission")

    def change(self, operation: str) -> str:
        """Pauses the list, or changes it: "pause", "skip", "repeat", "next", "previous",
        "skip_station", "repeat_station"."""
        flown = self._flight_list
        if flown is None or self.phase not in FLOWN:
            return f"'{operation}' is for vehicles that fly the list; this is {self.phase}"
        if flown.going_back:
            return f"the list is over, the vehicles go back and land: {flown.going_back}"
        if operation == "pause":
            self._paused_by_operator = True
            return ""
        return flown.change(self._snapshot, operation)

    def follow(self, vehicle: str, place: FollowPlace) -> str:
        """Somebody asks a vehicle that follows to a place: "", or why it does not go."""
        flown = self._flight_list
        if vehicle not in self.vehicles:
            return f"{vehicle} is not one of {', '.join(self.vehicles)}"
        if vehicle in self._modes.taken:
            return f"{vehicle} is in its pilot's hands"
        if flown is None or self.phase not in FLOWN:
            return f"no vehicle follows in {self.phase}"
        return flown.follow(vehicle, place)

    def abort(self, reason: str) -> None:
        """Land everybody whom the mission flies, wherever it is; who is flown by hand is told to
        land."""
        if not self.over:
            self._aborted, self._stopped = True, ""
            self._enter("LAND", reason)

    def finish(self, reason: str) -> None:
        """Fly nothing more: back to the column and land; where the list is not flown, or vehicles
        that follow land where they are, as ``abort``."""
        flown = self._flight_list
        if self.phase == "CONFIGURATIONS" and flown is not None and not flown.lands_there:
            flown.go_back(self._snapshot, reason)
            self._paused_by_operator = False
            self._patience.begin_anew()
        else:
            self.abort(f"{reason}: landing")

    # ---- what services say -----------------------------------------------------------------------

    def answer(self, what: str, success: bool, message: str, drifted: bool = False) -> None:
        """The outcome of a service that was asked for; one that failed is waited for again.
        ``drifted``: a tracker drifts, so that all land."""
        if what == CALIBRATE_IN_FLIGHT:
            self._answer_in_flight(success, message, drifted)
            return
        if self.phase != {"calibrate": "CALIBRATE", "set_home": "SET_HOME"}[what]:
            return  # aborted meanwhile
        success, message = success and not self.lost, self.lost or message
        if what == "calibrate" and not success:
            self._enter("COLUMN", message)
        elif what == "set_home" and success:
            left = f"; resume_station goes on at {self.resumes_at}" if self.unfinished else ""
            self._enter("SET_HOME", f"{message}{left}", "execute")
        else:
            self._enter("MOVE_HOME", message, "set_home")

    def _answer_in_flight(self, success: bool, message: str, drifted: bool) -> None:
        if self._flight_list is None or self.phase not in FLOWN:
            return
        if drifted:
            self.abort(f"{message}: landing everybody")
            return
        self._flight_list.calibration_answered(success, message)

    # ---- over a restart --------------------------------------------------------------------------

    def restore(self, memory: Memory) -> None:
        """Takes over, before the first step: what the last run of this mission left. It counts
        where vehicles still fly."""
        self._memory = memory

    def memory(self) -> Optional[Memory]:
        """What a restart needs to go on; None while it is not clear yet whether the last run's
        counts."""
        if self._memory is not None and self.phase == "WAIT_VEHICLES":
            return None
        flown = None if self._flight_list is None else self._flight_list.memory
        return Memory(
            self.mission.name,
            self._digest,
            self.vehicles,
            self.phase,
            self.detail,
            self._aborted,
            list(self.captures),
            dict(self._modes.taken),
            flown,
            self.unfinished
            if flown is None
            else unfinished_stations(self.mission, self._whole, flown.flown),
        )

    def _recall(self, snapshot: Snapshot) -> None:
        memory, (what, why) = self._memory, restart.decide(self._memory, snapshot)
        self.detail = why
        if what is restart.RestartVerdict.WAIT:
            return
        self._memory = None
        self.said.append(why)
        if what is restart.RestartVerdict.ANEW:
            self.unfinished = list(memory.unfinished)
            return
        if memory.flight_list is not None:
            self._whole = sorted({*memory.unfinished, *memory.flight_list.flown})
        self.captures, self._aborted = list(memory.captures), memory.aborted
        if what is restart.RestartVerdict.LAND:
            self._aborted |= memory.phase != "LAND"
            self._enter("LAND", why)
            return
        self._modes.take_over(memory.taken)
        if what is restart.RestartVerdict.STOPPED:  # LAND now would fight with who stops everybody
            self._stopped = why
            self._modes.all_asked(Mode.BRAKE)
        self._modes.show(snapshot)
        if memory.phase == "LAND":
            self._enter("LAND", memory.detail)
            return
        taken = self._modes.taken
        if memory.flight_list is None:
            self._enter("GUIDED", why)
            guided = [n for n in restart.in_guided(snapshot) if n not in taken]
            Holding(self.outbox, self.mission.min_separation_m).step(snapshot, guided)
        else:
            self._flight_list = FlightList.remembered(
                self.mission, self.vehicles, self.outbox, memory.flight_list
            )
            self._enter("CONFIGURATIONS", why)
            self._flight_list.pause(snapshot, taken)

    def stopped(self, reason: str) -> None:
        """Somebody has stopped everybody (/stop_all): no order until the operator confirms
        ``resume``, or aborts."""
        if self.phase in BY_HOME:
            self._stopped = reason
            self.outbox.withdraw(f"everybody was stopped: {reason}")
            self._modes.all_asked(Mode.BRAKE)

    # ---- the story -------------------------------------------------------------------------------

    def step(self, snapshot: Snapshot) -> None:
        """Advance by what is seen; orders go to the outbox."""
        self._snapshot, self.unexplained = snapshot, []
        self._modes.show(snapshot)
        taking_part = self._drop_out(snapshot)
        found = [] if self.over else watch.found(self.mission, self.phase, taking_part)
        if self.phase in FLOWN:
            found += [(Pause.LOST, text) for text in self._dropouts.problems(snapshot)]
        self.problems, self._pauses = [text for _, text in found], {kind for kind, _ in found}
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
            watch.require_flyable(self.mission, self.phase, taking_part)
            if self.phase in story:
                story[self.phase](snapshot)
            self._lose_patience(snapshot)
        except MissionError as error:
            self.abort(str(error))

    def _drop_out(self, snapshot: Snapshot) -> Snapshot:
        """Who is down takes no part any more, once the operator confirms it; what is known of the
        others."""
        flown = self._flight_list
        if self.phase in FLOWN and flown is not None and not flown.going_back:
            for name in self._dropouts.update(snapshot, flown.working):
                flown.leave(snapshot, name)
                self.said.append(f"{name} is down and takes no part any more")
                self._paused_by_operator = True
        return self._dropouts.without(snapshot)

    def _enter(self, phase: str, detail: str, waits_for: str = "") -> None:
        self.phase, self.detail, self.waits_for, self.wants = phase, detail, waits_for, ""
        self._handover = Handover(self.outbox, self._modes)
        self._patience.begin_anew()

    def _wait_vehicles(self, snapshot: Snapshot) -> None:
        self.detail = "waiting for all vehicles"
        if self._memory is not None:
            self._recall(snapshot)
            return
        self.unexplained = restart.in_guided(snapshot)
        self.problems += [
            f"{n} flies in GUIDED and nothing is known of its mission: abort to land, or fly it by hand"
            for n in self.unexplained
        ]
        self.problems = self.problems or self._plan.before_take_off(snapshot)
        self.problems = self.problems or self.gate.before_take_off(snapshot.now_s)
        if not self.problems:
            self._enter("TAKE_OFF", "operators: take off in ALT_HOLD, then LOITER")

    def _take_off(self, snapshot: Snapshot) -> None:
        views = snapshot.vehicles.values()
        up = all(v.armed and v.height_m > _AIRBORNE_M and v.mode == Mode.LOITER for v in views)
        if up and not self.problems:
            self._enter("COLUMN", _LINE_UP[self.mission.tracker])

    def _column(self, snapshot: Snapshot) -> None:
        by_tags = self.mission.tracker == ON_BOARD
        blind = [
            n for n in self.vehicles[1:] if by_tags and snapshot.vehicles[n].sees_front_s < _SEEN_S
        ]
        self.waits_for = "" if self.problems or blind else "calibrate"

    def _guided(self, snapshot: Snapshot) -> None:
        if self._stopped_by_people() or self.problems:
            return
        self._pauses.add(Pause.HANDOVER)
        if not self._handover.step(
            snapshot, [n for n in self.vehicles if n not in self._dropouts.out]
        ):
            self.detail = self._handover.detail or self.detail
            return
        if self._flight_list is None:
            self._flight_list = FlightList.begin(
                self.mission, self.vehicles, self.outbox, snapshot, self._indices or None
            )
            self._flight_list.notes += filter(None, [self._not_reached])
        self._flight_list.resumed()
        self._enter("CONFIGURATIONS", "")

    def _stand_still(self, snapshot: Snapshot) -> None:
        """Everybody was stopped: recorders off, and no more than that, until the operator confirms
        or is too long."""
        if self.phase == "CONFIGURATIONS":
            self._flight_list.pause(snapshot, self._modes.taken)
        if not self._stopped_by_people():
            self.waits_for = "resume"
        self.detail = f"everybody was stopped ({self._stopped}): confirm 'resume', or abort to land"
        self.problems.append(self.detail)
        self._pauses = {Pause.OPERATOR}
        self._lose_patience(snapshot)

    def _stopped_by_people(self) -> bool:
        """Whether somebody else has a vehicle, or the operator wants a pause; he confirms once each
        is given back."""
        taken = self._modes.taken
        self.problems += self._modes.problems()
        if self._paused_by_operator:
            down = " and ".join(sorted(self._dropouts.out))
            why = f"{down} down, the others can go on" if down else "paused by the operator"
            self.problems.append(f"{why}: confirm 'resume'")
        self._pauses |= (
            {Pause.PILOT} if taken else {Pause.OPERATOR} if self._paused_by_operator else set()
        )
        stopped = bool(taken) or self._paused_by_operator
        self.waits_for = "resume" if stopped and self._modes.all_given_back else ""
        return stopped

    def _configurations(self, snapshot: Snapshot) -> None:
        flown, taken = self._flight_list, self._modes.taken
        stopped = self._stopped_by_people() or bool(self._pauses)
        if Pause.LOST in self._pauses or (stopped and not flown.going_back):
            flown.pause(snapshot, taken)
            return
        if flown.going_back and any(
            v.armed and v.mode == Mode.LAND for v in snapshot.vehicles.values()
        ):
            # one comes down already: who is beneath goes aside, nobody crosses below it
            self._end_of_list(flown)
            return
        self.captures += flown.step(snapshot, taken)
        if flown.pop_wants_calibration():
            self.wants = CALIBRATE_IN_FLIGHT
        self.detail = f"{flown.detail} ({flown.going_back})" if flown.going_back else flown.detail
        if flown.finished:
            self._end_of_list(flown)

    def _end_of_list(self, flown: FlightList) -> None:
        if flown.going_back:
            self.abort("; ".join([f"{flown.going_back}: landing", *flown.notes]))
            return
        flown.require_some(len(self.captures))
        self._enter("LAND", "; ".join(["all configurations flown", *flown.notes]))

    def _land(self, snapshot: Snapshot) -> None:
        landed = self._landing.step(snapshot)
        self.problems += self._landing.problems
        if landed:
            self._enter("ABORTED" if self._aborted else "DONE", self.detail)

    # ---- pauses that last too long ---------------------------------------------------------------

    def _lose_patience(self, snapshot: Snapshot) -> None:
        by_hand = self.phase in _BY_HAND and any(v.armed for v in snapshot.vehicles.values())
        flown = self._flight_list
        going_back = flown is not None and bool(flown.going_back)
        lands_there = flown is not None and flown.lands_there
        then = (
            {Pause.OPERATOR: LAND}
            if self._stopped
            else what_follows(self.phase, going_back, by_hand, lands_there)
        )
        pauses = self._pauses | ({Pause.OPERATOR} if by_hand else set())
        ended = self._patience.update(snapshot.now_s, pauses & set(then))
        if ended is None:
            self.problems += self._patience.announcements(snapshot.now_s, then)
        elif then[ended] == BACK:
            self.finish(self._patience.ended(ended))
        else:
            self.abort(f"{self._patience.ended(ended)}: {then[ended]}")
