# SPDX-License-Identifier: Apache-2.0
"""The view-model: ``tell`` it facts with monotonic time, ask it for a ``view``. It never raises on
what it is told."""

import math
from dataclasses import replace
from typing import Any, Callable, Dict, FrozenSet, List, Mapping, Optional, Sequence, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model import mission_file as files
from fcsv_console.model import planning, stereo
from fcsv_console.model.actions import ActionContext, actions, column_problems
from fcsv_console.model.after import AfterFlight
from fcsv_console.model.air import Above, above
from fcsv_console.model.chronicle import Chronicle
from fcsv_console.model.events import EventLog
from fcsv_console.model.goals import GoalEnabled, GoalMoved, Goals, GoalsElsewhere
from fcsv_console.model.ground_views import GroundViews
from fcsv_console.model.guided_robot import GuidedRobotWatch
from fcsv_console.model.hearing import AgingFact, slow
from fcsv_console.model.own_optics import OwnOptics
from fcsv_console.model.pair import PairWatch
from fcsv_console.model.phase_progress import PhaseProgress
from fcsv_console.model.pictures import NewestPictures
from fcsv_console.model.rehearsal import Rehearsals
from fcsv_console.model.soundness import unsound
from fcsv_console.model.stage import StageWatch
from fcsv_console.model.starting import NORMAL_S, StartWatch
from fcsv_console.model.steady import HOLD_S, SteadyVerdict
from fcsv_console.model.vehicles import VehicleRecord, VehicleRow
from fcsv_console.model.view import ConsoleView
from fcsv_console.model.what_next import guide
from fcsv_control.flight_check.lines import Line
from fcsv_control.flight_check.sightings import Sightings
from fcsv_control.mission.activities.stages import CALIBRATES, GOES_BACK, TURNS
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.phases import BY_HOME, FLOWN, OVER
from fcsv_geometry.missions.separation import SeparationRules
from fcsv_geometry.vehicles.thresholds import MISSION_AGE_S

CONTROL = "control"
_PENDING_S = 10.0  # after it a request that was not answered may be asked for again


