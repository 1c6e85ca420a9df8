# SPDX-License-Identifier: Apache-2.0
"""The mission's process without its transport: telemetry and calls in, commands, states and
recordings out."""

import logging
import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

from fcsv_control import control_messages as told
from fcsv_control.agent.messages import Instruction, Kind
from fcsv_control.mission.activities.activity import CaptureWindow
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.memory import Memory
from fcsv_control.mission.operator_commands import OperatorCommands
from fcsv_control.mission.outbox import Order
from fcsv_control.mission.snapshot import RecorderView, Snapshot, VehicleView
from fcsv_control.mission.time_of_day import TimeOfDay
from fcsv_control.mission.watches.check_gate import OpenGate
from fcsv_control.mission.watches.pairs_seen import PairsSeen
from fcsv_control.mission.watches.tag_in_front import TagInFront
from fcsv_control.mission.watches.telemetry import AGED, VehicleTelemetry
from fcsv_control.stopping.core import STOP
from fcsv_geometry import frames, transforms
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.phases import BY_HOME
from fcsv_geometry.streams.arrivals import Arrivals
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_tracking.column.agreement import ColumnDrift

_log = logging.getLogger(__name__)
_ALIVE_S = 0.2
# so long after a restart a calibration node that lives has told calibration and home
_OTHERS_TELL_S = 3.0
_REMEMBER_EVERY_S = 60.0  # at least, so that a memory's age tells an earlier flight's


@dataclass(frozen=True)
class Captured:
    """A recording; the time of day is the clock of its window plus ``wall_offset_s``."""

    window: CaptureWindow
    wall_offset_s: float
    calibrated_s: float = 0.0  # stamp of the calibration by which it was flown


