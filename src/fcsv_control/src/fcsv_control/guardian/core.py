# SPDX-License-Identifier: Apache-2.0
"""The guardian's decisions: what is heard on board and over the radio in, modes and set-points out.

It warns, holds, moves aside, brakes and lands, in this order of strength, and never asks for
LOITER. It acts only while the companion flies the vehicle; in a mode that the pilot chose it only
speaks. No ROS, no thread, no clock.
"""

import math
from typing import Dict, List, Optional, Set, Tuple

import numpy as np

from fcsv_control.guardian import room
from fcsv_control.guardian.air import LinkReport, Other, VehicleSituation
from fcsv_control.guardian.findings import ABOVE, Finding, Monitors, Reaction
from fcsv_control.guardian.messages import (
    AskMode,
    GuardianVerdict,
    HoldAt,
    Output,
    RestartLink,
    Warned,
)
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.streams.flow import RateGate
from fcsv_geometry.vehicles.modes import GUARDIAN, Mode, ModeOwner

_SET_POINT_HZ = 10.0
_AGAIN_S = 0.5  # a mode is asked for again
_THERE_M = 0.4
_STALL_S = 0.25  # a step that comes later than this was delayed itself
_CALM_S = 3.0  # what asked for a hold must be over for so long
_SAY_AGAIN_S = 10.0


