# SPDX-License-Identifier: Apache-2.0
"""The control PC of a rehearsal: the mission, what it heard of the vehicles, calibration and home."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Callable, Dict, Optional, Tuple

import numpy as np

from fcsv_control.agent.messages import Ack, Instruction, Kind
from fcsv_control.errors import SessionError
from fcsv_control.mission.heard import VehicleHeard
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.memory import FILE, Memory, require_fitting
from fcsv_control.mission.outbox import Order
from fcsv_control.mission.pairs_seen import PairsSeen
from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_control.mission.tag_in_front import TagInFront
from fcsv_control.mission.time_of_day import TimeOfDay
from fcsv_geometry import config, transforms
from fcsv_geometry.home import home_of
from fcsv_geometry.mission import Mission
from fcsv_sim.rehearsal.board import WALL_S
from fcsv_sim.rehearsal.pairs import PairCheck
from fcsv_sim.rehearsal.radio import CRITICAL_S, Radio
from fcsv_sim.rehearsal.stop_desk import StopDesk
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle
from fcsv_tracking.odometry import EpochBegan, Vector

_STATE_EVERY_S, _POSE_EVERY_S, _SLOW_EVERY_S = 0.5, 0.1, 1.0
_CALIBRATES_S = 8.0
_CALIBRATION_M, _CALIBRATION_RAD = 0.03, math.radians(0.3)  # standard deviations: docs/lab/tracking.md
_TAG_M = (1.0, 6.0)  # from how near and how far a tag is seen
_TAG_ERROR = 0.02  # of its place: share of the distance
_ZERO_S = 70_000.0  # its monotonic clock at the rehearsal's zero: each machine's begins elsewhere


class ControlPc:
    """Steps the mission at 10 Hz. ``alive`` False: the mission neither hears nor says anything. ``clock_offset_s``: its
    time of day against the others'; its monotonic clock is another one than theirs."""

    def __init__(self, mission: Mission, fleet: Dict[str, RehearsedVehicle], radios: Dict[str, Radio], seed: int):
        self.machine = MissionMachine(mission, list(fleet))
        self.alive, self.clock_offset_s = True, 0.0
        self.stop_desk = StopDesk(fleet, radios, _clock_s)
        self._memory: Optional[Memory] = None  # what lies on its disk
        self._saved_s = 0.0  # time of day of its last step, by which a memory is kept
        self._runs = 1
        self.battery_share: Dict[str, float] = {}  # overrides what a vehicle says
        self._mission, self._fleet, self._radios = mission, fleet, radios
        self._random, self._random_sight = (np.random.default_rng([seed, k]) for k in (22, 24))
        self._cameras = {n: v.geometry.T_body_cam for n, v in fleet.items()}
        self._pair_check = PairCheck(fleet, radios, mission.reference, seed)
        self._hear_nobody()
        self._due_s = {n: [0.0, 0.0, 0.0] for n in fleet}
        self._T_ref_odom: Dict[str, np.ndarray] = {}  # T_odom1_odomN by the calibration
        self.T_home_odom: Dict[str, np.ndarray] = {}
        self._epochs: Dict[str, int] = {}  # of the calibration
        self._service: Optional[str] = None
        self._service_ends_s = math.inf

    def _hear_nobody(self) -> None:
        """Of what was told before, nothing counts."""
        self.heard = {
            n: VehicleHeard(v.geometry.T_body_cam, T_body_tag=v.geometry.T_body_tag) for n, v in self._fleet.items()
        }
        self._tag_in_front, self._pairs_seen, self._time_of_day = TagInFront(), PairsSeen(), TimeOfDay()
        self._newest_s: Dict[Tuple[str, Callable], float] = {}  # when what was taken last was sent, by vehicle and kind
        self._states: Dict[str, Tuple] = {}  # that arrived

    # ---- what the vehicles tell --------------------------------------------------------------------------------

    def listen(self, now_s: float) -> None:
        """Every vehicle sends what is due over its radio."""
        for name, vehicle in self._fleet.items():
            due, radio, state = self._due_s[name], self._radios[name], vehicle.link.state
            for ack in vehicle.acks:
                radio.send(now_s, self._acknowledged(name), ack, CRITICAL_S)
            vehicle.acks = []
            if now_s >= due[0] and vehicle.odometry is not None:
                due[0] = now_s + _POSE_EVERY_S
                told = (vehicle.T_odom_body, vehicle.odometry.linear_mps, vehicle.height_m, vehicle.epoch)
                self._send(now_s, name, self._pose, told)
            verdict = vehicle.guardian.verdict
            told = (state.mode, state.armed, vehicle.link.connected(now_s), verdict.in_words, verdict.lost)
            if now_s >= due[1] or self._states.get(name) != told:
                due[1] = now_s + _STATE_EVERY_S
                self._send(now_s, name, self._state, (*told, verdict.lost_s))
            if now_s >= due[2]:
                due[2] = now_s + _SLOW_EVERY_S
                share = self.battery_share.get(name, state.battery_share)
                self._send(now_s, name, self._slow, (share, vehicle.pictures))
        self.stop_desk.step(now_s)
        self._pair_check.step(now_s, self.T_home_odom)

    def _send(self, now_s: float, name: str, take: Callable, told: Tuple) -> None:
        """``take`` it when it arrives, unless something newer of the kind came before; it counts from when it was sent,
        as the relay measures it."""
        heard = self.heard

        def arrived(what: Tuple) -> None:
            if heard is self.heard and now_s >= self._newest_s.get((name, take), 0.0):
                self._newest_s[name, take] = now_s
                take(name, now_s, *what)

        self._radios[name].send(now_s, arrived, told)

    def _pose(
        self, name: str, sent_s: float, T_odom_body: np.ndarray, v_body_mps: Vector, height_m: float, epoch: EpochBegan
    ) -> None:
        heard = self.heard[name]
        heard.odometry(sent_s, T_odom_body, v_body_mps)
        heard.position(height_m)
        heard.epochs.now, heard.epochs.reason = epoch.number, epoch.reason

    def _state(
        self, name: str, sent_s: float, mode: str, armed: bool, connected: bool, guarded: str, lost: bool, lost_s: float
    ) -> None:
        self._states[name] = (mode, armed, connected, guarded, lost)
        self.stop_desk.state(sent_s, name, mode, armed)
        self.heard[name].state(sent_s, mode, armed, connected)
        self.heard[name].guardian(sent_s, guarded, lost, lost_s)

    def _slow(self, name: str, sent_s: float, battery_share: float, pictures: int) -> None:
        self.heard[name].battery(sent_s, battery_share)
        self.heard[name].recorder(sent_s, "", pictures)

    def _acknowledged(self, name: str):
        return lambda ack: self._take_ack(name, ack)

    def _take_ack(self, name: str, ack: Ack) -> None:
        self.stop_desk.acknowledged(self._fleet[name].now_s, name, ack)
        if self.alive and ack.sender == self.sender:
            self.machine.outbox.acknowledged(name, ack.number, "" if ack.result == 0 else ack.reason or "refused")

    @property
    def sender(self) -> str:
        """As whom the mission commands: each of its processes has a name of its own."""
        return f"mission-{self._runs}"

    # ---- time --------------------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """One step of the mission."""
        if not self.alive:
            return
        self._serve(now_s)
        self.machine.step(self._snapshot(now_s))
        for order in self.machine.outbox.due(now_s):
            obey = self._fleet[order.vehicle].obey
            self._radios[order.vehicle].send(now_s, obey, _instruction(order, self.sender, now_s), CRITICAL_S)
        for name, vehicle in self._fleet.items():
            told = (self.sender, _clock_s(now_s), self.T_home_odom, self._mission.fence)
            self._radios[name].send(now_s, lambda m, v=vehicle: v.hear_control(*m), told)
        self._saved_s = self._wall_s(now_s)

    def stop_all(self, now_s: float) -> None:
        """Somebody calls /stop_all: the mission hears it, where it lives."""
        if self.alive:
            self.machine.stopped("a person")
        self.stop_desk.call(now_s)

    def proceed(self, step: str) -> str:
        """The operator confirms a step; why that is refused, empty where it is not."""
        refusal = self.machine.proceed(step)
        if step == "resume" and not refusal:
            self.stop_desk.over()
        return refusal

    def die(self) -> None:
        """The whole computer, with the stop-all node."""
        self.alive = self.stop_desk.alive = False

    def restart(self, now_s: float, remembers: bool = True) -> None:
        """A new process of the mission, in place of one that died: it reads its memory from the disk, where it
        ``remembers``, and has heard nobody. Calibration and home are another node's, and are told again."""
        kept = self.machine.memory()
        if kept is not None:  # as the dead one wrote it in its last step
            self._memory = dataclasses.replace(kept, saved_s=self._saved_s)
        self._memory = self._memory if remembers else None
        self.machine = MissionMachine(self._mission, list(self._fleet))
        if self._memory is not None:
            self._restore(self._memory, self._wall_s(now_s))
        self._hear_nobody()
        self._service = None
        self._runs += 1
        self.alive = True

    def _restore(self, memory: Memory, wall_s: float) -> None:
        saved = config.from_mapping(json.loads(json.dumps(dataclasses.asdict(memory))), Memory, FILE)
        try:
            require_fitting(Path(FILE), saved, self._mission, list(self._fleet), wall_s)
        except SessionError:
            return  # its node sets the file aside, and begins anew
        self.machine.restore(saved)

    def _wall_s(self, now_s: float) -> float:
        return WALL_S + now_s + self.clock_offset_s

    def _snapshot(self, now_s: float) -> Snapshot:
        for name, off in self._pair_check.looks(now_s):
            self._pairs_seen.looked(now_s, self._mission.reference, name, off)
        views = self._tag_in_front.judge(now_s, {n: self._view(now_s, n) for n in self._fleet}, self.T_home_odom)
        views = self._pairs_seen.judge(views, self.T_home_odom)
        self._time_of_day.see(now_s, self._wall_s(now_s), now_s)
        return Snapshot(
            now_s, views, dict(self.T_home_odom), self._cameras, clock_set=self._time_of_day.times_set,
            slows_mps2=self._mission.flight.acceleration_mps2,
        )  # fmt: skip

    def _view(self, now_s: float, name: str) -> VehicleView:
        heard = self.heard[name]
        heard.epochs.calibration = self._epochs.get(name)
        step = self._front_seen(name)
        if step is not None:
            heard.front_tag(now_s, self._sighted(name, step))
        return heard.view(now_s, self.T_home_odom.get(name))

    def _front_seen(self, name: str) -> Optional[np.ndarray]:
        """(3,) to the vehicle in front, in the world, where its tag is seen; by where they truly are."""
        names = list(self._fleet)
        front = names.index(name) - 1
        if front < 0:
            return None
        step = self._fleet[names[front]].p_world_m - self._fleet[name].p_world_m
        sees = _TAG_M[0] < step[0] < _TAG_M[1] and abs(step[1]) < 0.5 * step[0] and abs(step[2]) < 0.4 * step[0]
        return step if sees else None

    def _sighted(self, name: str, step: np.ndarray) -> Optional[np.ndarray]:
        """Where it sees that tag, in its odometry frame: by its radio, and with the errors of a tag's place."""
        names, vehicle, radio = list(self._fleet), self._fleet[name], self._radios[name]
        if vehicle.odometry is None or radio.cut or self._random_sight.random() < radio.quality.loss:
            return None
        front = self._fleet[names[names.index(name) - 1]]
        p_world = (front.body.T_world_body @ front.geometry.T_body_tag)[:3, 3]
        p_world = p_world + self._random_sight.normal(0.0, _TAG_ERROR, 3) * np.linalg.norm(step)
        return transforms.apply(vehicle.T_odom_body @ transforms.invert(vehicle.body.T_world_body), p_world)

    # ---- calibration and home ----------------------------------------------------------------------------------

    def _serve(self, now_s: float) -> None:
        if self.machine.wants:
            self._service, self.machine.wants = self.machine.wants, ""
            self._service_ends_s = now_s + (_CALIBRATES_S if self._service == "calibrate" else 0.2)
        if self._service is not None and now_s >= self._service_ends_s:
            service, self._service = self._service, None
            (self._calibrate if service == "calibrate" else self._set_home)()
            self.machine.answer(service, True, "done")

    def _calibrate(self) -> None:
        """Where odometry frames stand to each other, from the truth and the errors of a calibration (link by link)."""
        names = list(self._fleet)
        T_world_odom = {n: v.body.T_world_body @ transforms.invert(v.T_odom_body) for n, v in self._fleet.items()}
        self._epochs = {n: v.epoch.number for n, v in self._fleet.items()}
        for name, vehicle in self._fleet.items():
            vehicle.guardian.calibrated(self._epochs[name])
            if vehicle.agent_runs:
                vehicle.agent.rights.frame.calibrated(self._epochs[name])
        error = np.eye(4)
        self._T_ref_odom = {names[0]: np.eye(4)}
        for name in names[1:]:
            d = self._random.standard_normal(4)
            error = error @ transforms.from_xyz_yaw(d[:3] * _CALIBRATION_M, d[3] * _CALIBRATION_RAD)
            T = transforms.level(transforms.invert(T_world_odom[names[0]]) @ T_world_odom[name])
            self._T_ref_odom[name] = error @ T

    def _set_home(self) -> None:
        reference = self._fleet[self._mission.reference]
        T_ref_home = home_of(reference.T_odom_body @ reference.geometry.T_body_cam)
        self.T_home_odom = {n: transforms.invert(T_ref_home) @ T for n, T in self._T_ref_odom.items()}


def _instruction(order: Order, sender: str, now_s: float) -> Instruction:
    a = order.arguments
    return Instruction(
        order.vehicle, sender, order.number, Kind[order.kind], _clock_s(now_s), _clock_s(order.ordered_s),
        order.expires_s - order.ordered_s, a.get("mode", ""), a.get("flag", False), 0.0, a.get("target"),
        a.get("frame", ""),
    )  # fmt: skip


def _clock_s(now_s: float) -> float:
    """Its monotonic clock."""
    return now_s + _ZERO_S
