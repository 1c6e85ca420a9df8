# SPDX-License-Identifier: Apache-2.0
"""Simulated Tellos in people's hands before a mocap, without ROS and faster than real time: what
each sends and hears goes through the cores of link and tracker."""

from types import SimpleNamespace
from typing import Optional

import numpy as np

from fcsv_control.errors import CommandRefused
from fcsv_control.tello.core import TelloCore
from fcsv_control.tello.messages import FlightReport, GiveSticks, LandNow, StayUp, TakeOffNow
from fcsv_control.tello.pid import PidConfig
from fcsv_control.tello.rules import TelloRules
from fcsv_control.tello.telemetry import OwnOdometry
from fcsv_geometry import config, transforms
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.demo.systems import MOCAP_SITE, T_WORLD_MOCAP
from fcsv_sim.people.tello_hands import LAND, TAKE_OFF, Screen, TelloHands
from fcsv_sim.sensors.tello_sensors import TelloSensors
from fcsv_sim.sensors.v120_duo import FRAME_RATE_HZ, V120Duo, V120DuoErrors
from fcsv_sim.tello.log import tick_of
from fcsv_sim.tello.messages import TelloSticks as DroneSticks
from fcsv_sim.tello.telemetry import _no_delays
from fcsv_sim.tello.vehicle import TelloDrone, TelloDroneParameters
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.ground import GroundTrack, LevelFrame
from fcsv_tracking.mocap.filter import FilterNoise
from fcsv_tracking.mocap.rules import TrackerRules
from fcsv_tracking.mocap.system import MocapSystem
from support.tello_loop import CONFIG

STEP_S = 1.0 / FRAME_RATE_HZ
_MOCAP_S, _LOG_S, _JITTER_S, _LOST, _LINK_STEPS = 0.012, 0.01, 0.024, 0.08, 5
_FLIP = np.array([1.0, -1.0, -1.0])
#: As mocap.launch has it beside links.
RULES = TrackerRules(noise=FilterNoise(odometry_walk_m_per_sqrt_s=0.03, odometry_jitter_s=0.03))
EPOCH_S = 1e9  # as a wall clock


class _One:
    def __init__(self, folder, name: str, start, seed: int, gains: PidConfig, height_m: float):
        self.drone = TelloDrone(
            TelloDroneParameters(name, str(folder), seed, tuple(start)), EPOCH_S
        )
        self.core, self.own = TelloCore(name, gains, TelloRules()), OwnOdometry()
        self.hands, self.track, self.height_m = (
            TelloHands(gains, height_m, MOCAP_SITE.sway_m),
            GroundTrack(),
            height_m,
        )
        self.v_body = np.zeros(3)
        self.sensors, self.count, self.T_N_O, self.pose_s = (
            TelloSensors(_no_delays(), seed),
            0,
            None,
            0.0,
        )

    @property
    def p_m(self) -> np.ndarray:
        return self.drone.body.T_world_body[:3, 3]