class Console:
    """``vehicles``: the column, front first; ``tags``: the tag that each carries; ``target_m``: the
    range wanted; ``since_s``: from when the newest message of a topic counts that came at some time
    (Arrivals.since_s).

    ``verdict_s``: how long another verdict on the pair lasts before it is shown; ``normal_s``: for
    how long a start is normal. ``wall_offset_s`` as Chronicle's. ``recorded``: a recording is
    played.
    """

    def __init__(
        self,
        vehicles: Sequence[str],
        tags: Optional[Mapping[str, int]] = None,
        optics: files.Optics = files.USUAL,
        target_m: float = 0.0,
        since_s: Callable[[str, float], float] = lambda _topic, came_s: came_s,
        verdict_s: float = HOLD_S,
        recorded: bool = False,
        normal_s: float = NORMAL_S,
    ):
        self.names, self.optics, self.file = list(vehicles), optics, files.MissionFile()
        self._own_optics = OwnOptics(optics)
        self._recorded, self._chronicle = recorded, Chronicle()
        self._target_m = target_m
        self._vehicles = {name: VehicleRecord(name, since_s) for name in vehicles}
        self._sightings = Sightings(dict(tags or {}))
        self._mission: AgingFact[f.MissionReport] = AgingFact(math.inf)
        self._alive: AgingFact[f.MissionHeartbeat] = AgingFact(MISSION_AGE_S.console.red)
        self._check: AgingFact[f.FlightCheckReport] = AgingFact(math.inf)
        self._map: AgingFact[f.MapReport] = AgingFact(math.inf)
        self._stop: AgingFact[f.StopReport] = slow()
        self._pair, self._stage, self._steady = (
            PairWatch(vehicles),
            StageWatch(),
            SteadyVerdict(verdict_s),
        )
        self._start, self._phases = StartWatch(normal_s), PhaseProgress()
        self._calibration: Optional[f.CalibrationReport] = None
        self._recorder: AgingFact[f.Recorder] = slow()
        self._calibrated: AgingFact[f.Calibrated] = AgingFact(math.inf)
        self._home: AgingFact[f.HomeSet] = AgingFact(math.inf)
        self._flown: Optional[Mission] = None
        self._goals, self._ground_views = Goals(), GroundViews()
        self._robot = GuidedRobotWatch()
        self._rehearsals, self._pictures, self.after = Rehearsals(), NewestPictures(), AfterFlight()
        self._master_problem = ""
        self._pending: Dict[str, Tuple[float, int]] = {}  # action -> when asked, event

    @property
    def log(self) -> EventLog:
        """Everything that happened."""
        return self._chronicle.log

    @property
    def wall_offset_s(self) -> float:
        return self._chronicle.wall_offset_s

    @wall_offset_s.setter
    def wall_offset_s(self, offset_s: float) -> None:
        self._chronicle.wall_offset_s = offset_s

    # ---- what is told ----------------------------------------------------------------------------

    def tell(self, now_s: float, fact: f.Fact) -> None:
        """Anything out of facts.py; what is not sound is named in ``problems`` and changes nothing
        else."""
        wrong = fact.why if isinstance(fact, f.Unusable) else unsound(fact)
        name = getattr(fact, "vehicle", CONTROL)
        if not wrong and name not in self._vehicles and name != CONTROL:
            wrong = f"'{name}' is not one of {', '.join(self.names)}"
        if wrong:
            subject = f"{'' if name == CONTROL else name} {getattr(fact, 'topic', type(fact).__name__)}".strip()
            self._chronicle.note_bad(now_s, f"{subject}: {wrong}")
            if isinstance(fact, f.Unusable):
                self._pictures.tell(fact)
            return
        self._start.opened(now_s)
        self._chronicle.remember(now_s, fact)
        self._pictures.tell(fact)
        self._pair.tell(now_s, fact)
        self._apply(now_s, fact)

    def load(self, path) -> None:
        """A mission file; what is wrong with it is in the view."""
        self._show_file(files.load(path, self.optics))

    def edit(self, text: str) -> None:
        """The file's text as an editor holds it."""
        self._show_file(files.parse(text, self.file.source, self.optics))

    def _show_file(self, file: files.MissionFile) -> None:
        """Shows the file with ranges and errors of the camera of the file's reference, where that
        was heard."""
        self.file = file
        mission = file.mission or self._flown
        optics = self._own_optics.of(mission.reference if mission is not None else self.names[0])
        if optics != self.optics:
            self.optics = optics
            if file.mission is not None:
                self.file = files.parse(file.text, file.source, optics)

    def drag(self, index: int, value: float, field: str = "baseline_m") -> str:
        """A goal was dragged: another baseline (m), or "tilt_deg", for one configuration. Why it
        stays, "" where it changed."""
        self.file, why = files.changed(self.file, index, field, value, self.optics)
        return why

    def plan(self, wanted: planning.Wanted) -> planning.Planned:
        """Another list from range and error, in the text that is edited; a plan with a problem
        changes nothing."""
        found = planning.planned(wanted, self.file.text, self.optics)
        if not found.problem:
            self.edit(found.text)
        return found

    def waive(self, now_s: float) -> None:
        """The list that is shown is flown though its rehearsal did not pass: this is told."""
        self._rehearsals.waive(self.file.text)
        self.answer(
            self.ask(now_s, "waive", "fly the list unrehearsed"),
            self._rehearsals.of(self.file.text).summary,
            True,
        )

    def ask(self, now_s: float, name: str, words: str = "") -> int:
        """The operator asked for an action: its event's number; until it is answered it is not
        asked for again."""
        number = self._chronicle.event(now_s, "operator", words or name.replace("_", " "))
        self._pending[name] = (now_s, number)
        return number

    def answer(self, number: int, words: str, done: bool) -> None:
        """What became of what was asked for."""
        self.log.answer(number, words, done)
        self._pending = {name: p for name, p in self._pending.items() if p[1] != number}

    def _apply(self, now_s: float, fact: Any) -> None:  # noqa: C901
        whole = {
            f.MissionReport: self._mission,
            f.MissionHeartbeat: self._alive,
            f.FlightCheckReport: self._check,
            f.MapReport: self._map,
            f.StopReport: self._stop,
        }.get(type(fact))
        if isinstance(fact, f.MissionReport):
            self._stage.tell(now_s, fact)
            self._phases.tell(fact.phase)
        if isinstance(fact, f.FlightCheckReport):
            self._start.tell(now_s, fact.lines)
        if whole is not None:
            whole.tell(now_s, fact)
        elif isinstance(fact, (f.Calibrated, f.HomeSet)):
            (self._calibrated if isinstance(fact, f.Calibrated) else self._home).tell(
                now_s, fact, fact.age_s
            )
        elif isinstance(fact, f.CalibrationReport):
            self._calibration = fact
        elif isinstance(fact, f.MasterReport):
            self._master_problem = fact.problem
        elif isinstance(fact, f.MissionFlown):
            read = files.parse(fact.text, "", self.optics)
            self._flown = read.mission
            if not self.file.source and not self.file.text:
                self._show_file(read)  # no file was named: the mission's own is shown
        elif isinstance(fact, f.CameraKnown):
            self._own_optics.tell(fact)
            self._show_file(self.file)
        elif isinstance(fact, f.RehearsalProgress):
            self._rehearsals.tell(fact)
        elif isinstance(fact, f.SeenFrom):
            self._ground_views.tell(now_s, fact)
        elif isinstance(fact, (f.RobotGround, f.RobotRoute, f.RobotSeen, f.RobotStatus)):
            self._robot.tell(now_s, fact)
        elif isinstance(fact, (f.JobProgress, f.PlacesFound)):
            self.after.tell(fact)
        elif isinstance(fact, GoalEnabled):
            self._goals.enable(self.file.rows, fact.index, fact.on)
        elif isinstance(fact, GoalMoved):
            baseline_m = self._goals.moved(self.file.rows, fact.index, fact.p_home_m)
            why = self.drag(fact.index, baseline_m) if baseline_m is not None else ""
            if why:
                self._chronicle.note_bad(now_s, f"goal {fact.index + 1} stays: {why}")
        elif isinstance(fact, (f.MapPicture, f.EpipolarReport, GoalsElsewhere)):
            pass  # NewestPictures and PairWatch keep them, the last is an event
        elif fact.vehicle == CONTROL:
            if isinstance(fact, f.Recorder):
                self._recorder.tell(now_s, fact)
        else:
            if isinstance(fact, f.TagReport):
                self._sightings.saw(now_s, fact.vehicle, fact.ids)
            self._vehicles[fact.vehicle].tell(now_s, fact)

    # ---- what is shown ---------------------------------------------------------------------------

    def view(self, now_s: float) -> ConsoleView:
        """Everything, at monotonic time ``now_s``."""
        mission = self._mission.at(now_s)
        # a bag has no sign of life but the state
        alive = mission.age_s <= MISSION_AGE_S.console.red or not self._alive.at(now_s).stale
        told = mission.value if alive else None
        stop = self._stop.at(now_s)
        flown = told is not None and told.phase in FLOWN
        running = told.configuration if flown and told.configuration < len(self.file.rows) else None
        stage = self._stage.at(now_s, None if running is None else self.file.rows[running])
        rows = self._rows(now_s, stop.value.asked if stop.value else "", running)
        check = self._lines(now_s)
        self._pending = {n: p for n, p in self._pending.items() if now_s - p[0] < _PENDING_S}
        sees = [self._sightings.sees(now_s, b, a) for a, b in zip(self.names, self.names[1:])]
        column = column_problems(self.names, sees)
        rehearsal = self._rehearsals.of(self.file.text)
        recorded = self._stage.recording_since_s is not None  # a recording is judged by itself
        pair = self._steady.at(now_s, (running, recorded), self._stereo(now_s, rows, running, told))
        last = mission.value.phase if mission.value is not None else ""
        ended = last if told is None and last in OVER else ""
        situation = ActionContext(
            self._master_problem,
            told,
            check,
            rows,
            column,
            tuple(self._pending),
            self.file,
            rehearsal,
            self._flown,
            self._recorded,
            ended,
        )
        view = ConsoleView(
            now_s=now_s,
            vehicles=rows,
            mission=mission,
            mission_alive=alive,
            file=self.file,
            running=running,
            progress=self._progress(mission.value if ended else told),
            check=check,
            actions=actions(situation),
            events=self.log.events,
            stereo=pair,
            above=tuple(self._above(rows)),
            control_recorder=self._recorder.at(now_s),
            map=self._map.at(now_s),
            stop=stop,
            home_set=self._home.value is not None,
            rehearsal=rehearsal,
            cameras=self._pictures.cameras([(v.name, v.picture) for v in rows]),
            map_pictures=self._pictures.map(),
            after=self.after.steps([v.name for v in rows if v.armed]),
            places=self.after.places,
            goals=self._goals.shown(self.file.rows),
            problems=self._problems(now_s, told, column, last in OVER),
            master_problem=self._master_problem,
            stage=stage,
            ground_views=self._ground_views.shown(now_s),
            guided_robot=self._robot.shown(now_s),
            recorded=self._recorded,
            calibration=self._calibration,
            starting=self._start.starting(now_s),
            waiting=self._waiting(now_s, told, check),
            ended=bool(ended),
            optics=self.optics,
        )
        return replace(view, guide=guide(view, self._phases.before))

    def _waiting(
        self, now_s: float, told: Optional[f.MissionReport], check: Optional[Sequence[Line]]
    ) -> FrozenSet:
        """Nothing is normal any more once people fly."""
        before = told is None or told.phase == "WAIT_VEHICLES"
        return self._start.waiting(now_s, check) if before else frozenset()

    def _lines(self, now_s: float):
        heard = self._check.at(now_s)
        return (
            None
            if heard.value is None or heard.age_s > heard.value.patience_s
            else heard.value.lines
        )

    def _rows(
        self, now_s: float, stop_asked: str, running: Optional[int]
    ) -> Tuple[VehicleRow, ...]:
        calibrated, commands = self._calibrated.at(now_s), self._alive.at(now_s).value
        sender = commands.instance if commands is not None else ""
        epochs = dict(calibrated.value.epochs) if calibrated.value else {}
        needed_s = files.seconds_left(self.file, running or 0, len(self._vehicles))
        mission = self.file.mission

        def lasts(share: float) -> float:
            return math.nan if mission is None else mission.lasts_s(share)

        return tuple(
            v.row(now_s, (epochs.get(n), calibrated.age_s), stop_asked, needed_s, lasts, sender)
            for n, v in self._vehicles.items()
        )

    def _progress(self, told: Optional[f.MissionReport]) -> float:
        """Gives the progress of the list."""
        if told is None or not told.configurations:
            return 0.0
        last = told.configuration + 1 >= told.configurations
        if told.phase == "DONE" or (
            told.phase == "LAND" and last and self._stage.was_recorded(told.configuration)
        ):
            return 1.0
        return min(
            1.0,
            (told.configuration + self._stage.reached(told.configuration)) / told.configurations,
        )

    def _above(self, rows: Sequence[VehicleRow]) -> List[Above]:
        rules = (
            self.file.mission.air
            if self.file.mission
            else SeparationRules(Mission.min_separation_m)
        )
        places = {
            v.name: v.place.value.p_home_m
            for v in rows
            if v.armed and v.place.value and not v.place.stale
        }
        return above(places, rules)

    def _stereo(
        self,
        now_s: float,
        rows: Sequence[VehicleRow],
        running: Optional[int],
        told: Optional[f.MissionReport],
    ) -> stereo.StereoHealth:
        """Judges the pictures of the configuration that is flown, or before the first one of the
        pair that will fly it."""
        before = running is None and told is not None and told.phase not in (*BY_HOME, *OVER)
        index = 0 if before else running
        mission = self.file.mission
        if (
            index is None
            or mission is None
            or (told is not None and told.stage in (CALIBRATES, GOES_BACK, TURNS))
        ):
            return stereo.StereoHealth()
        if mission.reference not in self._vehicles or len(self.names) < 2:
            return stereo.StereoHealth()
        pair = (mission.reference, mission.mover(index, self.names))
        by_name = {v.name: v for v in rows}
        if pair[1] not in by_name:
            return stereo.StereoHealth(
                pair, reasons=(f"{pair[1]} is not one of {', '.join(self.names)}",)
            )
        offsets_s = {
            n: by_name[n].clock.value.offset_s for n in pair if by_name[n].clock.value is not None
        }
        skew_s = self._pair.skew_s(now_s, pair, offsets_s, self._stage.recording_since_s)
        agree = self._pair.epipolar(now_s, pair)
        if before:
            return stereo.assess_before(pair, skew_s, agree, self.optics)
        row = self.file.rows[index]
        places = tuple(by_name[n].place for n in pair)
        far_m, at_once = self._target_m or row.farthest_m, len(mission.moment_of(index)) > 1
        return stereo.assess(row, pair, *places, skew_s, far_m, self.optics, agree, at_once)

    def _problems(
        self, now_s: float, told: Optional[f.MissionReport], column: Sequence[str], over: bool
    ) -> Tuple[str, ...]:
        """``over``: the mission is; then its master may go."""
        found = [self._master_problem] if self._master_problem and not over else []
        found += [f"mission file: {self.file.error.words}"] if self.file.error else []
        found += list(told.problems) if told is not None else []
        found += list(column) if told is not None and told.phase in ("COLUMN", "CALIBRATE") else []
        return tuple(dict.fromkeys([*found, *self._chronicle.bad(now_s)]))
