# SPDX-License-Identifier: Apache-2.0
"""The guardian's process without its transport: what vehicles and the control PC tell in, modes and
verdicts out."""

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from operator import is_
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_control import conditions
from fcsv_control.agent.messages import DONE, Ack, AgentAlive, Instruction, Kind
from fcsv_control.control_messages import MissionAlive
from fcsv_control.flight.messages import (
    AutopilotLimits,
    LinkLives,
    ModeAsked,
    PoseEstimated,
    PoseFed,
)
from fcsv_control.guardian.air import AUTOPILOT_FAILSAFE, LinkReport, Other
from fcsv_control.guardian.core import Guardian
from fcsv_control.guardian.messages import GuardianVerdict, Output, RestartLink
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.frozen import frozen
from fcsv_geometry.home import HomeFrames, Place
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.streams.arrivals import Arrivals
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.thresholds import TRANSMITTER_AGE_S

_STATE_S = 0.2  # a verdict is told at least so often
_COMMANDS_KEPT = 20  # that may still be acknowledged
_CM = 0.01


@frozen
class TrackerConfidence:
    """Holds the confidence of the tracking camera, 0 (failed) to 3 (high); NaN where not known."""

    level: float


@dataclass(frozen=True)
class MissionFence:
    """The fence of the mission that is flown."""

    fence: Fence


@frozen
class OtherGuarded:
    """What the guardian of another vehicle tells."""

    vehicle: str
    verdict: GuardianVerdict


@dataclass
class _Neighbour:
    """Another vehicle, as it told of itself; one that has not told its mode counts as flying."""

    topic: str  # of its odometry
    odometry: Optional[tm.VehicleOdometry] = None
    came_s: float = -math.inf
    armed: bool = True
    mode: Mode = Mode.UNHEARD
    verdict: GuardianVerdict = GuardianVerdict()
    placed: Optional[Tuple] = None  # by what it was placed last