class Guardian:
    """One vehicle's. Hear, ``step`` at 20 Hz or more, and do what ``outgoing`` says."""

    def __init__(self, vehicle: str, rules: Optional[GuardianRules] = None, now_s: float = 0.0):
        self._vehicle, self._rules = vehicle, rules or GuardianRules()
        self._watches, self.air = Monitors(self._rules), VehicleSituation()
        self._owner = ModeOwner(GUARDIAN)
        # silence counts from now on
        self.air.control_s = self.air.agent_s = self.air.link_s = self.air.feed.at_s = now_s
        self._gate = RateGate(_SET_POINT_HZ)
        self._place: Optional[np.ndarray] = None  # T_odom_body that is held
        self._aside_s: Optional[float] = None  # when the way aside began
        # when something last asked for a hold, and the last step
        self._held_s = self._stepped_s = now_s
        self._link_heard = self._link_restarted = False
        self._landing = self._homeward = False
        self._braking_for = ""
        # findings for which it braked: a fence counts once per crossing
        self._answered: Set[str] = set()
        self._asked: Tuple[Mode, float, float] = (
            Mode.UNHEARD,
            now_s,
            now_s,
        )  # mode, first and last asked
        self._said: Dict[str, Tuple[str, float]] = {}  # text and time, by what it is about
        self._verdict = GuardianVerdict()
        self._out: List[Output] = []

    # ---- what is heard ---------------------------------------------------------------------------

    @property
    def _ours(self) -> bool:
        """Whether it may command the vehicle now."""
        return self._owner.mode.companions and not self._owner.taken

    def state(self, now_s: float, mode: Mode, armed: bool) -> None:
        """The flight controller's mode."""
        was_ours = self._ours
        if self._owner.shows(mode, armed, now_s):
            self._let_go()
            # a pilot who goes from one mode of his to another is no news
            if was_ours or mode.companions:
                text = f"{mode} was not asked for by the companion: it stays with who chose it"
                self._warn(now_s, f"mode {mode}", text, False)
        if not armed:
            self._landing = False
            self._answered.clear()
            self._watches.disarmed()
        elif not self.air.armed:
            self.air.lost = False
        self.air.mode, self.air.armed, self.air.state_s = mode, armed, now_s

    def pose(self, now_s: float, T_odom_body: np.ndarray) -> None:
        """A pose of the odometry, as it goes to the autopilot."""
        self.air.fed(now_s, T_odom_body)

    def estimate(self, now_s: float, T_odom_body: np.ndarray) -> None:
        """The autopilot's estimate."""
        self.air.estimated(now_s, T_odom_body)
        # started in flight, it never saw the ground
        if not self.air.armed and math.isfinite(self.air.state_s):
            self.air.take_off, self.air.take_off_epoch = T_odom_body, self.air.epoch

    def epoch(self, number: int) -> None:
        """Takes the epoch of the odometry's frame: in flight, a new one says that the take-off
        place is not where it was."""
        self.air.began_anew(number)

    def calibrated(self, epoch: int) -> None:
        """A calibration was made with this epoch of the odometry."""
        self.air.calibrated = epoch

    def slows(self, mps2: float) -> None:
        """Takes by how much its autopilot slows down as it stops; what is no such number is not
        known and changes nothing."""
        self.air.slows_mps2 = mps2 if 0.0 < mps2 < math.inf else self.air.slows_mps2

    def link(self, now_s: float, report: LinkReport) -> None:
        """The flight link lives."""
        self._link_heard = True
        self.air.link, self.air.link_s = report, now_s

    def battery(self, now_s: float, share: float) -> None:
        """0..1, NaN where not known."""
        self.air.battery.tell(now_s, share)

    def confidence(self, level: float) -> None:
        """Takes the confidence of the tracking camera, 0 (failed) to 3 (high); NaN where not
        known."""
        self.air.confidence = level

    def agent_lives(self, now_s: float) -> None:
        """A heartbeat of the agent."""
        self.air.agent_s = now_s

    def control_lives(self, now_s: float) -> None:
        """Something came from the control PC."""
        self.air.control_s = now_s

    def mode_asked(self, now_s: float, mode: Mode) -> None:
        """The agent asks the autopilot for a mode, on a command's behalf."""
        if mode == Mode.GUIDED:
            self._commanded(now_s)
        else:
            self._owner.asked(mode, now_s)

    def _commanded(self, now_s: float) -> None:
        """The mission moves the vehicle, or asks for GUIDED: the operator has confirmed."""
        if self._owner.mode == Mode.GUIDED:
            self._owner.give_back()
        self._owner.asked(Mode.GUIDED, now_s)

    def moved(self, now_s: float, T_odom_body: Optional[np.ndarray] = None) -> None:
        """A command moves the vehicle: to ``T_odom_body``, or holds it where it is."""
        self._commanded(now_s)
        self.air.sent_to = T_odom_body

    def home(self, T_home_odom: Optional[np.ndarray], sigma_m: float = 0.0) -> None:
        """Where this vehicle's odometry frame stands in home, None: not known; how well its place
        is known by that."""
        self.air.T_home_odom, self.air.sigma_m = T_home_odom, sigma_m

    def mission_fence(self, fence: Fence) -> None:
        """The fence of the mission that is flown; the guardian's own goes on counting."""
        self.air.mission_fence = fence

    def other(self, name: str, other: Other) -> None:
        """Another vehicle was heard."""
        self.air.others[name] = other.after(self.air.others.get(name))

    # ---- time ------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Look at everything, and act where it is needed."""
        air = self.air
        # what came meanwhile is still to be read: no silence of anybody
        if now_s - self._stepped_s > _STALL_S:
            air.slept(now_s - self._stepped_s)
        self._stepped_s = now_s
        found = self._watches.findings(now_s, air) if air.armed else []
        self._mind_link(now_s)
        forbids = tuple(self._watches.forbids(now_s, air)) if air.mode != Mode.GUIDED else ()
        acting = air.armed and self._ours
        if acting:
            self._act(now_s, found)
        else:
            self._let_go()
        for f in found:
            self._warn(now_s, f.what, f.text, acting and f.wish > Reaction.SAY)
        blind = bool(found) and air.flying and any(f.wish is Reaction.LAND for f in found)
        air.lose(now_s, blind, self._watches.found_again(now_s, air))
        reasons = tuple(f.text for f in found if f.wish > Reaction.SAY)
        action, taken = self._action(now_s) if acting else "", air.armed and not self._ours
        held, to_m = self._place is not None, air.going_to_m(self._place)
        self._verdict = GuardianVerdict(
            action, held, blind, reasons, forbids, air.lost, taken, to_m, air.lost_s
        )

    @property
    def verdict(self) -> GuardianVerdict:
        """Gives the verdict as of the last step: what the agent, the mission, the others and the
        operator are told."""
        return self._verdict

    def outgoing(self) -> List[Output]:
        """What to do now, each given once."""
        out, self._out = self._out, []
        return out

    # ---- what is done ----------------------------------------------------------------------------

    def _act(self, now_s: float, found: List[Finding]) -> None:
        self._answered &= {f.what for f in found}
        wishes = [f for f in found if f.wish > Reaction.SAY and f.what not in self._answered]
        worst = max(wishes, key=lambda f: f.wish, default=None)
        # it stops where it is
        if self._homeward and (worst is None or worst.wish is not Reaction.HOME):
            self._homeward, self._place = False, None
            self._hold(now_s)
        escape = next(
            (f for f in wishes if f.wish is Reaction.ESCAPE or (self._landing and f.what == ABOVE)),
            None,
        )
        if (
            self._landing
            or escape
            or (worst is not None and worst.wish in (Reaction.LAND, Reaction.LAND_ASIDE))
        ):
            self._land(now_s, worst, escape)
        elif self.air.mode == Mode.BRAKE and worst is not None and worst.wish is Reaction.ASIDE:
            self._move_aside(now_s, worst.away_from)
        elif self.air.mode != Mode.GUIDED:
            self._place = None  # BRAKE stops it by itself
            self._answered.add(self._braking_for)
        elif worst is None or not self.air.flying:  # a set-point would replace the take-off
            self._release(now_s)
        elif worst.wish is Reaction.BRAKE:
            self._brake(now_s, worst)
        elif worst.wish is Reaction.ASIDE:
            self._move_aside(now_s, worst.away_from)
        elif worst.wish is Reaction.HOME:
            self._fly_home(now_s)
        else:
            self._hold(now_s)
        if self._place is not None and self.air.mode == Mode.GUIDED and self._gate.passes(now_s):
            self._out.append(HoldAt(self._place))

    def _mind_link(self, now_s: float) -> None:
        """A link that was heard and is silent hangs, whoever flies: once until it is heard
        again."""
        silent_s = now_s - self.air.link_s
        if silent_s < self._rules.link_silent_s:
            self._link_restarted = False
        elif self.air.armed and self._link_heard and not self._link_restarted:
            self._link_restarted = True
            self._out.append(RestartLink())

    def _land(self, now_s: float, worst: Optional[Finding], escape: Optional[Finding]) -> None:
        """LAND, first out of the way of who is beneath, or comes down without control: then out of
        LAND, too."""
        blind = worst is not None and worst.wish is Reaction.LAND
        away_from = escape.away_from if escape is not None and not blind else None
        if self.air.mode == Mode.LAND and away_from is None:
            self._landing, self._place = False, None
            return
        self._landing = True
        if away_from is None and not blind and self.air.mode in (Mode.GUIDED, Mode.BRAKE):
            away_from = self._watches.beneath(now_s, self.air)
        if away_from is not None and self._way_aside(now_s, away_from):
            return
        self._place = None
        self._ask(now_s, Mode.LAND)

    def _way_aside(self, now_s: float, away_from: str) -> bool:
        """Whether it is still on its way."""
        on_its_way = self._aside_s is None or now_s - self._aside_s < self._rules.aside_s
        if on_its_way:
            self._move_aside(now_s, away_from)
        return on_its_way

    def _move_aside(self, now_s: float, away_from: str) -> None:
        """Only with both places known, as every finding about another vehicle has them."""
        air = self.air
        # where /stop_all stopped it, or on its way down: so it cannot move
        if air.mode != Mode.GUIDED:
            self._ask(now_s, Mode.GUIDED)
        self._held_s = now_s
        under_way = self._aside_s is not None and self._place is not None
        if under_way and float(np.linalg.norm((air.estimate - self._place)[:2, 3])) > _THERE_M:
            return
        p_home = room.aside(now_s, air, self._rules, away_from, self._landing)
        self._place = transforms.level(air.estimate)
        self._place[:3, 3] = transforms.apply(transforms.invert(air.T_home_odom), p_home)
        self._aside_s = self._aside_s or now_s

    def _hold(self, now_s: float) -> None:
        self._held_s = now_s
        if self._place is None and self.air.estimate is not None:
            self._place = self.air.way.rest(self.air.estimate)

    def _fly_home(self, now_s: float) -> None:
        """Flies to above the take-off place, at the height that it has."""
        if not self._homeward:
            self._place, self._aside_s = transforms.level(self.air.estimate), None
            self._place[:2, 3] = self.air.take_off[:2, 3]
        self._homeward, self._held_s = True, now_s

    def _brake(self, now_s: float, finding: Finding) -> None:
        """BRAKE, once per finding; LAND where it does not show."""
        if now_s - self._ask(now_s, Mode.BRAKE) > self._rules.obey_s:
            self._landing = True
        self._braking_for = finding.what

    def _release(self, now_s: float) -> None:
        if self._place is not None and now_s - self._held_s > _CALM_S:
            self._let_go()

    def _let_go(self) -> None:
        self._place, self._aside_s, self._landing, self._homeward = None, None, False, False

    def _ask(self, now_s: float, mode: Mode) -> float:
        """Ask for a mode, now and again until it shows; when it was asked for first."""
        asked, first_s, last_s = self._asked
        if asked != mode or now_s - last_s > 3.0:
            first_s, last_s = now_s, float("-inf")
        if now_s - last_s >= _AGAIN_S:
            self._owner.asked(mode, now_s)
            self._out.append(AskMode(mode))
            last_s = now_s
        self._asked = (mode, first_s, last_s)
        return first_s

    def _action(self, now_s: float) -> str:
        asked, _, last_s = self._asked
        if asked and now_s - last_s < 1.0 and asked != Mode.GUIDED:  # that is for the way aside
            return asked
        if self._place is None:
            return ""
        return "home" if self._homeward else "hold" if self._aside_s is None else "aside"

    def _warn(self, now_s: float, what: str, text: str, acts: bool) -> None:
        """Once while it lasts, again where it is another text, or after some time without it."""
        before, before_s = self._said.get(what, ("", float("-inf")))
        if text != before or now_s - before_s > _SAY_AGAIN_S:
            self._out.append(Warned(f"{self._vehicle}: {text}", acts))
        self._said[what] = (text, now_s)