class MissionPort:
    """``column``: the fleet, front first; ``sender``: as whom it commands; ``memory``: what its
    last run left; ``recorder``: name of the control PC's recorder, which must be well (empty:
    none); ``unfinished``: configurations that an earlier flight left (memory.unfinished_of).
    Raises MissionError where this fleet cannot fly the mission.

    Gives Instruction, MissionAlive, MissionStatus, Captured, Memory, ServiceWanted, StopOver and
    FramesJudged.
    """

    def __init__(
        self,
        mission: Mission,
        column: Sequence[VehicleGeometry],
        sender: str,
        now_s: float,
        gate: Optional[OpenGate] = None,
        memory: Optional[Memory] = None,
        recorder: str = "",
        unfinished: Sequence[int] = (),
    ):
        names = [v.name for v in column]
        self.mission, self.sender = mission, sender
        self.machine = MissionMachine(mission, names, {v.name: v.radius_m for v in column}, gate)
        self.machine.unfinished = list(unfinished)
        self._operator = OperatorCommands(self.machine)
        self._cameras = {v.name: v.T_body_cam for v in column}
        self._front_tags: Dict[str, Optional[int]] = dict(
            zip(names, [None, *(v.tag_id for v in column[:-1])])
        )
        self._arrivals, self._in_home = Arrivals(), HomeFrames()
        self._heard = {v.name: self._no_telemetry(v) for v in column}
        self._tag_in_front, self._pairs_seen, self._time_of_day = (
            TagInFront(),
            PairsSeen(),
            TimeOfDay(),
        )
        self._calibrated_s = 0.0  # the newest calibration is for this moment
        # where the column calibrates again, it may be as far apart until then as trackers drift
        self._drift = ColumnDrift(names) if mission.calibrates_in_flight else None
        self._recorder, self._recorder_heard = recorder, (-math.inf, "")
        self._begun_s, self._alive_s = now_s, -math.inf
        self._captures, self._so_far = 0, []  # told: how many, and windows under way
        self._restored, self._judged = memory is not None, False
        # as it was given; None: a new calibration or home belongs to it
        self._kept: Optional[Memory] = None
        self._kept_s = -math.inf
        if memory is not None:
            _log.info("found the memory of a mission in %s", memory.phase)
            self.machine.restore(memory)
        self._take = Takers(
            {
                tm.VehicleOdometry: self._odometry,
                tm.OdometryEpoch: self._epoch,
                tm.VehicleHeight: self._height,
                tm.VehicleState: self._state,
                tm.GuardianStatus: self._guardian,
                tm.BatteryCharge: self._battery,
                tm.RecorderState: self._recorder_state,
                tm.SeenTags: self._tags,
                tm.RelayAges: self._ages,
                tm.CalibrationFound: self._calibration,
                tm.HomeFound: self._home,
                tm.EpochsFound: self._epochs,
                told.CommandAnswered: self._answer,
                told.WallClock: self._wall,
                told.CheckTable: self._check,
                told.PairLooked: self._pair,
                told.StopCalled: self._stop,
                told.ServiceAnswered: self._service,
            },
            "the mission does not hear",
        )
        self._serve: Dict[type, Callable[[Any], tm.Reply]] = {
            told.Confirm: self._confirm,
            told.Operate: self._operate,
            told.Execute: self._execute,
            told.Abort: self._abort,
            told.Cancel: self._cancel,
            told.FollowAsked: self._follow,
        }

    def _no_telemetry(self, v: VehicleGeometry) -> VehicleTelemetry:
        topics = {topic: f"/{v.name}/{topic}" for topic in AGED}
        return VehicleTelemetry(
            v.T_body_cam, lambda t, s: self._arrivals.since_s(topics[t], s), v.T_body_tag
        )

    # ---- what is heard ---------------------------------------------------------------------------

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known here."""
        self._take[type(message)](now_s, message)

    def _of(self, message) -> VehicleTelemetry:
        self._arrivals.came(f"/{message.vehicle}/{message.topic}", message.publisher)
        return self._heard[message.vehicle]

    def _odometry(self, now_s: float, m: tm.VehicleOdometry) -> None:
        self._of(m).odometry(now_s, m.T_odom_body, m.v_body_mps)
        if self._drift is not None and self._drift.begun:
            self._drift.odometry(m.vehicle, m.stamp_s, m.T_odom_body)

    def _epoch(self, _now_s: float, m: tm.OdometryEpoch) -> None:
        epochs = self._of(m).epochs
        epochs.now, epochs.reason = m.number, m.reason

    def _height(self, _now_s: float, m: tm.VehicleHeight) -> None:
        self._of(m).position(m.z_m)

    def _state(self, now_s: float, m: tm.VehicleState) -> None:
        self._of(m).state(now_s, m.mode, m.armed, m.connected)

    def _guardian(self, now_s: float, m: tm.GuardianStatus) -> None:
        self._of(m).guardian(now_s, m.words, m.lost, m.lost_s)

    def _battery(self, now_s: float, m: tm.BatteryCharge) -> None:
        self._of(m).battery(now_s, m.share)

    def _recorder_state(self, now_s: float, m: tm.RecorderState) -> None:
        if m.vehicle == self._recorder:
            self._recorder_heard = (now_s, m.problem)
        else:
            self._of(m).recorder(now_s, m.problem, m.pictures)

    def _tags(self, now_s: float, m: tm.SeenTags) -> None:
        heard = self._of(m)
        for tag in m.tags:
            if tag.id == self._front_tags[m.vehicle]:
                known = m.T_odom_cam is not None and tag.p_cam_tag_m is not None
                heard.front_tag(
                    now_s, transforms.apply(m.T_odom_cam, tag.p_cam_tag_m) if known else None
                )

    def _ages(self, _now_s: float, m: tm.RelayAges) -> None:
        self._arrivals.on_sent(m.topics, m.sent_s)

    def _calibration(self, _now_s: float, m: tm.CalibrationFound) -> None:
        self._in_home.calibrate(m.links)
        self._calibrated_s, self._kept = m.stamp_s, None
        if self._drift is not None:
            self._drift.calibrate(m.stamp_s, m.links)

    def _home(self, _now_s: float, m: tm.HomeFound) -> None:
        self._in_home.set_home(m.reference, m.T_odom_home)
        self._kept = None

    def _epochs(self, _now_s: float, m: tm.EpochsFound) -> None:
        for name, heard in self._heard.items():
            setattr(heard.epochs, m.of, m.epochs.get(name))

    def _answer(self, _now_s: float, m: told.CommandAnswered) -> None:
        if m.ack.sender == self.sender:
            self.machine.outbox.acknowledged(m.vehicle, m.ack.number, m.outcome)

    def _wall(self, _now_s: float, m: told.WallClock) -> None:
        self._time_of_day.update(m.before_s, m.wall_s, m.after_s)

    def _check(self, now_s: float, m: told.CheckTable) -> None:
        self.machine.gate.tell(now_s, m.lines, m.patience_s)

    def _pair(self, now_s: float, m: told.PairLooked) -> None:
        self._pairs_seen.looked(now_s, m.reference, m.vehicle, m.off)

    def _stop(self, _now_s: float, m: told.StopCalled) -> None:
        if m.asked == STOP:
            self.machine.stopped(m.reason)
        else:
            self.machine.abort(f"landing everybody: {m.reason}")

    def _service(self, _now_s: float, m: told.ServiceAnswered) -> None:
        _log.info("%s: %s", m.name, m.text)
        self.machine.answer(m.name, m.done, m.text, m.drifted)

    # ---- the operator ----------------------------------------------------------------------------

    def serve(self, now_s: float, request: object) -> List[object]:
        """The answer to Confirm, Operate, Execute, Abort, Cancel or FollowAsked, and what follows from
        it at once. Raises TypeError for anything else."""
        serve = self._serve.get(type(request))
        if serve is None:
            raise TypeError(f"the mission does not serve {type(request).__name__}")
        answer = serve(request)
        out: List[object] = [answer]
        if answer.done and request in (told.Confirm("resume"), told.Operate("resume")):
            out.append(told.StopOver("the operator resumes"))
        return out + self._wanted()

    def _wanted(self) -> List[object]:
        wanted, self.machine.wants = self.machine.wants, ""
        return [told.ServiceWanted(wanted)] if wanted else []

    def _confirm(self, request: told.Confirm) -> tm.Reply:
        refusal = self._operator.proceed(request.step)
        return tm.Reply(not refusal, refusal or f"confirmed: {request.step}")

    def _operate(self, request: told.Operate) -> tm.Reply:
        refusal = self._operator.control(request.operation)
        _log.info("%s: %s", request.operation, refusal or "done")
        return tm.Reply(not refusal, refusal or f"done: {request.operation}")

    def _execute(self, request: told.Execute) -> tm.Reply:
        refusal = self._operator.execute(request.configurations)
        return tm.Reply(not refusal, refusal)

    def _abort(self, _request: told.Abort) -> tm.Reply:
        refusal = self._operator.control("abort")
        landing = "landing the vehicles that the mission flies; who is flown by hand lands by hand"
        return tm.Reply(not refusal, refusal or landing)

    def _cancel(self, _request: told.Cancel) -> tm.Reply:
        self.machine.finish("cancelled by who asked for it")
        return tm.Reply(True, "")

    def _follow(self, m: told.FollowAsked) -> tm.Reply:
        if m.frame != frames.HOME:
            refusal = f"its frame is '{m.frame}', not {frames.HOME}"
        elif not m.place.is_finite:
            refusal = f"{m.place} is no place"
        else:
            refusal = self.machine.follow(m.vehicle, m.place)
        return tm.Reply(not refusal, refusal)

    # ---- time ------------------------------------------------------------------------------------

    def step(self, now_s: float) -> List[object]:
        """The mission goes on, by what was heard until now."""
        m, phase = self.machine, self.machine.phase
        m.step(self._snapshot(now_s))
        if m.phase != phase:
            _log.info("%s -> %s: %s", phase, m.phase, m.detail)
        out = self._end_restoring(now_s) + self._wanted()
        out += [self._instruction(order, now_s) for order in m.outbox.due(now_s)]
        out.append(
            told.MissionStatus(
                m.phase,
                m.detail,
                m.waits_for,
                m.stage,
                m.configuration,
                list(m.problems),
                m.over,
                m.progress,
                list(dict.fromkeys(w.index for w in m.captures)),
                m.viewpoint.station,
                m.viewpoint.heading_rad,
            )
        )
        if now_s - self._alive_s >= _ALIVE_S - 1e-3:
            self._alive_s = now_s
            out.append(told.MissionAlive(self.sender, now_s))
        return out + self._recordings() + self._remember(now_s)

    def view(self, now_s: float, name: str) -> VehicleView:
        """What is known of a vehicle."""
        return self._heard[name].view(now_s, self._in_home.T_home_odom.get(name))

    def ages_s(self, now_s: float, name: str) -> Tuple[float, float]:
        """Says how old the newest pose and state of a vehicle are."""
        heard = self._heard[name]
        return heard.pose_age_s(now_s), heard.state_age_s(now_s)

    def _snapshot(self, now_s: float) -> Snapshot:
        T_home_odom, clock_set = self._in_home.T_home_odom, self._time_of_day.times_set
        heard_s, problem = self._recorder_heard
        recorder = RecorderView(now_s - heard_s, problem) if self._recorder else None
        views = {n: h.view(now_s, T_home_odom.get(n)) for n, h in self._heard.items()}
        apart_m = None if self._drift is None else self._drift.most_apart_m
        views = self._pairs_seen.check_views(
            self._tag_in_front.check_views(now_s, views, T_home_odom, apart_m), T_home_odom
        )
        slows_mps2 = self.mission.flight.acceleration_mps2
        return Snapshot(now_s, views, T_home_odom, self._cameras, recorder, clock_set, slows_mps2)

    def _end_restoring(self, now_s: float) -> List[object]:
        """Once the machine knows whether the last run's memory counts: its calibration and home
        count, or do not."""
        for text in self.machine.said:
            _log.warning("%s", text)
        self.machine.said.clear()
        if not self._restored or self._judged or self.machine.memory() is None:
            return []
        if self.machine.phase not in BY_HOME:
            self._restored, self._in_home = False, HomeFrames()
            return [told.FramesJudged(False)]
        self._judged = now_s - self._begun_s >= _OTHERS_TELL_S
        return [told.FramesJudged(True)] if self._judged else []

    def _recordings(self) -> List[object]:
        """Gives the recordings: after a restart they are told again, once who records them is
        connected."""
        if self._restored and not self._judged:
            return []
        m, offset_s = self.machine, self._time_of_day.offset_s
        new = [*(w for w in m.so_far if w not in self._so_far), *m.captures[self._captures :]]
        self._so_far, self._captures = list(m.so_far), len(m.captures)
        return [Captured(window, offset_s, self._calibrated_s) for window in new]

    def _remember(self, now_s: float) -> List[object]:
        memory = self.machine.memory()
        if memory is None or (memory == self._kept and now_s - self._kept_s < _REMEMBER_EVERY_S):
            return []
        self._kept, self._kept_s = memory, now_s
        return [memory]

    def _instruction(self, order: Order, now_s: float) -> Instruction:
        a = order.arguments
        return Instruction(
            order.vehicle,
            self.sender,
            order.number,
            Kind[order.kind],
            now_s,
            order.ordered_s,
            order.expires_s - order.ordered_s,
            a.get("mode", Mode.UNHEARD),
            a.get("flag", False),
            0.0,
            a.get("target"),
            a.get("frame", ""),
        )
