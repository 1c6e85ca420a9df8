# SPDX-License-Identifier: Apache-2.0
"""The agent's decisions: commands, states and time in; requests to the flight link, answers and set-points out.

No ROS, no thread, no clock. ``now_s`` is monotonic time, ``wall_s`` the wall clock in which commands expire.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Deque, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from fcsv_control.agent.commands import Answer, CommandLog, Verdict
from fcsv_control.agent.holder import Holder, Limits
from fcsv_control.agent.link_loss import LinkLoss
from fcsv_control.errors import CommandRefused
from fcsv_geometry import frames
from fcsv_geometry.flow import RateGate

DONE, REFUSED, TOO_LATE = 0, 1, 2  # CommandAck.result
STOPPING_MODES = frozenset({"LAND", "BRAKE"})
MISSION_MODES = frozenset({"GUIDED", *STOPPING_MODES})  # what a mission needs; any other mode is a pilot's
_QUIET_S = 0.15  # set-points on their way arrive before the take-off that they would replace


class Kind(Enum):
    """What a command asks for; values as in fcsv_msgs/Command."""

    SET_MODE = 1
    GOTO = 2
    HOLD = 3
    RECORD = 4
    LAND = 5
    ARM = 6
    TAKEOFF = 7


@dataclass(frozen=True)
class Instruction:
    """A numbered command; ``expires_s`` by the wall clock. Which of the other fields count depends on the kind."""

    vehicle: str
    sender: str
    number: int
    kind: Kind
    expires_s: float
    mode: str = ""
    flag: bool = False
    altitude_m: float = 0.0
    target: Optional[np.ndarray] = None  # T_odom_body
    frame: str = ""

    @property
    def stops(self) -> bool:
        """Whether it stops the vehicle: it never waits and never comes too late by the clock."""
        return self.kind in (Kind.HOLD, Kind.LAND) or (self.kind is Kind.SET_MODE and self.mode in STOPPING_MODES)


@dataclass(frozen=True)
class Ask:
    """A request to the flight link; ``AgentCore.finished`` is told of its end."""

    kind: Kind  # SET_MODE, ARM or TAKEOFF
    mode: str = ""
    flag: bool = False
    altitude_m: float = 0.0
    number: int = 0


@dataclass(frozen=True)
class Ack:
    """The answer to a command."""

    sender: str
    number: int
    result: int
    reason: str


@dataclass(frozen=True)
class SetPoint:
    """Where to hold: T_odom_body."""

    T_odom_body: np.ndarray


@dataclass(frozen=True)
class Pictures:
    """Whether the recorder writes pictures."""

    on: bool


@dataclass(frozen=True)
class Said:
    """Something that the log and the operator should know."""

    text: str


Output = Union[Ask, Ack, SetPoint, Pictures, Said]


@dataclass(frozen=True)
class AgentRules:
    """``link_loss_land_s`` 0: hold for ever when the control PC is silent. ``maintenance`` permits any mode."""

    set_point_rate_hz: float = 10.0
    link_loss_land_s: float = 0.0
    maintenance: bool = False
    limits: Limits = field(default_factory=Limits)


class AgentCore:
    """One vehicle's agent. A job that needs the flight link waits for the one before it; stopping waits for nothing."""

    def __init__(self, vehicle: str, rules: AgentRules):
        self._vehicle, self._rules = vehicle, rules
        self._log = CommandLog(vehicle)
        self._holder = Holder(frames.odom(vehicle), rules.limits)
        self._link_loss = LinkLoss(rules.link_loss_land_s)
        self._gate = RateGate(rules.set_point_rate_hz)
        self._waiting: Deque[Instruction] = deque()
        self._running: Optional[Instruction] = None
        self._asked: Dict[int, Optional[Instruction]] = {}  # by the ask's number; None: the agent's own
        self._due: List[Tuple[float, Ask]] = []  # asks that wait for a moment
        self._asks = 0
        self._out: List[Output] = []
        self._guarded = ""  # why the guardian flies, empty where it does not
        self._forbidden: Sequence[str] = ()

    # ---- what is heard ---------------------------------------------------------------------------------------

    def state(self, mode: str, armed: bool) -> None:
        """The flight controller's mode."""
        self._holder.state(mode, armed)

    def pose(self, now_s: float, T_odom_body: np.ndarray) -> None:
        """The autopilot's estimate came; a jump of it is said."""
        moved_m = self._holder.pose(now_s, T_odom_body)
        if moved_m:
            self._say(f"the autopilot's estimate jumped by {moved_m:.1f} m; the target moves along")

    def control_heard(self, now_s: float) -> None:
        """Something came from the control PC."""
        self._link_loss.heard(now_s)

    def guarded(self, holds: bool, why: str, forbids: Sequence[str]) -> None:
        """The guardian's verdict: while it ``holds`` the vehicle the agent is quiet, and thereafter holds where it is;
        ``forbids`` tells why the vehicle is not to be handed over."""
        if self._guarded and not holds:
            self._holder.stay()
        self._guarded = (why or "it holds") if holds else ""
        self._forbidden = forbids

    def take(self, wall_s: float, c: Instruction) -> None:
        """A command came, perhaps again."""
        moves = c.kind is not Kind.RECORD
        verdict, answer = self._log.judge(wall_s, c.vehicle, c.sender, c.number, moves, c.expires_s, c.stops)
        if verdict is Verdict.EXPIRED:
            self._answer(c, TOO_LATE, "came too late, or after a newer one")
        elif verdict is Verdict.REPEAT:
            self._out.append(Ack(c.sender, c.number, answer.result, answer.reason))
        elif verdict is Verdict.EXECUTE and c.stops:
            self._stop(c)
        elif verdict is Verdict.EXECUTE:
            self._waiting.append(c)

    def finished(self, ask: Ask, refusal: str) -> None:
        """The flight link has done it ("") or refused."""
        c = self._asked.pop(ask.number, None)
        if ask.kind is Kind.TAKEOFF and refusal:
            self._holder.take_off_refused()
        if c is None:
            return
        self._answer(c, REFUSED if refusal else DONE, refusal)
        if c is self._running:
            self._running = None

    # ---- time ------------------------------------------------------------------------------------------------

    def step(self, now_s: float, wall_s: float) -> None:
        """Time passes: the next job, the target at its rate, a control PC that is silent."""
        while self._running is None and self._waiting:
            self._begin(now_s, wall_s, self._waiting.popleft())
        self._out += [ask for due_s, ask in self._due if now_s >= due_s]
        self._due = [(due_s, ask) for due_s, ask in self._due if now_s < due_s]
        target = self._holder.target
        if target is not None and not self._guarded and self._gate.passes(now_s):
            self._out.append(SetPoint(target))
        if self._link_loss.land(now_s, self._holder.mode, self._holder.armed):
            self._say("nothing from the control PC for too long, landing")
            self._ask(None, Kind.SET_MODE, mode="LAND")

    def outgoing(self) -> List[Output]:
        """What to do and to send now, each given once."""
        out, self._out = self._out, []
        return out

    # ---- what is done ----------------------------------------------------------------------------------------

    def _begin(self, now_s: float, wall_s: float, c: Instruction) -> None:
        if wall_s > c.expires_s:
            self._answer(c, TOO_LATE, "waited too long for the command before it")
            return
        try:
            self._execute(now_s, c)
        except CommandRefused as error:
            self._answer(c, REFUSED, str(error))

    def _execute(self, now_s: float, c: Instruction) -> None:
        if c.kind is Kind.RECORD:
            self._out.append(Pictures(c.flag))
            self._answer(c, DONE, "")
        elif self._guarded and c.kind in (Kind.GOTO, Kind.TAKEOFF):
            raise CommandRefused(f"the guardian flies: {self._guarded}")
        elif c.kind is Kind.GOTO:
            self._holder.go_to(c.target, c.frame)
            self._answer(c, DONE, "")
        elif c.kind is Kind.TAKEOFF:
            self._holder.take_off(now_s, c.altitude_m)
            self._running = c
            self._ask(c, Kind.TAKEOFF, altitude_m=c.altitude_m, due_s=now_s + _QUIET_S)
        else:
            if c.kind is Kind.SET_MODE and c.mode not in MISSION_MODES and not self._rules.maintenance:
                allowed = ", ".join(sorted(MISSION_MODES))
                raise CommandRefused(f"mode '{c.mode}' is for pilots; a mission may ask for {allowed}")
            if self._forbidden and (c.mode == "GUIDED" or (c.kind is Kind.ARM and c.flag)):
                raise CommandRefused("the guardian forbids it: " + "; ".join(self._forbidden))
            self._running = c
            self._ask(c, c.kind, mode=c.mode, flag=c.flag)

    def _stop(self, c: Instruction) -> None:
        """Stopping overtakes what waits, and what waited is not done after it."""
        for waiting in [w for w in self._waiting if w.kind is not Kind.RECORD]:
            self._waiting.remove(waiting)
            self._answer(waiting, REFUSED, "overtaken by a command to stop")
        if c.kind is not Kind.HOLD:
            self._ask(c, Kind.SET_MODE, mode="LAND" if c.kind is Kind.LAND else c.mode)
            return
        try:
            self._holder.hold()
            self._answer(c, DONE, "")
        except CommandRefused as error:
            self._answer(c, REFUSED, str(error))

    def _ask(self, c: Optional[Instruction], kind: Kind, due_s: Optional[float] = None, **what) -> None:
        self._asks += 1
        ask = Ask(kind, number=self._asks, **what)
        self._asked[ask.number] = c
        if due_s is None:
            self._out.append(ask)
        else:
            self._due.append((due_s, ask))

    def _answer(self, c: Instruction, result: int, reason: str) -> None:
        self._log.answered(c.sender, c.number, Answer(result, reason))
        self._out.append(Ack(c.sender, c.number, result, reason))

    def _say(self, text: str) -> None:
        self._out.append(Said(f"{self._vehicle}: {text}"))
