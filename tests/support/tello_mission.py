# SPDX-License-Identifier: Apache-2.0
"""A mission of simulated Tellos before a mocap, without ROS: the cores of mission, agents,
guardians, links, tracker and people, as the launch files join them."""

from typing import Dict, List

import numpy as np

from fcsv_control.agent.core import AgentCore, AgentRules
from fcsv_control.agent.duplicate_agents import DuplicateAgentGuard
from fcsv_control.agent.messages import Ack, Ask, Instruction, Kind, Pictures, SetPoint
from fcsv_control.errors import ControlError
from fcsv_control.guardian.air import LinkReport, Other
from fcsv_control.guardian.core import Guardian
from fcsv_control.guardian.messages import AskMode, HoldAt
from fcsv_control.guardian.rules import GuardianRules
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.operator_commands import OperatorCommands
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.watches.telemetry import VehicleTelemetry
from fcsv_geometry import config, transforms
from fcsv_geometry.rotations import wrap
from fcsv_sim.people.tello_hands import Finger
from support.tello_by_hand import ByHand
from support.tello_loop import CONFIG

_SENDER, _EPOCH = "mission", 7
_GUARDIAN_STEPS, _MISSION_STEPS, _STATE_STEPS = 5, 12, 120
# the mocap's level frame (docs/design/trackers.md)
T_WORLD_LEVEL = transforms.from_xyz_yaw([0.0, 0.0, 0.3], 0.0)


class _Board:
    """Agent and guardian of one vehicle, and what they ask of its link."""

    def __init__(self, name: str, one):
        self.name, self._one = name, one
        self.agent = AgentCore(name, AgentRules(), DuplicateAgentGuard(name, -np.inf))
        self.guardian = Guardian(
            name, config.load(CONFIG.parent / "guardian" / "tello.yaml", GuardianRules)
        )
        self.acks: List[Ack] = []
        self.set_point, self.recording, self.pictures = None, False, 0
        self.T_odom_body, self.v_mps = None, np.zeros(3)

    def step(self, now_s: float, guard: bool) -> None:
        core = self._one.core
        state, tracking = core.state(now_s), core.tracking
        self.agent.state(now_s, state.mode, state.armed)
        self.guardian.state(now_s, state.mode, state.armed)
        self.guardian.battery(now_s, state.battery_share)
        self.guardian.agent_lives(now_s)
        if tracking.T_odom_body is not None:
            self.agent.pose(now_s, tracking.T_odom_body)
            self.guardian.estimate(now_s, tracking.T_odom_body)
        if guard:
            report = LinkReport(
                tracking.doubt(now_s), np.nan, 0.0, False, True, in_the_air=state.armed
            )
            self.guardian.link(now_s, report)
            self.guardian.step(now_s)
            for output in self.guardian.outgoing():
                if isinstance(output, AskMode):
                    core.set_mode(now_s, output.mode)
                elif isinstance(output, HoldAt):
                    self._to(output.T_odom_body)
            v = self.guardian.verdict
            self.agent.guarded(now_s, v.action, v.holds, "; ".join(v.reasons), v.forbids)
        self.agent.step(now_s)
        for output in self.agent.outgoing():
            self._do(now_s, output)

    def _do(self, now_s: float, output) -> None:
        if isinstance(output, Ack):
            self.acks.append(output)
        elif isinstance(output, SetPoint):
            self._to(output.T_odom_body)
        elif isinstance(output, Pictures):
            self.recording = output.on
        elif isinstance(output, Ask):
            try:
                assert output.kind is Kind.SET_MODE, output
                self.guardian.mode_asked(now_s, output.mode)
                self._one.core.set_mode(now_s, output.mode)
                self.agent.state(now_s, output.mode, True)
                self.agent.finished(output, "")
            except ControlError as error:
                self.agent.finished(output, str(error))

    def _to(self, T_odom_body: np.ndarray) -> None:
        self.set_point = T_odom_body
        self._one.core.set_point(T_odom_body)


