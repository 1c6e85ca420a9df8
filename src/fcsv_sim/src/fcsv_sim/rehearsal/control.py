# SPDX-License-Identifier: Apache-2.0
"""The control PC of a rehearsal: its processes' ports, and the radio, the clocks and the death that
befall them."""

import dataclasses
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.agent.lease import MISSIONS
from fcsv_control.agent.messages import Ack, Instruction
from fcsv_control.control_messages import (
    Abort,
    CommandAnswered,
    Confirm,
    FollowAsked,
    MissionAlive,
    MissionStatus,
    Operate,
    PairLooked,
    ServiceAnswered,
    ServiceWanted,
    StopCalled,
    StopOver,
    WallClock,
)
from fcsv_control.errors import SessionError
from fcsv_control.guardian.port import MissionFence
from fcsv_control.mission import memory as memories
from fcsv_control.mission.activities.activity import CaptureWindow
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.memory import Memory
from fcsv_control.mission.port import MissionPort
from fcsv_control.mission.snapshot import VehicleView
from fcsv_control.mission.ways.places import FollowPlace
from fcsv_control.ports import ServingPort
from fcsv_control.stopping.core import STOP, Report
from fcsv_control.stopping.port import StopAllPort
from fcsv_geometry import frames
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.streams.arrivals import RELAY
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_sim.rehearsal.board import WALL_S
from fcsv_sim.rehearsal.pairs import PairCheck
from fcsv_sim.rehearsal.radio import CRITICAL_S, Radio
from fcsv_sim.rehearsal.tag_camera import TagCamera
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle
from fcsv_tracking.column.calibration import CalibrationRules
from fcsv_tracking.column.calibration_port import CalibrateColumn, CalibrationPort, HomeWanted
from fcsv_tracking.devices.clocks import ClockOffset, VehicleClock

_STATE_EVERY_S, _POSE_EVERY_S, _SLOW_EVERY_S = 0.5, 0.1, 1.0
# the radio carries 30 poses a second; where nobody needs them all, every third is sent
_POSE_CALIBRATES_S = 0.02
_CLOCK_UNCERTAIN_S = 0.005
_NOTHING = ("", False, False, "", False)  # that a vehicle showed
_ZERO_S = 70_000.0  # its monotonic clock at the rehearsal's zero: each machine's begins elsewhere


