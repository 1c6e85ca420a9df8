# SPDX-License-Identifier: Apache-2.0
"""A fleet that flies on paper: it obeys orders at a limited speed, in odometry frames of its own,
on a fake clock."""

from dataclasses import dataclass, field
from typing import Dict, List, Optional

import numpy as np
import pytest

from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.operator_commands import OperatorCommands
from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.vehicle import Mount

STEP_S = 0.1
T_BODY_CAM = Mount((0.11, 0.0, 0.03)).T_body_part @ transforms.transform(
    transforms.R_FLU_OPTICAL, np.zeros(3)
)


@dataclass
class FakeVehicle:
    """Truth of one vehicle; ``T_home_odom`` is what calibration and home would say."""

    name: str
    T_home_odom: np.ndarray
    T_home_body: np.ndarray
    mode: str = Mode.STABILIZE
    armed: bool = False
    height_m: float = 0.0
    target: Optional[np.ndarray] = None  # T_odom_body
    recording: bool = False
    sees_front_s: float = 0.0
    heard: bool = True  # its radio works, both ways
    heard_once: bool = False
    push_m: np.ndarray = field(default_factory=lambda: np.zeros(3))  # a gust holds it off its place
    swings_mps: float = 0.0  # back to where it was told to hold
    battery_share: float = 0.9
    recorder_problem: str = ""
    refuses: Dict[str, str] = field(default_factory=dict)  # order kind -> reason
    landed_at: Optional[np.ndarray] = None
    turned_deg: float = 0.0  # off the heading that it was told
    pose_age_s: float = 0.05
    lost: bool = False  # its position, as its guardian says

    @property
    def p_home_cam(self) -> np.ndarray:
        return (self.T_home_body @ T_BODY_CAM)[:3, 3] + self.push_m

    def obey(self, order) -> str:
        """The agent's answer: "" or a reason."""
        if order.kind in self.refuses:
            return self.refuses[order.kind]
        if order.kind == "RECORD":
            self.recording = order.arguments["flag"]
        elif order.kind in ("SET_MODE", "LAND"):
            self.mode, self.target = order.arguments.get("mode", Mode.LAND), None
        elif self.mode != Mode.GUIDED:
            return f"{self.name} is in {self.mode}, not in GUIDED"
        else:
            assert order.kind in ("GOTO", "HOLD"), order.kind
            self.target = order.arguments["target"] if order.kind == "GOTO" else None
            if order.kind == "GOTO":
                assert order.arguments["frame"] == f"{self.name}/odom"
        return ""

    def fly(self, dt_s: float, speed_mps: float) -> float:
        """Speed (m/s) flown in this step."""
        if self.mode == Mode.LAND and self.armed:
            self.height_m -= 1.0 * dt_s
            self.T_home_body[2, 3] -= 1.0 * dt_s
            if self.height_m <= 0:
                self.armed, self.landed_at = False, self.p_home_cam.copy()
        if self.mode != Mode.GUIDED or self.target is None:
            return self.swings_mps
        T_goal = self.T_home_odom @ self.target
        step = T_goal[:3, 3] - self.T_home_body[:3, 3]
        length = float(np.linalg.norm(step))
        share = 1.0 if length <= speed_mps * dt_s else speed_mps * dt_s / length
        self.T_home_body = transforms.transform(
            T_goal[:3, :3], self.T_home_body[:3, 3] + share * step
        )
        return share * length / dt_s