class TelloMission(ByHand):
    """``fly`` to its end; ``held`` by vehicle: distance (m) and heading (deg) from its set-point by
    the truth, at each step while pictures were recorded."""

    def __init__(self, folder, mission, geometry, seed: int = 1):
        super().__init__(folder, mission, seed)
        self.mission, self._cameras = mission, {n: g.T_body_cam for n, g in geometry.items()}
        self.system._T_body_cam = dict(self._cameras)
        self.machine = MissionMachine(
            mission, list(geometry), {n: g.radius_m for n, g in geometry.items()}
        )
        self.operator = OperatorCommands(self.machine)
        self.boards = {n: _Board(n, one) for n, one in self.tellos.items()}
        self._heard = {n: VehicleTelemetry(T) for n, T in self._cameras.items()}
        self._finger, self.T_home_odom, self.nearest_m = Finger(), {}, np.inf
        self.held: Dict[str, List] = {n: [] for n in geometry}
        self.phases: List[str] = []

    def fly(self, longest_s: float = 240.0, meanwhile=lambda _air: None) -> str:
        """The phase in which it ended; ``meanwhile(self)`` at each step."""
        end_s = self.now_s + longest_s
        while self.now_s < end_s and not (
            self.machine.over and not any(o.core.flying for o in self.tellos.values())
        ):
            self._step(self.machine.phase)
            self._meanwhile()
            meanwhile(self)
        return self.machine.phase

    def _meanwhile(self) -> None:
        if self._steps % _GUARDIAN_STEPS == 0:
            for board in self.boards.values():
                board.step(self.now_s, True)
            self._measure()
        if self._steps % _MISSION_STEPS == 0:
            self._mission_step()

    def _seen(self, name: str, T_odom_body: np.ndarray, v_mps: np.ndarray) -> None:
        board, heard = self.boards[name], self._heard[name]
        board.T_odom_body, board.v_mps = T_odom_body, v_mps
        board.guardian.pose(self.now_s, T_odom_body)
        heard.odometry(self.now_s, T_odom_body, T_odom_body[:3, :3].T @ v_mps)

    def _mission_step(self) -> None:
        now_s, m = self.now_s, self.machine
        for name, one in self.tellos.items():
            heard, board, state = self._heard[name], self.boards[name], one.core.state(now_s)
            T = one.core.tracking.T_odom_body
            if T is not None:
                heard.position(float(T[2, 3]))
            heard.state(now_s, state.mode, state.armed, state.connected)
            v = board.guardian.verdict
            heard.guardian(now_s, v.in_words, v.lost, v.lost_s)
            heard.battery(now_s, state.battery_share)
            board.pictures += board.recording and self._steps % (5 * _MISSION_STEPS) == 0
            heard.recorder(now_s, "", board.pictures)
            for ack in board.acks:
                m.outbox.acknowledged(name, ack.number, "" if ack.result == 0 else ack.reason)
            board.acks = []
            board.agent.sender_lives(now_s, _SENDER, now_s)
            board.guardian.control_lives(now_s)
        views = {n: h.view(now_s, self.T_home_odom.get(n)) for n, h in self._heard.items()}
        m.step(Snapshot(now_s, views, dict(self.T_home_odom), self._cameras))
        self._note(f"{m.phase}: {m.detail} {m.problems}")
        self._serve()
        if self._finger.press(now_s, m.waits_for, {n: self.screen(n) for n in self.tellos}):
            self.operator.proceed(m.waits_for)
        for order in m.outbox.due(now_s):
            a, board = order.arguments, self.boards[order.vehicle]
            told = Instruction(
                order.vehicle,
                _SENDER,
                order.number,
                Kind[order.kind],
                now_s,
                order.ordered_s,
                order.expires_s - order.ordered_s,
                a.get("mode", ""),
                a.get("flag", False),
                0.0,
                a.get("target"),
                a.get("frame", ""),
            )
            if told.kind in (Kind.GOTO, Kind.HOLD):
                board.guardian.moved(now_s, told.target)
            board.agent.receive(now_s, told)

    def _note(self, line: str) -> None:
        if not self.phases or self.phases[-1] != line:
            self.phases.append(line)

    def _serve(self) -> None:
        wants, self.machine.wants = self.machine.wants, ""
        if wants == "calibrate":
            known = self.level.T_tracker_level is not None
            self.machine.answer(wants, known, "one frame" if known else "level is not known yet")
        elif wants == "set_home":
            T_M_level = self.level.T_tracker_level
            self.system.set_home(self.mission.reference, self.now_s, T_M_level[:3, :3])
            self.T_home_odom = dict.fromkeys(self.tellos, self.system.T_home_mocap @ T_M_level)
            for board in self.boards.values():
                board.guardian.home(self.T_home_odom[board.name])
            self.machine.answer(wants, True, "home is set")

    def _measure(self) -> None:
        for name, board in self.boards.items():
            for other, o in self.boards.items():
                if other != name and o.T_odom_body is not None and other in self.T_home_odom:
                    p = (self.T_home_odom[other] @ o.T_odom_body)[:3, 3]
                    state = self.tellos[other].core.state(self.now_s)
                    speed_mps = float(np.linalg.norm(o.v_mps))
                    board.guardian.other(
                        other, Other(p, self.now_s, speed_mps, state.armed, state.mode)
                    )
        a, b = (one.p_m for one in self.tellos.values())
        self.nearest_m = min(self.nearest_m, float(np.linalg.norm(a - b)))
        for name, board in self.boards.items():
            if board.recording and board.set_point is not None:
                T, target = (
                    self.tellos[name].drone.body.T_world_body,
                    T_WORLD_LEVEL @ board.set_point,
                )
                off_rad = wrap(transforms.yaw(T) - transforms.yaw(target))
                self.held[name].append(
                    (np.linalg.norm(T[:3, 3] - target[:3, 3]), abs(np.degrees(off_rad)))
                )