class ControlPc:
    """Steps the mission at 10 Hz. ``alive`` False: the mission neither hears nor says anything.
    ``clock_offset_s``: its time of day against the others'; its monotonic clock is another one than
    theirs."""

    def __init__(
        self,
        mission: Mission,
        fleet: Dict[str, RehearsedVehicle],
        radios: Dict[str, Radio],
        seed: int,
    ):
        self._mission, self._fleet, self._radios = mission, fleet, radios
        self.alive, self.stop_all_alive, self.clock_offset_s = True, True, 0.0
        self._runs = 0
        self._memory: Optional[Memory] = None  # what lies on its disk
        # calibration, home, and their epochs: told to who begins to listen
        self._latched: Dict[object, object] = {}
        self._fence = MissionFence(mission.fence)
        self._in_home = HomeFrames()
        self._begin(None)
        self.stop_all_port = StopAllPort(list(fleet), "stop_all")
        self.stopped = Report()  # what became of the last call
        self.battery_share: Dict[str, float] = {}  # overrides what a vehicle says
        column = list(fleet.values())
        self.calibration_port = CalibrationPort(
            {v.name: v.geometry for v in column}, CalibrationRules()
        )
        self._cameras = {
            v.name: TagCamera(v, front, np.random.default_rng([seed, 22, k]))
            for k, (front, v) in enumerate(zip(column, column[1:]))
        }
        self._pair_check = PairCheck(fleet, radios, mission.reference, seed)
        self._due_s = {n: [0.0, 0.0, 0.0] for n in fleet}
        # by the mission's clock, and by the rehearsal's
        self._recorded: Tuple[List[CaptureWindow], List[CaptureWindow]] = ([], [])
        # when what arrived last was sent, by vehicle and kind
        self._newest_s: Dict[Tuple[str, type], float] = {}
        self._shown: Dict[str, Tuple] = {}  # of each vehicle's state, as it arrived
        self._wanted = self._service = ""  # a service to call, and that which was called
        self.replied = tm.Reply(True, "")  # to the last call

    def _begin(self, memory: Optional[Memory], now_s: float = 0.0) -> None:
        """A process of the mission, which has heard nothing but what is latched."""
        self._runs += 1
        column = [v.geometry for v in self._fleet.values()]
        self.mission_port = MissionPort(
            self._mission, column, self.sender, _clock_s(now_s), memory=memory
        )
        for message in self._latched.values():
            self.mission_port.receive(_clock_s(now_s), message)

    @property
    def machine(self) -> MissionMachine:
        """The mission, to look at."""
        return self.mission_port.machine

    @property
    def captures(self) -> List[CaptureWindow]:
        """Recordings so far, by the rehearsal's time."""
        own = self.machine.captures
        if own != self._recorded[0]:
            shifted = [
                dataclasses.replace(w, start_s=w.start_s - _ZERO_S, stop_s=w.stop_s - _ZERO_S)
                for w in own
            ]
            self._recorded = (list(own), shifted)
        return self._recorded[1]

    @property
    def sender(self) -> str:
        """Says as whom the mission commands: each of its processes has a name of its own."""
        return f"{MISSIONS}{self._runs}"

    @property
    def T_home_odom(self) -> Dict[str, np.ndarray]:
        """Gives the transforms by the calibration and home that were found."""
        return self._in_home.T_home_odom

    def view(self, now_s: float, name: str) -> VehicleView:
        """What the mission knows of a vehicle."""
        return self.mission_port.view(_clock_s(now_s), name)

    def ages_s(self, now_s: float, name: str) -> Tuple[float, float]:
        """Says how old the pose and the state are that the mission has of a vehicle."""
        return self.mission_port.ages_s(_clock_s(now_s), name)

    # ---- what the vehicles tell ------------------------------------------------------------------

    def listen(self, now_s: float) -> None:
        """Every vehicle sends what is due over its radio."""
        for name, vehicle in self._fleet.items():
            due, radio, state = self._due_s[name], self._radios[name], vehicle.state
            for ack in vehicle.acks:
                radio.send(now_s, lambda m, v=vehicle: self._answered(v, m), ack, CRITICAL_S)
            vehicle.acks = []
            if now_s >= due[0] and vehicle.odometry is not None:
                fast = self.calibration_port.collects
                due[0], p = (
                    now_s + (_POSE_CALIBRATES_S if fast else _POSE_EVERY_S),
                    vehicle.odometry,
                )
                self._send(
                    now_s,
                    name,
                    [
                        tm.VehicleOdometry(
                            name, RELAY, p.stamp_s, vehicle.T_odom_body, p.linear_mps
                        ),
                        tm.VehicleHeight(name, RELAY, vehicle.height_m),
                        tm.OdometryEpoch(name, RELAY, vehicle.epoch.number, vehicle.epoch.reason),
                    ],
                )
            v = vehicle.guardian.verdict
            shown = (state.mode, state.armed, state.connected, v.in_words, v.lost)
            if now_s >= due[1] or self._shown.get(name) != shown:
                due[1] = now_s + _STATE_EVERY_S
                told = [tm.GuardianStatus(name, RELAY, *shown[3:], v.lost_s)]
                # a link that does not run tells nothing
                if now_s < vehicle.state_s + _STATE_EVERY_S:
                    told.insert(0, tm.VehicleState(name, RELAY, *shown[:3]))
                self._send(now_s, name, told)
            if now_s >= due[2]:
                due[2] = now_s + _SLOW_EVERY_S
                share = self.battery_share.get(name, vehicle.battery_share)
                told = [
                    tm.BatteryCharge(name, RELAY, share),
                    tm.RecorderState(name, RELAY, "", vehicle.pictures),
                ]
                self._send(now_s, name, told)
                ahead_s = vehicle.clock_offset_s - self.clock_offset_s
                offset = ClockOffset(self._wall_s(now_s), ahead_s, _CLOCK_UNCERTAIN_S)
                self.calibration_port.receive(_clock_s(now_s), VehicleClock(name, offset))
        if self.stop_all_alive:
            self._dispatch(now_s, self.stop_all_port.step(_clock_s(now_s)))
        self._pair_check.step(now_s, self.T_home_odom)

    def look(self, now_s: float) -> None:
        """Every camera takes the picture that is due, and tells the tag that is in it."""
        for name, camera in self._cameras.items():
            seen = camera.look(now_s)
            if seen is not None:
                self._send(now_s, name, [seen])

    def _send(self, now_s: float, name: str, messages: Sequence) -> None:
        """All arrive together, unless something newer of the kind came before, with the age that
        the relay measures."""
        kind, mission = (name, type(messages[0])), self.mission_port

        def arrived(_message) -> None:
            if now_s < self._newest_s.get(kind, 0.0):
                return
            self._newest_s[kind] = now_s
            came_s, topics = (
                _clock_s(self._fleet[name].now_s),
                [f"/{name}/{m.topic}" for m in messages],
            )
            ages = tm.RelayAges(topics, [_clock_s(now_s)] * len(topics))
            if mission is self.mission_port:  # a new process hears what is new
                for m in (ages, *messages):
                    mission.receive(came_s, m)
            for m in messages:
                if isinstance(m, (tm.VehicleOdometry, tm.OdometryEpoch, tm.SeenTags)):
                    self.calibration_port.receive(came_s, m)
                elif isinstance(m, tm.VehicleState):
                    self.stop_all_port.receive(came_s, m)
                    self._shown[name] = (
                        m.mode,
                        m.armed,
                        m.connected,
                        *self._shown.get(name, _NOTHING)[3:],
                    )
                elif isinstance(m, tm.GuardianStatus):
                    self._shown[name] = (*self._shown.get(name, _NOTHING)[:3], m.words, m.lost)

        self._radios[name].send(now_s, arrived, None)

    def _answered(self, vehicle: RehearsedVehicle, ack: Ack) -> None:
        answer, now_s = CommandAnswered(vehicle.name, ack), _clock_s(vehicle.now_s)
        self.stop_all_port.receive(now_s, answer)
        if self.alive:
            self.mission_port.receive(now_s, answer)

    # ---- time ------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """One step of the mission."""
        if not self.alive:
            return
        clock_s = _clock_s(now_s)
        if self._wanted:
            self._call_service(now_s)
        self._dispatch(now_s, self.calibration_port.step(clock_s))
        self.mission_port.receive(clock_s, WallClock(clock_s, self._wall_s(now_s), clock_s))
        for name, off in self._pair_check.looks(now_s):
            self.mission_port.receive(clock_s, PairLooked(self._mission.reference, name, off))
        self._dispatch(now_s, self.mission_port.step(clock_s))
        told = MissionAlive(self.sender, clock_s), {MissionFence: self._fence, **self._latched}
        for name, vehicle in self._fleet.items():
            self._radios[name].send(now_s, lambda m, v=vehicle: v.on_control(*m), told)

    def _dispatch(self, now_s: float, outputs: Sequence[object]) -> None:
        """What the ports give, to whom it is for."""
        for output in outputs:
            if isinstance(output, Instruction):
                vehicle = self._fleet[output.vehicle]
                self._radios[output.vehicle].send(now_s, vehicle.obey, output, CRITICAL_S)
            elif isinstance(output, Memory):
                self._memory = dataclasses.replace(output, saved_s=self._wall_s(now_s))
            elif isinstance(output, ServiceWanted):
                self._wanted = output.name
            elif isinstance(output, (tm.CalibrationFound, tm.HomeFound, tm.EpochsFound)):
                self._latch(now_s, output)
            elif isinstance(output, tm.Reply):
                self.replied = output
                self.mission_port.receive(
                    _clock_s(now_s),
                    ServiceAnswered(self._service, output.done, output.text, output.drifted),
                )
            elif isinstance(output, MissionStatus):
                self.calibration_port.receive(_clock_s(now_s), tm.MissionPhase(output.phase))
                if self.stop_all_alive:
                    self.stop_all_port.receive(_clock_s(now_s), tm.MissionPhase(output.phase))
            elif isinstance(output, StopOver):
                self.stop_all_port.receive(_clock_s(now_s), output)
            elif isinstance(output, Report):
                self.stopped = output
            elif isinstance(output, StopCalled) and self.alive:
                self.mission_port.receive(_clock_s(now_s), output)

    def _ask(self, now_s: float, port: ServingPort, request: object) -> tm.Reply:
        """A service is called."""
        answer, *outputs = port.serve(_clock_s(now_s), request)
        self._dispatch(now_s, outputs)
        return answer

    def stop_all(self, now_s: float, asked: str = STOP, reason: str = "a person") -> None:
        """Somebody calls /stop_all (or /land_all): the mission hears it, where it lives."""
        if self.stop_all_alive:
            self._ask(now_s, self.stop_all_port, StopCalled(asked, reason))

    def proceed(self, now_s: float, step: str) -> str:
        """The operator confirms a step; why that is refused, empty where it is not."""
        answer = self._ask(now_s, self.mission_port, Confirm(step))
        return "" if answer.done else answer.text

    def operate(self, now_s: float, operation: str) -> str:
        """The operator changes the list; why that is refused, empty where it is not."""
        answer = self._ask(now_s, self.mission_port, Operate(operation))
        return "" if answer.done else answer.text

    def follow(self, now_s: float, vehicle: str, place: FollowPlace) -> str:
        """Somebody asks a vehicle that follows to a place; why not, empty where it goes."""
        asked = FollowAsked(frames.HOME, vehicle, place)
        answer = self._ask(now_s, self.mission_port, asked)
        return "" if answer.done else answer.text

    def abort(self, now_s: float) -> None:
        """The operator aborts."""
        if self.alive:
            self._ask(now_s, self.mission_port, Abort())

    def die(self) -> None:
        """The whole computer, with the stop-all node."""
        self.alive = self.stop_all_alive = False

    def restart(self, now_s: float, remembers: bool = True) -> None:
        """A new process of the mission, in place of one that died: it reads its memory from the
        disk, where it ``remembers``, and has heard nobody. Calibration and home are another node's,
        and are latched."""
        self._memory = self._memory if remembers else None
        self._wanted = ""
        self._begin(self._recalled(now_s), now_s)
        self.alive = True

    def _recalled(self, now_s: float) -> Optional[Memory]:
        """The memory as its node reads it; None where it sets it aside."""
        if self._memory is None:
            return None
        text, names = memories.to_text(self._memory), list(self._fleet)
        try:
            return memories.from_text(
                text, memories.FILE, self._mission, names, self._wall_s(now_s)
            )
        except SessionError:
            return None

    def _wall_s(self, now_s: float) -> float:
        return WALL_S + now_s + self.clock_offset_s

    # ---- calibration and home --------------------------------------------------------------------

    def _call_service(self, now_s: float) -> None:
        """The mission's call of a service, which waits for its end."""
        service, self._wanted = self._wanted, ""
        requests = {
            "calibrate": CalibrateColumn(()),
            "calibrate_in_flight": CalibrateColumn((), in_flight=True),
            "set_home": HomeWanted(self._mission.reference),
        }
        self._service = service
        self._dispatch(now_s, self.calibration_port.serve(_clock_s(now_s), requests[service]))

    def _latch(self, now_s: float, found: object) -> None:
        """Told to everybody, and to who begins to listen."""
        self._latched[found.of if isinstance(found, tm.EpochsFound) else type(found)] = found
        self.mission_port.receive(_clock_s(now_s), found)
        if isinstance(found, tm.CalibrationFound):
            self._in_home.calibrate(found.links)
        elif isinstance(found, tm.HomeFound):
            self._in_home.set_home(found.reference, found.T_odom_home)


def _clock_s(now_s: float) -> float:
    """Its monotonic clock."""
    return now_s + _ZERO_S
