# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a vehicle now, and what should become of it. Each watch looks at one thing."""

import math
from collections import defaultdict
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Dict, Iterator, List, Optional, Sequence

import numpy as np

from fcsv_control import conditions
from fcsv_control.conditions import Condition, Measure
from fcsv_control.guardian import room, way_home
from fcsv_control.guardian.air import Other, VehicleSituation
from fcsv_control.guardian.messages import Cause, Forbidden
from fcsv_control.guardian.rules import NEVER, GuardianRules
from fcsv_geometry.frozen import frozen
from fcsv_geometry.missions import airspace, separation
from fcsv_geometry.missions.airspace import Occupant
from fcsv_geometry.streams.stream import Since
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.thresholds import OTHER_AGE_S

ABOVE = "above"  # a finding about one who comes down
_OLD_S = OTHER_AGE_S.guardian.red  # what was heard so long ago says nothing any more
_BELOW_M = 0.5
# of clear_m: one beneath by so much ends a LAND; less than it clears, so that the two do not take turns
_LANDS_ON = 0.72
_ABOVE_FLOOR_M = 0.5
_FOUND_S = _SLOW_S = 1.0
_ESCAPES_M = 2.0  # above the take-off place


class Reaction(IntEnum):
    """What a finding asks for; the strongest wins."""

    SAY = 1
    HOLD = 2  # where it is
    HOME = 3  # to above the take-off place
    ASIDE = 4  # out of another's way, then hold
    BRAKE = 5
    # out of LAND, aside of one beneath or that comes down without control, then LAND
    ESCAPE = 6
    LAND_ASIDE = 7  # LAND, first out of the way of who is beneath
    LAND = 8  # at once: the position cannot be relied on


@frozen
class Finding:
    """``what`` names it and stays the same while it lasts; ``away_from`` is a vehicle."""

    what: str
    wish: Reaction
    text: str
    away_from: str = ""


@dataclass
class TimedBound:
    """Asks for a reaction where a measure has been worse than a bound for so long (s)."""

    measure: Measure
    bound: float
    seconds: float
    reaction: Reaction
    since: Since = field(default_factory=Since)


