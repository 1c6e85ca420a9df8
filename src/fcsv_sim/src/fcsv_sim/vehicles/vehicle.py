# SPDX-License-Identifier: Apache-2.0
"""Bodies stepped in real time; among them a vehicle: airframe, autopilot, RC receiver and MAVLink
link."""

from dataclasses import dataclass, field
from typing import Tuple

import numpy as np

from fcsv_control.flight.mavlink.signing import read_key
from fcsv_geometry import rotations, transforms
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.gps import GpsReceiver
from fcsv_sim.autopilot.ground import READY_S
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.autopilot.udp import AutopilotUdp
from fcsv_sim.people.rc import RcReceiver
from fcsv_sim.truth import TruthWriter
from fcsv_sim.vehicles.dynamics import STEP_S, Airframe, Quadrotor

PASS_S = 0.01  # the autopilot's outer loops run at 100 Hz
_SUBSTEPS = int(round(PASS_S / STEP_S))


@dataclass(frozen=True)
class VehicleParameters:
    """Holds the parameters of one simulated vehicle; start: x, y, z (m) and yaw (rad) in the
    world."""

    name: str
    system_id: int
    sim_dir: str
    companion: str = "127.0.0.1:14550"
    rc_port: int = 5501
    seed: int = 1
    start_xyz_yaw: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    wind_mps: float = 1.0
    ready_s: float = READY_S  # until the autopilot may be armed
    airframe: Airframe = field(default_factory=Airframe)
    signing_key: str = ""  # file of the key with which its autopilot signs
    gps: bool = False  # its autopilot has a receiver, and does not fly by it


class SteppedBody:
    """A body in real time: ``advance_to`` brings it to a time and writes its truth on the way.

    What it is told to do next, ``_decide`` says once per pass.
    """

    def __init__(self, body: Quadrotor, truth: TruthWriter, now_s: float):
        self.body = body
        self._truth = truth
        self._now_s = now_s
        self._command = (0.0, 0.0, 0.0, 0.0)

    @property
    def next_pass_s(self) -> float:
        """When there is something to do again."""
        return self._now_s + PASS_S

    def advance_to(self, now_s: float, most_passes: int = 20) -> None:
        """Catch up with the clock; after a long hiccup time is skipped rather than raced
        through."""
        if now_s - self._now_s > most_passes * PASS_S:
            self._now_s = now_s - most_passes * PASS_S
        while self._now_s + PASS_S <= now_s:
            self._pass()

    def _pass(self) -> None:
        states = self.body.advance(self._command, _SUBSTEPS)
        self._truth.write_records(self.body.felt(states, self._now_s, self._command[3]))
        self._now_s += PASS_S
        self._command = self._decide(states[-1])

    def _decide(self, state: np.ndarray):
        """Roll, pitch (rad), yaw rate (rad/s) and thrust (share) after a state as Quadrotor.advance
        gives it."""
        raise NotImplementedError


def yaw_of(state: np.ndarray) -> float:
    """Heading (rad) of a state."""
    return rotations.yaw(state[6:10].tolist())


class Piloted:
    """An airframe under its autopilot: one pass of both, in real time and rehearsed."""

    def __init__(self, body: Quadrotor, autopilot: Autopilot):
        self._body, self._autopilot = body, autopilot
        self._v_mps, self._q_xyzw = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]  # as sensed last

    @property
    def rpy_rad(self) -> Tuple[float, float, float]:
        """Roll, pitch, yaw (rad, ENU) as sensed last."""
        return rotations.rpy(self._q_xyzw)

    def sense(self, now_s: float, state: np.ndarray) -> None:
        """What the autopilot's sensors feel of a state as Quadrotor.advance gives it."""
        s = state.tolist()
        self._q_xyzw, v = s[6:10], s[3:6]
        before = self._v_mps
        acc = (
            (v[0] - before[0]) / PASS_S,
            (v[1] - before[1]) / PASS_S,
            (v[2] - before[2]) / PASS_S,
        )
        self._v_mps = v
        self._autopilot.barometer.feel(s[2], v, s[14:17])
        if self._autopilot.gps is not None:
            self._autopilot.gps.feel(s[:3])
        yaw_rad = rotations.yaw(self._q_xyzw)
        self._autopilot.estimator.predict(now_s, PASS_S, acc, yaw_rad, s[12], s[2])

    def decide(self, now_s: float) -> Tuple[float, ...]:
        """The airframe's command for the next pass, after ``sense``."""
        return self._autopilot.update(now_s, PASS_S, self._body.on_ground, self._v_mps[2])


class SimulatedVehicle(SteppedBody):
    """Airframe and autopilot."""

    def __init__(self, parameters: VehicleParameters, now_s: float):
        *position, yaw = parameters.start_xyz_yaw
        T_world_body = transforms.from_xyz_yaw(position, yaw)
        seed = parameters.seed * 1000 + parameters.system_id
        body = Quadrotor(parameters.airframe, T_world_body, seed, parameters.wind_mps)
        super().__init__(body, TruthWriter(parameters.sim_dir, parameters.name), now_s)
        self.autopilot = Autopilot(self.body.hover_thrust, seed, parameters.ready_s)
        self.autopilot.gps = GpsReceiver(seed) if parameters.gps else None
        self._rc = RcReceiver(parameters.rc_port)
        server = MavlinkServer(self.autopilot, parameters.system_id)
        key = read_key(parameters.signing_key) if parameters.signing_key else None
        self._line = AutopilotUdp(server, parameters.companion, parameters.system_id, key)
        self._piloted = Piloted(body, self.autopilot)

    def _decide(self, state: np.ndarray):
        frame = self._rc.newest()
        if frame is not None:
            self.autopilot.rc_frame(self._now_s, frame)
        self._piloted.sense(self._now_s, state)
        self._line.step(self._now_s, self._piloted.rpy_rad)
        return self._piloted.decide(self._now_s)

    def close(self) -> None:
        self._rc.close()
        self._line.close()
