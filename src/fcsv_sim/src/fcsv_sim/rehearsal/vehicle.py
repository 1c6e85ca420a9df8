# SPDX-License-Identifier: Apache-2.0
"""One vehicle of a rehearsal: airframe, autopilot, tracker and transmitter of the simulation, and
what is on board."""

import math
from dataclasses import dataclass, field
from typing import Optional, Sequence, Tuple

import numpy as np

from fcsv_control.agent.core import AgentRules
from fcsv_control.guardian.port import TrackerConfidence
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.people.operator import PilotSight, TransmitterSticks
from fcsv_sim.people.rc import frame_of
from fcsv_sim.rehearsal.board import OnBoard
from fcsv_sim.sensors.scene import SimulatedScene
from fcsv_sim.sensors.t265 import T265
from fcsv_sim.vehicles.dynamics import STEP_S, Airframe, Quadrotor
from fcsv_sim.vehicles.vehicle import PASS_S, Piloted

_SUBSTEPS = int(round(PASS_S / STEP_S))
_BOARD_EVERY = 2  # passes between two steps of link and agent
# until the autopilot may be armed; 20 s in a real one, in which nothing happens on the ground
_READY_S = 2.0
# passes between two pictures that are held against the tracker; a multiple of the next
_PICTURE_EVERY = 33
# passes between two samples of the tracker: 33 Hz, what goes to the autopilot of its 200 Hz
_TRACKER_EVERY = 3


@dataclass(frozen=True)
class Start:
    """Where a vehicle stands (x, y, z, yaw in the world) and what the wind is."""

    xyz_yaw: Tuple[float, float, float, float]
    wind_mps: float = 1.0
    tracker: TrackerProfile = T265_PROFILE
    rules: AgentRules = field(default_factory=AgentRules)
    guardian: GuardianRules = field(default_factory=GuardianRules)


class RehearsedVehicle(OnBoard):
    """``step`` advances everything on board by one pass. ``clock_offset_s``: its wall clock against
    the others'."""

    def __init__(self, geometry: VehicleGeometry, start: Start, seed: int):
        seed = seed * 1000 + geometry.system_id
        *position, yaw = start.xyz_yaw
        self.body = Quadrotor(
            Airframe(), transforms.from_xyz_yaw(position, yaw), seed, start.wind_mps
        )
        self.autopilot = Autopilot(self.body.hover_thrust, seed, _READY_S)
        self._server = MavlinkServer(self.autopilot, geometry.system_id)
        self.tracker = T265(start.tracker, geometry.T_body_t265, seed)
        self.tracker_on = True
        self.scene = SimulatedScene(geometry.T_body_cam, seed)
        self._scene_epoch = 0
        super().__init__(geometry, start.tracker, start.rules, start.guardian)
        self.by_hand: Optional[Tuple[float, int]] = None  # when its transmitter chose which mode
        self._switch_at, self._confidence = "", TrackerConfidence(math.nan)  # as it was told
        self._command = (0.0, 0.0, 0.0, 0.0)
        self._piloted = Piloted(self.body, self.autopilot)

    # ---- what people see and do ------------------------------------------------------------------

    @property
    def p_world_m(self) -> np.ndarray:
        """Where it truly is."""
        return self.body.position_m

    def sight(self, others_m: Sequence[np.ndarray] = ()) -> PilotSight:
        """What its pilot sees of it, and of the others."""
        share = self.battery_share if self.battery_said is None else self.battery_said
        body, armed = self.body, self.autopilot.armed
        return PilotSight(
            body.T_world_body, body.velocity_mps, armed, self.state.mode, share, tuple(others_m)
        )

    def sticks(self, now_s: float, s: TransmitterSticks) -> None:
        """A frame of its transmitter."""
        self.autopilot.rc_frame(now_s, frame_of(s.roll, s.pitch, s.throttle, s.yaw, s.mode))
        moved, self._switch_at = s.mode != self._switch_at, s.mode
        if moved and self.autopilot.mode == modes.NUMBERS[s.mode]:
            self.by_hand = (now_s, self.autopilot.mode)

    @property
    def sampled_now(self) -> bool:
        """Whether its odometry is of this very moment."""
        return self.odometry is not None and self.odometry.stamp_s == self._wall_s(self.now_s)

    @property
    def flown_by_hand(self) -> bool:
        """Whether the autopilot is in a mode that the pilot chose."""
        return self.by_hand is not None and self.by_hand[1] == self.autopilot.mode

    # ---- time ------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """One pass of the autopilot (10 ms), which ends at ``now_s``."""
        self.now_s = now_s
        state = self.body.advance(self._command, _SUBSTEPS)[-1]
        self._piloted.sense(now_s, state)
        self._passes += 1
        if self.tracker_on and self._passes % _TRACKER_EVERY == 0:
            self._track(now_s)
        if self._passes % _BOARD_EVERY == 0:
            self._server.step(now_s, self._piloted.rpy_rad)
            self._on_board(now_s)
        self._command = self._piloted.decide(now_s)

    def _track(self, now_s: float) -> None:
        """A sample of the tracker, which has a clock of its own; its driver stamps it by the
        computer's time of day."""
        stamp_s = self._wall_s(now_s)
        if self._confidence.level != self.tracker.confidence:
            self._confidence = TrackerConfidence(self.tracker.confidence)
            self.guardian_port.receive(now_s, self._confidence)
        T_world_body = self.body.T_world_body
        self._sampled(now_s, stamp_s, *self.tracker.odometry(now_s, T_world_body))
        if (
            self._passes % _PICTURE_EVERY == 0
            and self.odometry is not None
            and self.odometry.stamp_s == stamp_s
        ):
            self._pictured(now_s, T_world_body)

    def _pictured(self, now_s: float, T_world_body: np.ndarray) -> None:
        """A picture held against the tracker's motion; another epoch of the odometry is another
        frame."""
        if self._scene_epoch != self.epoch.number:
            self._scene_epoch = self.epoch.number
            self.scene.begin_again()
        angular_radps = np.array(self.odometry.angular_radps)
        seen = self.scene.observe(now_s, T_world_body, self.T_odom_body, angular_radps)
        if seen is not None:
            self.link.receive(now_s, seen)