class Monitors:
    """All of them; each finding lasts as long as its cause. Times since which something lasts are
    kept here."""

    def __init__(self, rules: GuardianRules):
        self._rules = rules
        self._since: Dict[str, Since] = defaultdict(Since)
        self._took_off = self._homeward = False
        self._stopped = ""  # why, on the way home
        self._unseen_s = float("-inf")  # when the tracker last did not see it
        self._steps = _steps(rules)
        self._watches = (
            self._poses,
            self._doubt,
            self._ekf,
            self._confidence,
            self._tilt,
            self._battery,
            self._control,
            self._agent,
            self._link,
            self._stick,
            self._fence,
            self._others,
            self._lands_on,
        )

    def findings(self, now_s: float, air: VehicleSituation) -> List[Finding]:
        """What is wrong with an armed vehicle."""
        return [finding for watch in self._watches for finding in watch(now_s, air)]

    def disarmed(self) -> None:
        """What counts from a take-off begins anew, also where the autopilot still says that it
        flies."""
        self._took_off = False

    def forbids(self, now_s: float, air: VehicleSituation) -> Iterator[Forbidden]:
        """Why the vehicle must not be handed over to the mission now."""
        r, link = self._rules, air.link
        ekf = conditions.ekf(link.ekf_variance, r.ekf_variance)
        apart = conditions.estimate_apart(air.apart_m, r.apart_m)
        battery = conditions.battery(air.battery_now(now_s, r.battery_old_s), r.low_battery)
        stick = conditions.stick(abs(link.throttle), r.throttle_middle)
        confidence = conditions.confidence(air.confidence, r.confidence)
        if link.doubt:
            yield Forbidden(f"{link.doubt}; land by hand and begin anew")
        if not link.origin_set:
            yield Forbidden("the autopilot has no origin yet")
        if not link.parameters_ok:
            wrong = link.parameter or "one that must fit was not read"
            yield Forbidden(f"autopilot's parameters: {wrong}")
        if ekf.red:
            yield Forbidden(ekf.words)
        if not self._fed(now_s, air).green:
            yield Forbidden(self._fed(now_s, air).words, Cause.NO_POSES)
        if not air.flying and self._lasts(now_s, "apart", apart.red, 0.5):
            yield Forbidden(f"{apart.words}; restart the autopilot")
        if not battery.green:
            yield Forbidden(battery.words + ("" if battery.red else "; see BATT_MONITOR"))
        if stick.red:
            yield Forbidden(f"{stick.words}: who takes over would climb or fall", Cause.STICK)
        elif r.transmitter and not stick.green:
            yield Forbidden(f"{stick.words}: nobody could take over")
        if confidence.red:
            yield Forbidden(confidence.words)

    def found_again(self, now_s: float, air: VehicleSituation) -> bool:
        """Whether poses of a tracker that knows places, not only ways, have come for a second."""
        r = self._rules
        if not r.finds_again or not self._fed(now_s, air).green or air.link.doubt:
            self._unseen_s = now_s
        return now_s - self._unseen_s > _FOUND_S

    def beneath(self, now_s: float, air: VehicleSituation) -> Optional[str]:
        """A vehicle upon which this one would come down, flying or not, from where it is or on its
        way to a stand, or close beside which it would, from the same height."""
        if air.p_home_m is None:
            return None
        own, clearance = Occupant([air.p_home_m], air.p_home_stop_m), room.clearance(self._rules)
        for name, other in room.others(now_s, air, self._rules).items():
            down = (clearance.to_land(other), _BELOW_M, self._rules.beside_m)
            if airspace.comes_down_on(own, other, *down) or airspace.may_lie_beneath(own, other):
                return name
        return None

    # ---- the position ----------------------------------------------------------------------------

    def _fed(self, now_s: float, air: VehicleSituation) -> Condition:
        """Whether poses of the tracker come, by the earlier of its bounds."""
        return conditions.feed_age(air.feed.age_s(now_s), self._rules.feed_warn_s)

    def _poses(self, now_s: float, air: VehicleSituation) -> Sequence[Finding]:
        if not air.flying or air.feed.value is None:
            return ()
        age_s, hz = air.feed.age_s(now_s), air.feed.rate_hz(now_s)
        return self._first(now_s, "feed", age_s) or self._first(now_s, "rate", hz)

    def _doubt(self, _now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        if air.link.doubt:
            yield Finding("tracker", Reaction.LAND, air.link.doubt)

    def _ekf(self, now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        yield from self._first(now_s, "ekf", air.link.ekf_variance)
        if air.link.failsafe:
            yield Finding("failsafe", Reaction.SAY, "the autopilot has a failsafe of its own")

    def _confidence(self, now_s: float, air: VehicleSituation) -> Sequence[Finding]:
        return self._first(now_s, "confidence", air.confidence)

    def _tilt(self, now_s: float, air: VehicleSituation) -> Sequence[Finding]:
        return self._first(now_s, "tilt", math.degrees(air.tilt_rad()))

    # ---- what it lives on, and who flies it ------------------------------------------------------

    def _battery(self, now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        r, share = self._rules, air.battery_now(now_s, self._rules.battery_old_s)
        empty = conditions.battery(share, r.empty_battery)
        low = conditions.battery(share, r.low_battery)
        alone = (
            low.red and air.mode == Mode.GUIDED and air.flying and now_s - air.control_s > r.home_s
        )
        self._homeward, self._stopped = self._homeward and alone, self._stopped if alone else ""
        if self._lasts(now_s, "empty", empty.red, r.battery_s):
            yield Finding("battery", Reaction.LAND_ASIDE, empty.words)
        elif self._lasts(now_s, "low", not low.green, r.low_battery_s):
            yield Finding("battery", Reaction.LAND_ASIDE, f"{low.words} for too long")
        elif self._lasts(now_s, "low", not low.green, r.battery_s):
            yield Finding("battery", Reaction.SAY, low.words)
            if alone:
                yield self._home(now_s, air, low.words)

    def _home(self, now_s: float, air: VehicleSituation, text: str) -> Finding:
        """Its battery is low, and nobody is there who would bring it down."""
        below = self.beneath(now_s, air)
        against = self._stopped or (f"{below} is beneath" if below else "")
        against = against or way_home.against(now_s, air, self._rules, self._homeward)
        if against:
            self._stopped = against if self._homeward else ""  # for good: two would go on by turns
            wish = Reaction.HOLD if self._homeward else Reaction.SAY
            return Finding("home", wish, f"it does not fly home: {against}")
        self._homeward = True
        if way_home.left_m(air) < way_home.THERE_M:
            return Finding(
                "home", Reaction.LAND_ASIDE, f"{text}, and it is above its take-off place"
            )
        return Finding("home", Reaction.HOME, f"{text}, and nothing from the control PC")

    def _control(self, now_s: float, air: VehicleSituation) -> Sequence[Finding]:
        return self._first(now_s, "control", now_s - air.control_s)

    def _agent(self, now_s: float, air: VehicleSituation) -> Sequence[Finding]:
        return self._first(now_s, "agent", now_s - air.agent_s)

    def _link(self, now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        silent = conditions.link_age(now_s - air.link_s, self._rules.link_silent_s)
        if silent.red or not air.link.connected:
            text = silent.words or "the flight link hears no autopilot"
            yield Finding("link", Reaction.SAY, text)

    def _stick(self, now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        off = conditions.stick.worse(abs(air.link.throttle), self._rules.throttle_middle)
        if self._lasts(now_s, "stick", off and air.mode == Mode.GUIDED, 1.0):
            yield Finding(
                "stick", Reaction.SAY, "put the throttle stick in the middle before you take over"
            )

    # ---- where it is -----------------------------------------------------------------------------

    def _fence(self, _now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        place, home = air.from_take_off_m, air.p_home_m
        if place is None or not air.flying:
            self._took_off = False
            return
        fence, height_m = self._rules.fence, float(place[2])
        self._took_off = self._took_off or height_m > fence.floor_m + _ABOVE_FLOOR_M
        if not self._took_off or air.mode == Mode.LAND:
            # a take-off begins under the floor, and a landing ends there
            height_m = max(height_m, fence.floor_m)
        out_m = fence.outside_m(place if home is None else home, height_m, home is not None)
        if air.mission_fence is not None and home is not None:
            slack_m = self._rules.mission_fence_slack_m
            out_m = max(out_m, air.mission_fence.outside_m(home, height_m) - slack_m)
        if out_m > self._rules.fence_land_m:
            yield Finding("far outside", Reaction.LAND_ASIDE, "it is far outside the fence")
        elif out_m > 0.0:
            yield Finding("fence", Reaction.BRAKE, "it is outside the fence")

    def _others(self, now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        here = air.p_home_m
        if here is None or not air.flying:
            return
        own, occupants = Occupant([here]), room.others(now_s, air, self._rules)
        for name, other in air.others.items():
            age_s = now_s - other.heard_s
            if other.armed and age_s < _OLD_S:
                doubt_m = separation.doubt_m((air.sigma_m, other.sigma_m), age_s, other.speed_mps)
                if airspace.conflicts(own, occupants[name], self._rules.separation, doubt_m):
                    yield Finding("separation", Reaction.ASIDE, f"too near to {name}", name)
        for name, other in air.others.items():
            offset_m = other.p_home_m - here
            if self._comes_down(now_s, other, occupants[name], own):
                lands = other.uncontrolled and air.mode == Mode.LAND and self._high(air)
                yield Finding(
                    ABOVE, Reaction.ESCAPE if lands else Reaction.ASIDE, f"{name} comes down", name
                )
            elif self._lasts(
                now_s, f"near {name}", self._unruly(now_s, other, offset_m), self._rules.unruly_s
            ):
                why = "is in other hands" if other.taken and not other.lost else "lost its position"
                yield Finding(
                    "unruly",
                    Reaction.ASIDE,
                    f"{name}, which {why}, is {self._where(offset_m)}",
                    name,
                )

    def _lands_on(self, now_s: float, air: VehicleSituation) -> Iterator[Finding]:
        """A LAND that came where another is beneath: who ordered it did not know this place, or
        that one's (silent until then)."""
        high = air.mode == Mode.LAND and air.flying and self._high(air)
        if not high or air.lost or air.p_home_m is None:
            return
        own = Occupant([air.p_home_m], air.p_home_stop_m)
        beneath_m = _LANDS_ON * self._rules.clear_m
        for name, other in room.others(now_s, air, self._rules).items():
            if airspace.comes_down_on(own, other, beneath_m, _BELOW_M):
                yield Finding("beneath", Reaction.ESCAPE, f"{name} is beneath", name)

    @staticmethod
    def _where(offset_m: np.ndarray) -> str:
        return "above" if offset_m[2] > 0.0 else "below"

    @staticmethod
    def _high(air: VehicleSituation) -> bool:
        """Whether there is time to go aside: nearer to the ground it is sooner down than away."""
        place = air.from_take_off_m
        return place is not None and bool(place[2] > _ESCAPES_M)

    def _unruly(self, now_s: float, other: Other, offset_m: np.ndarray) -> bool:
        """Whether another vehicle is below or above that a pilot has, who may climb or descend, or
        that is lost."""
        if now_s - other.heard_s > _OLD_S or not (other.astray or (other.taken and other.armed)):
            return False
        r, away_m = self._rules, math.hypot(offset_m[0], offset_m[1])
        return abs(offset_m[2]) > _BELOW_M and away_m < (
            r.uncontrolled_clear_m if other.astray else r.clear_m
        )

    def _comes_down(self, now_s: float, other: Other, upper: Occupant, own: Occupant) -> bool:
        """Whether another vehicle may come down on this one."""
        r, silent_s = self._rules, now_s - other.heard_s
        if not other.armed or silent_s > _OLD_S:
            return False
        if other.uncontrolled:
            clear_m = r.uncontrolled_clear_m
            return airspace.comes_down_on(upper, own, clear_m, _BELOW_M, clear_m)
        if other.mode == Mode.LAND:
            return airspace.comes_down_on(upper, own, r.clear_m)
        # of two at one height neither falls on the other: a radio that is gone must not send both
        # aside
        silent = silent_s > r.silent_above_s
        return silent and airspace.comes_down_on(upper, own, r.clear_m, _BELOW_M)

    def _lasts(self, now_s: float, what: str, holds: bool, seconds: float) -> bool:
        """Whether a condition has held for some time; a name counts from the first moment it
        held."""
        return self._since[what].lasts_s(now_s, holds) >= seconds

    def _first(self, now_s: float, what: str, value: float) -> Sequence[Finding]:
        """The first step of a thing whose bound has not been kept for so long."""
        for step in self._steps[what]:
            worse = step.measure.worse(value, step.bound)
            if step.since.lasts_s(now_s, worse) >= step.seconds:
                return [Finding(what, step.reaction, step.measure.wrong.format(step.bound))]
        return ()


def _steps(r: GuardianRules) -> Dict[str, Sequence[TimedBound]]:
    """What is measured again and again, the worst first."""
    control_s = math.inf if r.link_loss == NEVER else r.link_hold_s
    return {
        "feed": (
            TimedBound(conditions.feed_age, r.feed_land_s, 0.0, Reaction.LAND),
            TimedBound(conditions.feed_age, r.feed_warn_s, 0.0, Reaction.SAY),
        ),
        "rate": (
            TimedBound(conditions.feed_rate, r.feed_land_hz, _SLOW_S, Reaction.LAND),
            TimedBound(conditions.feed_rate, r.feed_warn_hz, _SLOW_S, Reaction.SAY),
        ),
        "ekf": (TimedBound(conditions.ekf, r.ekf_variance, r.ekf_s, Reaction.LAND),),
        "confidence": (
            TimedBound(
                conditions.low_confidence, r.confidence, r.confidence_land_s, Reaction.LAND_ASIDE
            ),
            TimedBound(conditions.low_confidence, r.confidence, r.confidence_hold_s, Reaction.HOLD),
        ),
        "tilt": (
            TimedBound(conditions.tilt, r.tilt_land_deg, r.tilt_s, Reaction.LAND),
            TimedBound(conditions.tilt, r.tilt_warn_deg, r.tilt_s, Reaction.SAY),
        ),
        "control": (
            TimedBound(conditions.control_age, control_s, 0.0, Reaction.LAND_ASIDE),
            TimedBound(conditions.control_age, r.link_warn_s, 0.0, Reaction.SAY),
        ),
        "agent": (
            TimedBound(conditions.agent_age, r.agent_land_s, 0.0, Reaction.LAND_ASIDE),
            TimedBound(conditions.agent_age, r.agent_silent_s, 0.0, Reaction.HOLD),
        ),
    }
