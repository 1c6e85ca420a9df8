# SPDX-License-Identifier: Apache-2.0
"""The control PC of a rehearsal: the mission, what it heard of the vehicles, calibration and home."""

import dataclasses
import json
import math
from typing import Dict, Optional

import numpy as np

from fcsv_control.agent.messages import Ack, Instruction, Kind
from fcsv_control.mission.heard import FrameEpochs
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.memory import FILE, Memory
from fcsv_control.mission.outbox import Order
from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_geometry import config, transforms
from fcsv_geometry.home import camera_in_home, home_of
from fcsv_geometry.mission import Mission
from fcsv_sim.rehearsal.radio import Radio
from fcsv_sim.rehearsal.vehicle import Heard, RehearsedVehicle

_STATE_EVERY_S, _POSE_EVERY_S, _SLOW_EVERY_S = 0.5, 0.1, 1.0
_CALIBRATES_S = 8.0
_CALIBRATION_M, _CALIBRATION_RAD = 0.03, math.radians(0.3)  # standard deviations: docs/tracking.md
_TAG_M = (1.0, 6.0)  # from how near and how far a tag is seen


class ControlPc:
    """Steps the mission at 10 Hz. ``alive`` False: it neither hears nor says anything."""

    def __init__(self, mission: Mission, fleet: Dict[str, RehearsedVehicle], radios: Dict[str, Radio], seed: int):
        self.machine = MissionMachine(mission, list(fleet))
        self.alive = True
        self._memory: Optional[Memory] = None  # what lies on its disk
        self._runs = 1
        self.battery_share: Dict[str, float] = {}  # overrides what a vehicle says
        self._mission, self._fleet, self._radios = mission, fleet, radios
        self._random = np.random.default_rng([seed, 22])
        self.heard: Dict[str, Heard] = {n: Heard() for n in fleet}
        self._sees_since_s: Dict[str, Optional[float]] = dict.fromkeys(fleet)
        self._due_s = {n: [0.0, 0.0, 0.0] for n in fleet}
        self._T_ref_odom: Dict[str, np.ndarray] = {}  # T_odom1_odomN by the calibration
        self.T_home_odom: Dict[str, np.ndarray] = {}
        self._epochs: Dict[str, int] = {}  # of the calibration
        self._service: Optional[str] = None
        self._service_ends_s = math.inf
        self._cameras = {n: v.geometry.T_body_cam for n, v in fleet.items()}

    # ---- what the vehicles tell --------------------------------------------------------------------------------

    def listen(self, now_s: float) -> None:
        """Every vehicle sends what is due over its radio."""
        for name, vehicle in self._fleet.items():
            due, heard, radio = self._due_s[name], self.heard[name], self._radios[name]
            for ack in vehicle.acks:
                radio.send(now_s, self._acknowledged(name), ack)
            vehicle.acks = []
            if now_s >= due[0] and vehicle.odometry is not None:
                due[0] = now_s + _POSE_EVERY_S
                speed = math.hypot(*vehicle.odometry.linear_mps)
                fields = {"pose": vehicle.T_odom_body, "speed_mps": speed, "height_m": vehicle.height_m}
                radio.send(now_s, _update(heard, "pose_s"), {**fields, "epoch": vehicle.epoch, "pose_s": now_s})
            state = vehicle.link.state
            verdict = vehicle.guardian.verdict
            told = {"mode": state.mode, "armed": state.armed, "guarded": verdict.in_words, "lost": verdict.lost}
            if now_s >= due[1] or any(getattr(heard, k) != v for k, v in told.items()):
                due[1] = now_s + _STATE_EVERY_S
                fields = {**told, "connected": vehicle.link.connected(now_s)}
                radio.send(now_s, _update(heard, "state_s"), {**fields, "state_s": now_s})
            if now_s >= due[2]:
                due[2] = now_s + _SLOW_EVERY_S
                fields = {"battery_share": state.battery_share, "pictures": vehicle.pictures}
                radio.send(now_s, _update(heard, "recorder_s"), {**fields, "recorder_s": now_s})

    def _acknowledged(self, name: str):
        return lambda ack: self._take_ack(name, ack)

    def _take_ack(self, name: str, ack: Ack) -> None:
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
            vehicle = self._fleet[order.vehicle]
            self._radios[order.vehicle].send(
                now_s, lambda c, v=vehicle, t=now_s: v.obey(c, t), _instruction(order, self.sender, now_s)
            )
        for name, vehicle in self._fleet.items():
            told = (self.sender, self.T_home_odom)
            self._radios[name].send(now_s, lambda m, v=vehicle, t=now_s: v.hear_control(t, *m), told)

    def restart(self) -> None:
        """A new process of the mission, in place of one that died: it reads its memory from the disk, and has heard
        nobody. Calibration and home are another node's, and are told again."""
        self._memory = self.machine.memory() or self._memory  # as the dead one wrote it in its last step
        self.machine = MissionMachine(self._mission, list(self._fleet))
        if self._memory is not None:
            saved = json.loads(json.dumps(dataclasses.asdict(self._memory)))
            self.machine.restore(config.from_mapping(saved, Memory, FILE))
        self.heard = {n: Heard() for n in self._fleet}
        self._service = None
        self._runs += 1
        self.alive = True

    def _snapshot(self, now_s: float) -> Snapshot:
        views = {n: self._view(now_s, n) for n in self._fleet}
        return Snapshot(now_s, views, dict(self.T_home_odom), self._cameras)

    def _view(self, now_s: float, name: str) -> VehicleView:
        h, T_home_odom = self.heard[name], self.T_home_odom.get(name)
        known = h.pose is not None and T_home_odom is not None
        return VehicleView(
            guarded=h.guarded, lost=h.lost,
            pose_age_s=now_s - h.pose_s, speed_mps=h.speed_mps, height_m=h.height_m, state_age_s=now_s - h.state_s,
            connected=h.connected, armed=h.armed, mode=h.mode, sees_front_s=self._sees(now_s, name),
            T_home_cam=camera_in_home(T_home_odom, h.pose, self._cameras[name]) if known else None,
            battery_share=self.battery_share.get(name, h.battery_share), recorder_age_s=now_s - h.recorder_s,
            pictures=h.pictures, frame_problem=self._frame_problem(name),
        )  # fmt: skip

    def _frame_problem(self, name: str) -> str:
        epoch = self.heard[name].epoch
        return "" if epoch is None else FrameEpochs(epoch.number, epoch.reason, self._epochs.get(name)).problem

    def _sees(self, now_s: float, name: str) -> float:
        """For how long a vehicle has seen the tag in front, by where they truly are."""
        names = list(self._fleet)
        front = names.index(name) - 1
        if front < 0:
            return 0.0
        step = self._fleet[names[front]].p_world_m - self._fleet[name].p_world_m
        if not (_TAG_M[0] < step[0] < _TAG_M[1] and abs(step[1]) < 0.5 * step[0] and abs(step[2]) < 0.4 * step[0]):
            self._sees_since_s[name] = None
            return 0.0
        if self._sees_since_s[name] is None:
            self._sees_since_s[name] = now_s
        return now_s - self._sees_since_s[name]

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
        order.vehicle, sender, order.number, Kind[order.kind], now_s, order.ordered_s,
        order.expires_s - order.ordered_s, a.get("mode", ""), a.get("flag", False), 0.0, a.get("target"),
        a.get("frame", ""),
    )  # fmt: skip


def _update(heard: Heard, newest: str):
    """Take fields that were sent, unless newer ones came before."""

    def take(fields: dict) -> None:
        if fields[newest] >= getattr(heard, newest):
            for name, value in fields.items():
                if name != "pose" or not heard.lost:  # a place that is lost stays the last that was believed
                    setattr(heard, name, value)

    return take
