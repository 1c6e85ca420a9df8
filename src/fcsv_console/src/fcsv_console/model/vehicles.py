# SPDX-License-Identifier: Apache-2.0
"""One vehicle as the operator sees it: who flies it, in words, and every value with its age."""

import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional, Tuple, Type

from fcsv_console.model import facts as f
from fcsv_console.model.hearing import Aged, AgingFact, slow
from fcsv_control.agent.lease import is_mission
from fcsv_control.guardian.air import AUTOPILOT_FAILSAFE
from fcsv_control.guardian.messages import in_words
from fcsv_geometry.streams.silence import Silence
from fcsv_geometry.vehicles import thresholds as at
from fcsv_geometry.vehicles.modes import Mode

_FAILSAFE_MODES = (Mode.RTL, Mode.SMART_RTL, Mode.AUTO, Mode.FLIP)
PILOT, MISSION, GUARDIAN, FAILSAFE, NOBODY, UNKNOWN = (
    "pilot",
    "mission",
    "guardian",
    "failsafe",
    "nobody",
    "unknown",
)


@dataclass(frozen=True)
class Flier:
    """``who``: one of the words above; ``words``: with the reason, for a person."""

    who: str
    words: str


@dataclass(frozen=True)
class VehicleRow:
    """A vehicle at one moment; times in s. ``heard``: anything of it at all; its state comes 2.5
    times a second, other streams five to thirty times. ``endurance_s``: until its battery is at the
    mission's lowest share. ``no_picture_s``: how long its recorder has waited for a picture, 0
    where one came in the last seconds. ``not_in_bags``: topics that a playback does not have.
    ``height_m``: above where it stood with its motors off, None: that was not seen."""

    name: str
    flier: Flier
    heard: Aged[str]
    state: Aged[f.AutopilotReport]
    pose: Aged[f.OdometryReport]
    place: Aged[f.CameraPoseReport]
    picture: Aged[f.PreviewReport]
    battery: Aged[f.BatteryReport]
    guardian: Aged[f.GuardianReport]
    agent: Aged[f.Agent]
    recorder: Aged[f.Recorder]
    clock: Aged[f.ClockReport]
    radio: Aged[f.RadioReport]
    said: Aged[f.VehicleText]
    diagnosed: Aged[f.Diagnosed]
    epoch: Optional[int]
    calibrated_epoch: Optional[int]
    calibration_age_s: float
    endurance_s: float
    needed_s: float
    no_picture_s: float
    not_in_bags: Tuple[str, ...] = ()
    height_m: Optional[float] = None

    @property
    def connection(self) -> str:
        """Says it in words."""
        if not math.isfinite(self.heard.age_s):
            return "never heard"
        if self.heard.stale:
            return f"NOT HEARD for {self.heard.words}"
        if self.state.value is None:
            return "no state yet"
        if self.state.stale:
            return f"no state for {self.state.words}"
        return "connected" if self.state.value.connected else "no autopilot"

    @property
    def armed(self) -> bool:
        """Says whether it is armed, as heard last; a vehicle that fell silent counts as it was."""
        return self.state.value is not None and self.state.value.armed

    @property
    def mode(self) -> str:
        return self.state.value.mode if self.state.value is not None else "-"

    @property
    def outdated(self) -> bool:
        """Whether its odometry began anew since the calibration."""
        return (
            None not in (self.epoch, self.calibrated_epoch) and self.epoch != self.calibrated_epoch
        )

    @property
    def calibration(self) -> str:
        """Whether the calibration holds for the odometry of now, in words."""
        if self.calibrated_epoch is None:
            return "not calibrated"
        if self.outdated:
            return "OUTDATED: its odometry began anew"
        return f"{self.calibration_age_s / 60.0:.0f} min old"

    @property
    def battery_enough(self) -> Optional[bool]:
        """Whether it lasts for the rest of the mission; None: not known."""
        if math.isnan(self.endurance_s) or math.isnan(self.needed_s):
            return None
        return self.endurance_s >= self.needed_s


def who_flies(  # noqa: C901
    heard: Aged, state: Aged, guardian: Aged, agent: Aged, stop_asked: str = "", mission: str = ""
) -> Flier:
    """Who has the vehicle now, highest first as in docs/user/safety.md: pilot, failsafe, guardian,
    mission. ``mission``: as whom it commands; empty: not heard yet, or a bag, which has no sign of
    life of it."""
    if state.value is None:
        return Flier(UNKNOWN, "not heard yet")
    s: f.AutopilotReport = state.value
    if heard.stale:
        return Flier(UNKNOWN, f"not heard for {heard.words} (was {s.mode})")
    if state.stale:
        return Flier(UNKNOWN, f"no state for {state.words} (was {s.mode})")
    g: f.GuardianReport = (
        guardian.value
        if guardian.value is not None and not guardian.stale
        else f.GuardianReport("")
    )
    if g.uncontrolled:
        return Flier(FAILSAFE, "COMES DOWN WITHOUT A POSITION: keep away")
    if not s.armed:
        return Flier(NOBODY, "on the ground, motors off")
    if s.system_status in AUTOPILOT_FAILSAFE:
        return Flier(FAILSAFE, f"the autopilot's failsafe, {s.mode}")
    if g.holds or g.action:
        return Flier(GUARDIAN, f"guardian: {in_words(g.action or 'hold', g.reasons)}")
    if s.mode in _FAILSAFE_MODES:
        return Flier(FAILSAFE, f"{s.mode}: by the autopilot or the pilot")
    if g.taken or not s.mode.companions:
        return Flier(PILOT, f"pilot, {s.mode}")
    if s.mode.stops:
        why = f" after {stop_asked}-all" if stop_asked else ""
        return Flier(
            MISSION if s.mode == Mode.LAND and not stop_asked else NOBODY, f"{s.mode}{why}"
        )
    if agent.value is None:
        return Flier(UNKNOWN, "GUIDED, its agent is not heard yet")
    if agent.stale:
        return Flier(UNKNOWN, f"GUIDED, its agent is not heard for {agent.words}")
    a: f.Agent = agent.value
    if not a.sender:
        return Flier(NOBODY, "GUIDED, holds: nobody commands it")
    ours = a.sender == mission if mission else is_mission(a.sender)
    return Flier(MISSION, "mission" if ours else f"commanded by {a.sender}")