class GuardianPort:
    """Gives AskMode, HoldAt, RestartLink, Warned and Verdict; ``step`` it at 25 Hz."""

    def __init__(self, vehicle: str, rules: GuardianRules, now_s: float):
        self.core = Guardian(vehicle, rules, now_s)
        self._vehicle = vehicle
        self._in_home, self._arrivals = HomeFrames(), Arrivals()
        self._others: Dict[str, _Neighbour] = {}
        self._commands: OrderedDict[Tuple[str, int], Instruction] = OrderedDict()
        self._link_pid = 0
        self._told, self._told_s = GuardianVerdict(), -math.inf
        core = self.core
        self._take = Takers(
            {
                PoseFed: lambda now_s, m: core.pose(now_s, m.T_odom_body),
                PoseEstimated: lambda now_s, m: core.estimate(now_s, m.T_odom_body),
                TrackerConfidence: lambda _now_s, m: core.confidence(m.level),
                LinkLives: self._link,
                AutopilotLimits: lambda _now_s, m: core.slows(
                    m.values.get("WPNAV_ACCEL", math.nan) * _CM
                ),
                ModeAsked: lambda now_s, m: core.mode_asked(now_s, m.mode),
                AgentAlive: lambda now_s, _m: core.agent_lives(now_s),
                MissionAlive: lambda now_s, _m: core.control_lives(now_s),
                MissionFence: lambda _now_s, m: core.mission_fence(m.fence),
                Instruction: self._command,
                Ack: self._answered,
                OtherGuarded: lambda _now_s, m: setattr(
                    self._other(m.vehicle), "verdict", m.verdict
                ),
                tm.VehicleOdometry: self._odometry,
                tm.VehicleState: self._state,
                tm.BatteryCharge: lambda now_s, m: core.battery(now_s, m.share),
                tm.OdometryEpoch: lambda _now_s, m: core.epoch(m.number),
                tm.EpochsFound: self._epochs,
                tm.CalibrationFound: self._calibration,
                tm.HomeFound: lambda _now_s, m: self._in_home.set_home(m.reference, m.T_odom_home),
                tm.RelayAges: lambda _now_s, m: self._arrivals.on_sent(m.topics, m.sent_s),
            },
            "a guardian takes no",
        )

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](now_s, message)

    def step(self, now_s: float) -> Sequence[object]:
        """Look at everything; what is to be done, and the verdict where it is another one or 0.2 s
        old."""
        self._place()
        self.core.step(now_s)
        out: List[object] = [self._addressed(o) for o in self.core.outgoing()]
        verdict = self.core.verdict
        if verdict != self._told or now_s - self._told_s >= _STATE_S:
            self._told, self._told_s = verdict, now_s
            out.append(verdict)
        return out

    # ---- its own vehicle -------------------------------------------------------------------------

    def _state(self, now_s: float, m: tm.VehicleState) -> None:
        if not m.mode:  # its link hears no autopilot (yet): that says nothing of its motors
            return
        if m.vehicle == self._vehicle:
            self.core.state(now_s, m.mode, m.armed)
        else:
            other = self._other(m.vehicle)
            other.armed, other.mode = m.armed, m.mode

    def _link(self, now_s: float, m: LinkLives) -> None:
        self._link_pid = m.pid
        heard = conditions.transmitter(m.throttle, m.throttle_age_s, TRANSMITTER_AGE_S.guardian.red)
        report = LinkReport(
            m.doubt,
            m.ekf_variance,
            m.throttle if heard.green else math.nan,
            m.system_status in AUTOPILOT_FAILSAFE,
            m.origin_set,
            m.parameters_ok,
            m.parameter,
            m.in_the_air,
            m.connected,
        )
        self.core.link(now_s, report)

    def _epochs(self, _now_s: float, m: tm.EpochsFound) -> None:
        if m.of == tm.CALIBRATION and self._vehicle in m.epochs:
            self.core.calibrated(m.epochs[self._vehicle])

    def _calibration(self, _now_s: float, m: tm.CalibrationFound) -> None:
        """Another calibration in flight moves the others' places in home, and is no motion of
        theirs: they are placed by what was heard before it, first by the last one, then by it."""
        self._place()
        self._in_home.calibrate(m.links)
        self._place()

    def _command(self, now_s: float, command: Instruction) -> None:
        self.core.control_lives(now_s)
        if command.kind is Kind.SET_MODE:
            self.core.mode_asked(now_s, command.mode)
        elif command.kind is Kind.LAND:
            self.core.mode_asked(now_s, Mode.LAND)
        self._commands[command.sender, command.number] = command
        while len(self._commands) > _COMMANDS_KEPT:
            self._commands.popitem(last=False)

    def _answered(self, now_s: float, ack: Ack) -> None:
        """A way-point that the agent took: the mission flies the vehicle, as its operator has
        confirmed."""
        command = self._commands.get((ack.sender, ack.number))
        if command is not None and ack.result == DONE and command.kind in (Kind.GOTO, Kind.HOLD):
            self.core.moved(now_s, command.target if command.kind is Kind.GOTO else None)

    # ---- the others ------------------------------------------------------------------------------

    def _other(self, name: str) -> _Neighbour:
        if name not in self._others:
            self._others[name] = _Neighbour(f"/{name}/{tm.VehicleOdometry.topic}")
        return self._others[name]

    def _odometry(self, now_s: float, m: tm.VehicleOdometry) -> None:
        other = self._other(m.vehicle)
        self._arrivals.came(other.topic, m.publisher)
        other.odometry, other.came_s = m, now_s

    def _place(self) -> None:
        """Where it is in home, and where the others are, as far as that is known."""
        places = self._in_home.places
        own = places.get(self._vehicle)
        if own is None:
            self.core.home(None)
        else:
            self.core.home(own.T_a_b, own.sigma_m(self.core.air.p_odom_m))
        for name, heard in self._others.items():
            if name in places and heard.odometry is not None:
                self._place_other(name, heard, places[name])

    def _place_other(self, name: str, heard: _Neighbour, place: Place) -> None:
        """Places another vehicle where it was heard to be, where that is news."""
        odometry, told = heard.odometry, heard.verdict
        heard_s = self._arrivals.since_s(heard.topic, heard.came_s)
        news = (odometry, heard_s, heard.armed, heard.mode, told, place)
        if heard.placed is not None and all(map(is_, news, heard.placed)):
            return
        heard.placed = news
        p_odom_m, T_home_odom = odometry.T_odom_body[:3, 3], place.T_a_b
        to_m = told.going_to_m
        other = Other(
            transforms.apply(T_home_odom, p_odom_m),
            heard_s,
            math.hypot(*odometry.v_body_mps),
            heard.armed,
            heard.mode,
            told.uncontrolled,
            place.sigma_m(p_odom_m),
            told.lost,
            told.lost_s,
            told.taken,
            None if to_m is None else transforms.apply(T_home_odom, np.array(to_m)),
        )
        self.core.other(name, other)

    def _addressed(self, output: Output) -> Output:
        return replace(output, pid=self._link_pid) if isinstance(output, RestartLink) else output
