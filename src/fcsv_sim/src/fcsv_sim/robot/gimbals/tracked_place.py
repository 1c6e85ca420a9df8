# SPDX-License-Identifier: Apache-2.0
"""A rehearsed robot's place by the gimbals on it, which see two vehicles that hold, drift and follow
in steps."""

from typing import Dict, Iterable, List, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.trajectory import Trajectory
from fcsv_guidance.place.cooperative_place import RobotStart, VehicleSighting
from fcsv_guidance.place.hold_places import HOLD_HEIGHT_M, HoldPlaces
from fcsv_guidance.place.stepped_place import PlaceInSteps
from fcsv_guidance.place.steps import MoveVehicle
from fcsv_guidance.place.tracker import LevelPlace, PlaceState, WheelOdometry
from fcsv_guidance.route.following import RouteToFollow
from fcsv_sim.robot.contact import TrueGround
from fcsv_sim.robot.drive import SimulatedRobot
from fcsv_sim.robot.gimbals.survey import SETUP, gimbal_seed
from fcsv_sim.robot.rehearsal.locator import RADIO_S, every
from fcsv_sim.trials.gimbal_evaluation import READ_HZ, GimbalLoop
from fcsv_sim.trials.robot_among_vehicles import Held, HeldVehicle
from fcsv_tracking.gimbal.config import Gimbal

_ODOMETRY_S, _ODOMETRY_LATE_S = 0.05, 0.06
# of where the robot is said to stand: home is what the gimbals see from there
_START_M, _START_RAD = 0.002, np.radians(0.1)


class GimbalPlaces:
    """Gimbals on the robot watch vehicles that hold, and follow along ``way_m`` (N,2) in steps (System
    I); a RobotLocator. The first sights are taken while the robot stands, as long as ``settle_s``."""

    settle_s = 6.0

    def __init__(
        self,
        gimbals: Sequence[Gimbal],
        holds: HoldPlaces,
        true: TrueGround,
        start: Tuple[float, float, float],
        place_seed: int,
        seed: int,
        longest_s: float,
        way_m: np.ndarray,
    ):
        self._way = _TrueWay(true, start)
        z_m = float(true.T_world_robot(*start)[2, 3]) + HOLD_HEIGHT_M
        self._vehicles: Dict[str, HeldVehicle] = {
            g.vehicle: HeldVehicle(Held(*at, z_m), longest_s + 1.0, 10 * seed + k, 0.0)
            for k, (g, at) in enumerate(zip(gimbals, holds.places_m))
        }
        self._loops: Dict[str, GimbalLoop] = {}
        for k, gimbal in enumerate(gimbals):
            seen_from = _SeenFromRobot(self._way, self._vehicles[gimbal.vehicle])
            own = gimbal_seed(place_seed, k)
            self._loops[gimbal.vehicle] = GimbalLoop(gimbal, seen_from, own, SETUP, 0.0)
        self._port = PlaceInSteps(gimbals)
        self._port.receive(0.0, RouteToFollow(way_m))
        sigma = np.array([_START_M, _START_M, _START_RAD])
        off = sigma * np.random.default_rng([seed, 33]).standard_normal(3)
        x, y, yaw = map(float, np.array(start) + off)
        self._port.receive(0.0, RobotStart(0.0, x, y, yaw, np.diag(sigma**2)))
        self._tick, self._wheels = 0, WheelOdometry(0.0, 0.0, 0.0, 0.0)

    def sense(self, now_s: float, machine: SimulatedRobot) -> Iterable[Tuple[float, object]]:
        """Sightings, and what the vehicles' odometries say: (arrival, message)."""
        self._way.add(now_s, machine.x_m, machine.y_m, machine.yaw_rad)
        found: List[Tuple[float, object]] = []
        w = self._wheels
        wheels = w.stamp_s, transforms.from_xyz_yaw([w.x_m, w.y_m, 0.0], w.yaw_rad)
        while self._tick / READ_HZ < now_s - 1e-9:
            tick_s = self._tick / READ_HZ
            for name, loop in self._loops.items():
                for _, pose in loop.step(tick_s, wheels).heard:
                    if pose is not None:
                        seen = VehicleSighting.of_pose(
                            pose.stamp_s, name, pose.T_G_D, pose.covariance
                        )
                        found.append((tick_s + RADIO_S, seen))
            self._tick += 1
        self._wheels = machine.odometry()
        if every(now_s, _ODOMETRY_S):
            for name, vehicle in self._vehicles.items():
                found.append((now_s + _ODOMETRY_LATE_S, vehicle.odometry(name, now_s)))
        return found

    def receive(self, now_s: float, message: object) -> None:
        """A message arrived."""
        self._port.receive(now_s, message)

    def step(self, now_s: float) -> PlaceState:
        """The place as of now."""
        found = self._port.step(now_s)
        if found.move is not None:
            self._send(now_s, found.move, found.vehicles[found.move.vehicle])
        return found.robot

    def _send(self, now_s: float, move: MoveVehicle, believed: LevelPlace) -> None:
        """Sends a vehicle its way, turned into the frame of its odometry."""
        way_m = np.array([move.x_m - believed.x_m, move.y_m - believed.y_m])
        vehicle = self._vehicles[move.vehicle]
        said = vehicle.odometry(move.vehicle, now_s)
        vehicle.fly(now_s + RADIO_S, way_m, said.yaw_rad - believed.yaw_rad)


class _TrueWay:
    """Where the robot truly was, and how it stood on the ground."""

    def __init__(self, true: TrueGround, start: Tuple[float, float, float]):
        self._true, self._poses = true, Trajectory(np.inf)
        self._poses.add(0.0, true.T_world_robot(*start))

    def add(self, stamp_s: float, x_m: float, y_m: float, yaw_rad: float) -> None:
        """It is there now."""
        self._poses.add(stamp_s, self._true.T_world_robot(x_m, y_m, yaw_rad))

    def at(self, stamp_s: float) -> np.ndarray:
        """T_world_robot; it stands before the first step, and after the last."""
        return self._poses.at(float(np.clip(stamp_s, *self._poses.span_s)))


class _SeenFromRobot:
    """A vehicle as the robot's frame has it."""

    def __init__(self, way: _TrueWay, vehicle: HeldVehicle):
        self._way, self._vehicle = way, vehicle

    def at(self, stamp_s: float) -> np.ndarray:
        """T_G_D."""
        return transforms.invert(self._way.at(stamp_s)) @ self._vehicle.T_world_body(stamp_s)