_NO_PICTURE_S = 2.5  # its recorder tells once a second how many it has
#: what crosses the radio as state, by the topic whose age counts
_CROSSES = {
    f.AutopilotReport: "mavros/state",
    f.OdometryReport: "odometry/state",
    f.BatteryReport: "mavros/battery",
    f.GuardianReport: "guardian/state",
    f.Agent: "agent/alive",
    f.Recorder: "recorder/status",
}


class VehicleRecord:
    """Collects what is heard of one vehicle. ``since_s`` gives from when the newest message of a
    topic counts that came at some time: Arrivals.since_s, where a relay is between."""

    def __init__(
        self, name: str, since_s: Callable[[str, float], float] = lambda _topic, came_s: came_s
    ):
        self.name, self._since_s = name, since_s
        self.epoch: Optional[int] = None
        # height in its odometry where it stood with its motors off
        self._ground_m: Optional[float] = None
        self._not_in_bags: Tuple[str, ...] = ()
        self._any: AgingFact[str] = AgingFact()
        self._no_picture, self._pictures = Silence(_NO_PICTURE_S), 0
        self.heard: Dict[Type, AgingFact] = {
            f.AutopilotReport: slow(),
            f.OdometryReport: AgingFact(),
            f.CameraPoseReport: AgingFact(),
            f.GuardianReport: AgingFact(),
            f.Agent: AgingFact(),
            f.BatteryReport: slow(),
            f.PreviewReport: slow(),
            f.Recorder: slow(),
            f.ClockReport: AgingFact(at.CLOCK_AGE_S.console.red),
            f.RadioReport: slow(),
            f.VehicleText: AgingFact(math.inf),
            f.PictureCaptured: slow(),
            f.TagReport: slow(),
            f.Diagnosed: AgingFact(at.DIAGNOSED_AGE_S.console.red),
        }

    def tell(self, now_s: float, fact: Any) -> None:
        """A fact of it that was found sound. What this machine makes of it, or says about it, is no
        sign of life."""
        if not isinstance(fact, (f.CameraPoseReport, f.RadioReport, f.ClockReport, f.NotInBags)):
            self._any.tell(now_s, self.name)
        if isinstance(fact, f.Recorder):
            self._recorded(now_s, fact)
        if isinstance(fact, f.OdometryReport):
            self._stands(now_s, fact)
        if isinstance(fact, f.EpochReport):
            self._ground_m = self._ground_m if fact.epoch == self.epoch else None
            self.epoch = fact.epoch
        elif isinstance(fact, f.NotInBags):
            self._not_in_bags = fact.topics
        elif type(fact) in self.heard:
            self.heard[type(fact)].tell(now_s, fact)

    def row(
        self,
        now_s: float,
        calibrated: Tuple[Optional[int], float],
        stop_asked: str,
        needed_s: float,
        lasts: Callable[[float], float],
        mission: str,
    ) -> VehicleRow:
        """``calibrated``: epoch and age (s) of the calibration; ``lasts``: seconds that a battery
        share lasts; ``mission``: as whom it commands."""
        at = {kind: self._at(now_s, kind) for kind in self.heard}
        battery, anything = at[f.BatteryReport], self._any.at(now_s)
        share = battery.value.share if battery.value is not None and not battery.stale else math.nan
        return VehicleRow(
            self.name,
            who_flies(
                anything,
                at[f.AutopilotReport],
                at[f.GuardianReport],
                at[f.Agent],
                stop_asked,
                mission,
            ),
            anything,
            at[f.AutopilotReport],
            at[f.OdometryReport],
            at[f.CameraPoseReport],
            at[f.PreviewReport],
            battery,
            at[f.GuardianReport],
            at[f.Agent],
            at[f.Recorder],
            at[f.ClockReport],
            at[f.RadioReport],
            at[f.VehicleText],
            at[f.Diagnosed],
            self.epoch,
            calibrated[0],
            calibrated[1],
            lasts(share),
            needed_s,
            self._no_picture.lasts_s(now_s),
            self._not_in_bags,
            self._height_m(at[f.OdometryReport]),
        )

    def _stands(self, now_s: float, fact: f.OdometryReport) -> None:
        state = self.heard[f.AutopilotReport].at(now_s)
        if state.value is not None and not state.stale and not state.value.armed:
            self._ground_m = fact.p_odom_m[2]

    def _height_m(self, pose: Aged) -> Optional[float]:
        return (
            None
            if pose.value is None or self._ground_m is None
            else pose.value.p_odom_m[2] - self._ground_m
        )

    def _recorded(self, now_s: float, told: f.Recorder) -> None:
        self._no_picture.want(now_s, told.pictures_on)
        if told.pictures != self._pictures:
            self._pictures = told.pictures
            self._no_picture.came(now_s)

    def _at(self, now_s: float, kind: Type) -> Aged:
        topic = _CROSSES.get(kind)
        if topic is None:
            return self.heard[kind].at(now_s)
        return self.heard[kind].at(
            now_s, lambda came_s: self._since_s(f"/{self.name}/{topic}", came_s)
        )
