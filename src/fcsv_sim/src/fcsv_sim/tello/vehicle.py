# SPDX-License-Identifier: Apache-2.0
"""A whole simulated Tello but for its sockets: airframe, flight, battery, log, protocol and radio;
time is given."""

from dataclasses import dataclass, field
from typing import List, Optional, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_sim.tello.battery import BatteryRules, TelloBattery
from fcsv_sim.tello.drone import Drone, DroneParameters
from fcsv_sim.tello.flight import Felt, FlightRules, TelloFlight
from fcsv_sim.tello.link import Address, SimulatedTelloLink
from fcsv_sim.tello.radio import SimulatedWifi, WifiParameters
from fcsv_sim.tello.telemetry import Telemetry, TelemetryParameters
from fcsv_sim.truth import TruthWriter
from fcsv_sim.vehicles.dynamics import Airframe, Quadrotor
from fcsv_sim.vehicles.tello import tello_airframe
from fcsv_sim.vehicles.vehicle import PASS_S, SteppedBody

_BOOT_S = 30.0  # how long it was switched on when the simulation begins
_HEIGHT_NOISE_M = 0.01


@dataclass(frozen=True)
class TelloDroneParameters:
    """Holds the parameters of one simulated Tello; start: x, y, z (m) and yaw (rad) in the world;
    ``pilot_xyz_m``: who has its Wi-Fi."""

    vehicle: str
    sim_dir: str
    seed: int = 1
    start_xyz_yaw: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    pilot_xyz_m: Tuple[float, float, float] = (0.0, 0.0, 1.0)
    wind_mps: float = 0.5
    flow_bias_mps: float = 0.02
    flow_noise_mps: float = 0.03
    flight: FlightRules = field(default_factory=FlightRules)
    battery: BatteryRules = field(default_factory=BatteryRules)
    telemetry: TelemetryParameters = field(default_factory=TelemetryParameters)
    radio: WifiParameters = field(default_factory=WifiParameters)
    drone: DroneParameters = field(default_factory=DroneParameters)
    airframe: Airframe = field(default_factory=tello_airframe)


class TelloDrone(SteppedBody):
    """advance_to() in real time; datagrams go in by received() and come out by datagrams()."""

    def __init__(self, parameters: TelloDroneParameters, now_s: float):
        p = parameters
        *position, yaw = p.start_xyz_yaw
        body = Quadrotor(p.airframe, transforms.from_xyz_yaw(position, yaw), p.seed, p.wind_mps)
        super().__init__(body, TruthWriter(p.sim_dir, p.vehicle), now_s)
        self._p = p
        self._random = np.random.default_rng([p.seed, 41])
        self._bias_mps = p.flow_bias_mps * self._random.standard_normal(2)
        self.flight = TelloFlight(p.flight, TelloBattery(p.battery), body.hover_thrust, now_s)
        self.telemetry = Telemetry(p.telemetry, p.seed, now_s - _BOOT_S)
        self.radio = SimulatedWifi(p.radio, p.seed, now_s)
        self.drone = Drone(p.drone, self.flight, self.telemetry, self.radio)
        self.link = SimulatedTelloLink(self.drone)

    @property
    def now_s(self) -> float:
        """How far it has come."""
        return self._now_s

    # -- datagrams
    # --------------------------------------------------------------------------------------------------

    def received(self, now_s: float, data: bytes, sender: Address) -> None:
        """What the pilot's machine sent, before its way through the air."""
        self.radio.send(now_s, True, (data, sender))

    def sent_video(self, now_s: float, datagrams: List[bytes]) -> None:
        """Pictures on their way to who asked for them."""
        to = self.link.video_to
        if to is not None:
            for data in datagrams:
                self.radio.send(now_s, False, (data, to, True))

    def datagrams(self, now_s: float) -> List[Tuple[bytes, Address, bool]]:
        """What has come through the air to the pilot's machine: bytes, address, whether it is
        video."""
        return self.radio.arrived(now_s, False)

    # -- every pass
    # -------------------------------------------------------------------------------------------------

    def _decide(self, state: np.ndarray):
        now_s, flight = self._now_s, self.flight
        felt = self._feel(state)
        self.drone.felt = felt
        for data, sender in self.radio.arrived(now_s, True):
            self.link.on_datagram(now_s, data, sender)
        command = flight.decide(now_s, PASS_S, felt, self.body.on_ground)
        flight.battery.drain(PASS_S, command[3] / self.body.hover_thrust)
        self.drone.lean_rad = float(np.hypot(command[0], command[1]))
        self.radio.move(float(np.linalg.norm(state[0:3] - self._p.pilot_xyz_m)))
        T_world_body = transforms.from_xyz_quaternion(state[0:3], state[6:10])
        control = [1000.0 * c for c in command] + [0.0] * 4
        logged = self.telemetry.advance(now_s, T_world_body, state[3:6], felt, control)
        self.link.step(now_s, logged)
        client: Optional[Address] = self.link.client
        for data in self.link.outgoing():
            self.radio.send(now_s, False, (data, client, False))
        return command

    def _feel(self, state: np.ndarray) -> Felt:
        """Its own sensors: flow that is a little off, a range finder below."""
        off = np.append(self._bias_mps, 0.0) + self._random.normal(0.0, self._p.flow_noise_mps, 3)
        height_m = max(0.0, float(state[2]) + self._random.normal(0.0, _HEIGHT_NOISE_M))
        least_m, most_m = self._p.flight.sees_ground_m
        yaw_rad = rotations.yaw(state[6:10].tolist())
        return Felt(height_m, state[3:6] + off, yaw_rad, least_m < height_m < most_m)