class ByHand:
    """``run`` for some time in a phase of the mission."""

    def __init__(self, folder, mission, seed: int = 1):
        names = ["tello1", "tello2"]
        gains, starts = (
            config.load(CONFIG / "velocity.yaml", PidConfig),
            MOCAP_SITE.starts(mission, names),
        )
        self.tellos = {
            n: _One(folder, n, starts[n], 10 * seed + k, gains, mission.home_height_m)
            for k, n in enumerate(names)
        }
        self.duo = V120Duo(V120DuoErrors(swaps_per_s=0.02, flips_per_s=0.005), T_WORLD_MOCAP, seed)
        self.system, self.level = (
            MocapSystem(dict.fromkeys(names, np.eye(4)), RULES),
            LevelFrame(None),
        )
        self.now_s, self._steps, self._waiting = EPOCH_S, 0, []
        self.refused, self._random = [], np.random.default_rng(seed)
        # faults, by vehicle
        self.deaf, self.unseen, self.battery = set(), set(), dict.fromkeys(names, 0.9)

    def run(self, seconds: float, phase: str, until=lambda: False) -> bool:
        """Whether ``until()`` came true within the time."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self._step(phase)
            if until():
                return True
        return False

    def screen(self, name: str) -> Screen:
        one = self.tellos[name]
        state, tracking = one.core.state(self.now_s), one.core.tracking
        return Screen(
            state.armed, state.mode, tracking.T_odom_body, one.v_body, tracking.rate_hz(self.now_s)
        )

    def _step(self, phase: str) -> None:
        self.now_s += STEP_S
        self._steps += 1
        for one in self.tellos.values():
            one.drone.advance_to(self.now_s)
        bodies = {n: one.drone.body.T_world_body for n, one in self.tellos.items()}
        sights = self.duo.frame(self.now_s, bodies)
        self._waiting.append((self.now_s + _MOCAP_S, self._mocap, sights))
        logs = {
            n: r
            for n, r in ((n, self._record(one)) for n, one in self.tellos.items())
            if r is not None
        }
        if logs:
            self._waiting.append(
                (self.now_s + _LOG_S + self._random.exponential(_JITTER_S), self._log, logs)
            )
        due = [w for w in self._waiting if w[0] <= self.now_s]
        self._waiting = [w for w in self._waiting if w[0] > self.now_s]
        for _, take, what in due:
            take(what)
        if self._steps % _LINK_STEPS == 0:
            self._poses()
            for name, one in self.tellos.items():
                self._fly(name, one, phase)

    def _mocap(self, sights) -> None:
        for name, sight in sights.items():
            try:
                q = transforms.fast_quaternion_xyzw(sight.T_M_D)
                self.system.add_mocap(name, self.now_s, self.now_s, sight.T_M_D[:3, 3], q)
            except SampleRejected:
                pass

    def _record(self, one: _One) -> Optional[SimpleNamespace]:
        """An IMU record as tellopy decodes it, with the errors that the simulated Tello's log
        has."""
        found = one.sensors.advance(
            self.now_s, one.drone.body.T_world_body.copy(), one.drone.body.velocity_mps.copy()
        )
        one.count += len(found)
        if not found or one.count % 2 or self._random.uniform() < _LOST:
            return None
        sample = found[0]
        if one.T_N_O is None:
            one.T_N_O = transforms.from_xyz_yaw(np.zeros(3), -transforms.yaw(sample.T_O_D))
        T, v = one.T_N_O @ sample.T_O_D, _FLIP * (one.T_N_O[:3, :3] @ sample.v_O_mps)
        x, y, z, w = transforms.fast_quaternion_xyzw(T)
        accel, gyro = _FLIP * sample.accel_mps2 / 9.81, _FLIP * sample.gyro_radps
        return SimpleNamespace(
            vg_x=v[0],
            vg_y=v[1],
            vg_z=v[2],
            acc_x=accel[0],
            acc_y=accel[1],
            acc_z=accel[2],
            gyro_x=gyro[0],
            gyro_y=gyro[1],
            gyro_z=gyro[2],
            q0=w,
            q1=x,
            q2=-y,
            q3=-z,
            tick=tick_of(self.now_s - EPOCH_S),
        )

    def _log(self, logs) -> None:
        for name, record in logs.items():
            if name in self.deaf:
                continue
            one = self.tellos[name]
            height_m = round(one.drone.drone.felt.height_m, 1)
            report = FlightReport(one.drone.flight.flying, height_m, self.battery[name])
            one.own.height(report.height_m)
            one.core.flight(self.now_s, report)
            motion = one.own.imu(self.now_s, record)
            one.core.log(self.now_s, motion.report)
            one.v_body = motion.v_body_mps
            T = motion.T_own_body
            try:
                self.system.add_vehicle(
                    name,
                    self.now_s,
                    motion.stamp_s,
                    T[:3, 3],
                    transforms.fast_quaternion_xyzw(T),
                    motion.v_body_mps,
                    motion.gyro_radps,
                    motion.accel_mps2,
                )
            except SampleRejected:
                pass  # counted

    def _poses(self) -> None:
        try:
            if self.level.T_tracker_level is None:
                self.level.offer(*self.system.level())
        except GeometryError:
            return
        if self.level.T_tracker_level is None:
            return
        for name, one in self.tellos.items():
            pose = self.system.trackers[name].pose(self.now_s)
            if name in self.unseen or pose is None or pose.stamp_s <= one.pose_s:
                continue
            one.pose_s = pose.stamp_s
            found = one.track.add(
                pose.stamp_s, pose.T_M_D, pose.covariance, self.level.T_tracker_level
            )
            if found is not None:
                one.core.pose(self.now_s, pose.stamp_s, found.T_odom_body)
                self._seen(name, found.T_odom_body, found.v_body_mps)

    def _seen(self, name: str, T_odom_body: np.ndarray, v_body_mps: np.ndarray) -> None:
        """What the tracker tells of a vehicle."""

    def _fly(self, name: str, one: _One, phase: str) -> None:
        act = one.hands.act(self.now_s, phase, self.screen(name))
        try:
            if act.order == TAKE_OFF:
                one.core.take_off(self.now_s, one.height_m)
            elif act.order == LAND:
                one.core.set_mode(self.now_s, Mode.LAND)
        except CommandRefused as error:
            self.refused.append(str(error))
        one.core.pilot(self.now_s, act.sticks)
        one.core.step(self.now_s)
        flight = one.drone.flight
        for output in one.core.outgoing():
            if name in self.deaf:
                continue  # its Wi-Fi is lost, both ways
            if isinstance(output, GiveSticks):
                s = output.sticks
                flight.on_command(self.now_s)
                flight.sticks(
                    self.now_s,
                    DroneSticks(roll=-s.left, pitch=s.forward, throttle=s.up, yaw=-s.turn),
                )
            elif isinstance(output, TakeOffNow):
                flight.take_off()
            elif isinstance(output, LandNow):
                flight.land()
            elif isinstance(output, StayUp):
                flight.cancel_landing()


def apart_m(air: ByHand) -> float:
    a, b = (one.p_m for one in air.tellos.values())
    return float(np.linalg.norm(a - b))