class Flight:
    """A machine and its fleet on a fake clock. Records every distance between two vehicles and
    every order."""

    def __init__(self, mission, names=("uav1", "uav2"), seed=1):
        random = np.random.default_rng(seed)
        self.now_s = 1000.0
        self.machine = MissionMachine(mission, names)
        self.fleet: Dict[str, FakeVehicle] = {}
        for i, name in enumerate(names):
            T_home_odom = transforms.from_xyz_yaw(random.uniform(-20, 20, 3), random.uniform(-3, 3))
            place = [0.1 - mission.column_spacing_m * i, 0.2, 0.1]
            T_home_body = transforms.from_xyz_yaw(
                place, random.uniform(-0.05, 0.05)
            ) @ transforms.invert(T_BODY_CAM)
            T_home_body = transforms.level(T_home_body)
            self.fleet[name] = FakeVehicle(name, T_home_odom, T_home_body)
        self.home_known = False
        self.speed_mps = 2.0
        self.closest_m = float("inf")
        self.orders: List = []
        self.pictures: Dict[str, List[float]] = {n: [] for n in names}
        self.picture_period_s = STEP_S
        self.recorder = None  # the control PC's own
        self.clock_set = 0
        self.lossy = 0.0  # share of commands that get lost
        # what the calibration in flight answers, and the times (s) at which it was called
        self.calibration = {"success": True, "message": "good"}
        self.calibrated_s: List[float] = []
        self._answers_s = float("inf")
        self._random = random

    @property
    def machine(self) -> MissionMachine:
        return self._machine

    @machine.setter
    def machine(self, machine: MissionMachine) -> None:
        """The mission, or the one of a node that was restarted, and its operator."""
        self._machine, self.operator = machine, OperatorCommands(machine)

    def snapshot(self) -> Snapshot:
        views = {}
        for name, v in self.fleet.items():
            speed = v.fly(STEP_S, self.speed_mps)
            v.heard_once |= v.heard
            age = 0.05 if v.heard else 60.0 if v.heard_once else float("inf")
            T_home_cam = v.T_home_body @ T_BODY_CAM
            R_turned = transforms.from_xyz_yaw(np.zeros(3), np.radians(v.turned_deg))[:3, :3]
            T_home_cam[:3, :3] = R_turned @ T_home_cam[:3, :3]
            T_home_cam[:3, 3] += v.push_m
            views[name] = VehicleView(
                pose_age_s=max(age, v.pose_age_s),
                speed_mps=speed,
                height_m=v.height_m,
                state_age_s=age,
                connected=True,
                armed=v.armed and v.heard_once,
                mode=v.mode if v.heard_once else Mode.UNHEARD,
                sees_front_s=v.sees_front_s,
                T_home_cam=T_home_cam if self.home_known else None,
                battery_share=v.battery_share,
                recorder_age_s=0.5,
                recorder_problem=v.recorder_problem,
                pictures=len(self.pictures[name]),
                lost=v.lost,
            )
        known = {n: v.T_home_odom for n, v in self.fleet.items()} if self.home_known else {}
        return Snapshot(
            self.now_s,
            views,
            known,
            dict.fromkeys(self.fleet, T_BODY_CAM),
            self.recorder,
            self.clock_set,
        )

    def step(self) -> None:
        """A tenth of a second."""
        self.now_s += STEP_S
        self.machine.step(self.snapshot())
        if self.machine.wants == "calibrate_in_flight":
            self.machine.wants, self._answers_s = "", self.now_s + 9.0
            self.calibrated_s.append(self.now_s)
        if self.now_s >= self._answers_s:
            self._answers_s = float("inf")
            self.machine.answer("calibrate_in_flight", **self.calibration)
        for order in self.machine.outbox.due(self.now_s):
            self.orders.append((self.now_s, order))
            if self.fleet[order.vehicle].heard and self._random.random() >= self.lossy:
                outcome = self.fleet[order.vehicle].obey(order)
                self.machine.outbox.acknowledged(order.vehicle, order.number, outcome)
        for name, vehicle in self.fleet.items():
            taken = self.pictures[name]
            if vehicle.recording and (
                not taken or self.now_s - taken[-1] > self.picture_period_s - 0.5 * STEP_S
            ):
                taken.append(self.now_s)
        flying = [v for v in self.fleet.values() if v.armed and v.mode != Mode.LAND]
        for i, a in enumerate(flying):
            for b in flying[i + 1 :]:
                self.closest_m = min(
                    self.closest_m, float(np.linalg.norm(a.p_home_cam - b.p_home_cam))
                )

    def until(self, done, limit_s: float = 300.0) -> None:
        """Step until ``done()``; an assertion error where that does not come."""
        end_s = self.now_s + limit_s
        while not done():
            m = self.machine
            assert self.now_s < end_s, (
                f"still {m.phase}: {m.detail}; waits for '{m.waits_for}'; {m.problems}"
            )
            self.step()

    def phase(self, name: str, limit_s: float = 300.0) -> None:
        self.until(lambda: self.machine.phase == name, limit_s)

    def wait(self, seconds: float) -> None:
        for _ in range(int(round(seconds / STEP_S))):
            self.step()

    # ---- the people ------------------------------------------------------------------------------

    def take_off(self) -> None:
        for v in self.fleet.values():
            v.armed, v.mode, v.height_m = True, Mode.LOITER, 4.0

    def press(self, button: str) -> None:
        self.until(lambda: self.machine.waits_for == button, 60.0)
        self.wait(1.1)  # nobody presses twice within a second
        assert self.operator.proceed(button) == ""

    @property
    def captured(self):
        """Indices of the configurations that were recorded, in order."""
        return [w.index for w in self.machine.captures]

    def line_up(self) -> None:
        """Up to the column, where everybody sees the tag in front."""
        self.phase("TAKE_OFF")
        self.take_off()
        self.phase("COLUMN")
        for v in list(self.fleet.values())[1:]:
            v.sees_front_s = 3.0

    def up_to_home(self) -> None:
        """Everything that people do until home is set, done well."""
        self.line_up()
        self.press("calibrate")
        assert self.machine.wants == "calibrate"
        self.machine.answer("calibrate", True, "good")
        self.press("set_home")
        self.home_known = True
        self.machine.answer("set_home", True, "set")

    def up_to_configurations(self) -> None:
        """And hand over to the mission."""
        self.up_to_home()
        self.press("execute")
        self.phase("CONFIGURATIONS")


@pytest.fixture
def flight():
    """flight(mission, names=, seed=) -> Flight."""
    return Flight
