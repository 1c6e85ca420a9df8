# SPDX-License-Identifier: Apache-2.0
"""The agent's decisions: commands, states and time in; requests to the flight link, answers and
set-points out.

No ROS, no thread, no clock. ``now_s`` is monotonic time; no wall clock is ever asked.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Deque, Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.agent.commands import Answer, CommandLog, CommandVerdict
from fcsv_control.agent.duplicate_agents import DuplicateAgentGuard
from fcsv_control.agent.holder import Holder, Limits
from fcsv_control.agent.messages import (
    BY_HAND,
    DONE,
    REFUSED,
    TOO_LATE,
    Ack,
    AgentText,
    Ask,
    Instruction,
    Kind,
    Output,
    Pictures,
    SetPoint,
)
from fcsv_control.agent.rights import Rights
from fcsv_control.agent.sender_clocks import SenderClocks
from fcsv_control.errors import CommandRefused
from fcsv_geometry import frames
from fcsv_geometry.frozen import changed
from fcsv_geometry.streams.flow import RateGate
from fcsv_geometry.vehicles.modes import Mode

_QUIET_S = 0.15  # set-points on their way arrive before the take-off that they would replace


@dataclass(frozen=True)
class AgentRules:
    """``maintenance`` permits any mode. ``guardian``: without a living one nothing is handed over
    to the mission."""

    set_point_rate_hz: float = 10.0
    maintenance: bool = False
    guardian: bool = True
    limits: Limits = field(default_factory=Limits)


class AgentCore:
    """One vehicle's agent. A job that needs the flight link waits for the one before it; stopping
    waits for nothing."""

    def __init__(self, vehicle: str, rules: AgentRules, duplicates: DuplicateAgentGuard):
        self._vehicle, self._rules = vehicle, rules
        self.duplicates = duplicates
        self.rights = Rights(vehicle, rules.guardian)
        self._log = CommandLog(vehicle)
        self._clocks = SenderClocks()
        self._holder = Holder(frames.odom(vehicle), rules.limits)
        self._gate = RateGate(rules.set_point_rate_hz)
        self._waiting: Deque[Instruction] = deque()
        self._running: Optional[Instruction] = None
        # by the ask's number; None: the agent's own
        self._asked: Dict[int, Optional[Instruction]] = {}
        self._due: List[Tuple[float, Ask]] = []  # asks that wait for a moment
        self._asks = 0
        self._out: List[Output] = []

    # ---- what is heard ---------------------------------------------------------------------------

    def state(self, now_s: float, mode: Mode, armed: bool) -> None:
        """The flight controller's mode; "": its link hears no autopilot (yet), which says
        nothing."""
        if mode:
            self._holder.state(mode, armed)
            self.rights.shows(now_s, mode, armed)

    def pose(self, now_s: float, T_odom_body: np.ndarray) -> None:
        """The autopilot's estimate came; a jump of it is said."""
        moved_m = self._holder.pose(now_s, T_odom_body)
        if moved_m:
            self._warn(
                f"the autopilot's estimate jumped by {moved_m:.1f} m; the target moves along"
            )

    def estimate_moved(self, now_s: float, step_m: Sequence[float]) -> None:
        """The autopilot adopted a jump of its navigation, over several messages: the target moves
        along."""
        if self._holder.moved(now_s, step_m):
            self._warn(
                f"the autopilot's estimate moved by {math.hypot(*step_m):.1f} m; the target moves along"
            )

    def epoch(self, epoch: int, reason: str) -> None:
        """The odometry's epoch. Where its frame began anew the target is not where it was meant to
        be: hold here."""
        if self.rights.frame.odometry(epoch, reason) and self._holder.mode == Mode.GUIDED:
            self._warn(f"the odometry began anew ({reason}); holding")
            self._hold_here()

    def guarded(
        self, now_s: float, action: str, holds: bool, why: str, forbids: Sequence[str]
    ) -> None:
        """The guardian's verdict: while it ``holds`` the vehicle the agent is quiet, and thereafter
        holds where it is; an ``action`` may be a mode that it asks for; ``forbids`` tells why the
        vehicle is not to be handed over."""
        self.rights.guardian_s, self.rights.aside = now_s, action == "aside"
        if Mode(action).stops:
            self.rights.owner.asked(Mode(action))
        if self.rights.guarded and not holds:
            self._holder.stay()
        self.rights.guarded, self.rights.forbidden = (why or "it holds") if holds else "", forbids

    def sender_lives(self, now_s: float, sender: str, sent_s: float) -> None:
        """A sign of life of ``sender`` came, who sent it at ``sent_s`` by his monotonic clock."""
        self.rights.lease.sender_lives(now_s, sender)
        self._clocks.sent_here_s(now_s, sender, sent_s)

    def receive(self, now_s: float, c: Instruction) -> None:
        """A command came, perhaps again."""
        sent_s = self._clocks.sent_here_s(now_s, c.sender, c.sent_s)
        c = changed(c, sent_s=sent_s, ordered_s=sent_s - max(0.0, c.sent_s - c.ordered_s))
        if self._mute(now_s, c):
            return
        moves = c.kind is not Kind.RECORD
        expires_s = c.ordered_s + c.lifetime_s
        verdict, answer = self._log.decide(
            now_s, c.vehicle, c.sender, c.number, moves, expires_s, c.stops
        )
        if verdict is CommandVerdict.IGNORE:
            return
        refusal = self.rights.refusal(now_s, c)  # a repetition keeps the lease, too
        if verdict is CommandVerdict.EXPIRED:
            self._answer(c, TOO_LATE, "came too late, or after a newer one")
        elif verdict is CommandVerdict.REPEAT:
            self._out.append(Ack(c.sender, c.number, answer.result, answer.reason))
        elif verdict is CommandVerdict.EXECUTE and refusal:
            by_hand = c.stops and self.rights.by_hand
            self._answer(c, BY_HAND if by_hand else REFUSED, refusal)
        elif verdict is CommandVerdict.EXECUTE and c.stops:
            self._stop(now_s, c)
        elif verdict is CommandVerdict.EXECUTE:
            self._waiting.append(c)

    def _mute(self, now_s: float, c: Instruction) -> bool:
        """An older agent of this vehicle answers, or may be there: this one neither acts nor
        answers."""
        return bool(self.duplicates.older(now_s)) or (
            self.duplicates.listening(now_s) and not c.stops
        )

    def finished(self, ask: Ask, refusal: str) -> None:
        """The flight link has done it ("") or refused."""
        c = self._asked.pop(ask.number, None)
        if refusal and ask.kind is Kind.SET_MODE:
            self.rights.owner.refused(ask.mode)
        if ask.kind is Kind.TAKEOFF and refusal:
            self._holder.take_off_refused()
        if c is None:
            return
        self._answer(c, REFUSED if refusal else DONE, refusal)
        if c is self._running:
            self._running = None

    # ---- time ------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Time passes: the next job, the target at its rate."""
        if self.duplicates.older(now_s):
            self._out.clear()
            return
        while self._running is None and self._waiting:
            self._begin(now_s, self._waiting.popleft())
        if self._due:
            self._out += [ask for due_s, ask in self._due if now_s >= due_s]
            self._due = [(due_s, ask) for due_s, ask in self._due if now_s < due_s]
        target = self._holder.target
        quiet = self.rights.guarded or self.duplicates.listening(now_s)
        if target is not None and not quiet and self._gate.passes(now_s):
            self._out.append(SetPoint(target))

    def outgoing(self) -> List[Output]:
        """What to do and to send now, each given once."""
        out, self._out = self._out, []
        return out

    # ---- what is done ----------------------------------------------------------------------------

    def _begin(self, now_s: float, c: Instruction) -> None:
        if now_s > c.ordered_s + c.lifetime_s:
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
        elif c.kind is Kind.GOTO:
            self._holder.go_to(c.target, c.frame)
            self._answer(c, DONE, "")
        elif c.kind is Kind.TAKEOFF:
            self._holder.take_off(now_s, c.altitude_m)
            self._running = c
            self._ask(c, Kind.TAKEOFF, altitude_m=c.altitude_m, due_s=now_s + _QUIET_S)
        else:
            allowed = c.mode.companions or self._rules.maintenance
            if c.kind is Kind.SET_MODE and not allowed:
                allowed = ", ".join(sorted(m for m in Mode if m.companions))
                raise CommandRefused(
                    f"mode '{c.mode}' is for pilots; a mission may ask for {allowed}"
                )
            self._running = c
            self._ask(c, c.kind, mode=c.mode, flag=c.flag)

    def _stop(self, now_s: float, c: Instruction) -> None:
        """Stopping overtakes what waits, and what waited is not done after it."""
        for waiting in [w for w in self._waiting if w.kind is not Kind.RECORD]:
            self._waiting.remove(waiting)
            self._answer(waiting, REFUSED, "overtaken by a command to stop")
        self.rights.stopped(now_s, c.sender)
        if c.kind is not Kind.HOLD:
            mode = Mode.LAND if c.kind is Kind.LAND else c.mode
            if mode == Mode.BRAKE:
                self._hold_here()  # until the mode shows
            self._ask(c, Kind.SET_MODE, mode=mode)
            return
        refusal = self._hold_here()
        self._answer(c, REFUSED if refusal else DONE, refusal)

    def _hold_here(self) -> str:
        """Hold, and say so to the autopilot at once; "" or why not."""
        try:
            self._holder.hold()
        except CommandRefused as error:
            return str(error)
        if not self.rights.guarded:
            self._out.append(SetPoint(self._holder.target))
        return ""

    def _ask(
        self, c: Optional[Instruction], kind: Kind, due_s: Optional[float] = None, **what
    ) -> None:
        self._asks += 1
        ask = Ask(kind, number=self._asks, **what)
        self._asked[ask.number] = c
        if kind is Kind.SET_MODE:
            self.rights.owner.asked(ask.mode)
        if due_s is None:
            self._out.append(ask)
        else:
            self._due.append((due_s, ask))

    def _answer(self, c: Instruction, result: int, reason: str) -> None:
        self._log.answered(c.sender, c.number, Answer(result, reason))
        self._out.append(Ack(c.sender, c.number, result, reason))

    def _warn(self, text: str) -> None:
        self._out.append(AgentText(f"{self._vehicle}: {text}"))
