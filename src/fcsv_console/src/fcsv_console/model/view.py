# SPDX-License-Identifier: Apache-2.0
"""Everything that is shown at one moment: immutable, so that a layer may keep it, compare it and draw it later."""

from dataclasses import dataclass
from typing import Dict, Optional, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model.actions import Action
from fcsv_console.model.after import Places, Step
from fcsv_console.model.air import Above
from fcsv_console.model.events import Event
from fcsv_console.model.goals import Goal
from fcsv_console.model.ground_views import GroundView
from fcsv_console.model.hearing import Aged
from fcsv_console.model.mission_file import MissionFile
from fcsv_console.model.pictures import CameraPicture, MapPictures
from fcsv_console.model.poses import Relative, relative
from fcsv_console.model.rehearsal import Rehearsal
from fcsv_console.model.stage import Stage
from fcsv_console.model.stereo import StereoHealth
from fcsv_console.model.vehicles import VehicleRow
from fcsv_control.flight_check.lines import Line, State, worst
from fcsv_geometry.missions.phases import OVER


@dataclass(frozen=True)
class View:
    """``running``: index of the running configuration, None where none is; ``progress``: 0..1 of the list,
    ``stage``: how far the running one is; ``recorded``: a recording is played, nobody flies."""

    now_s: float
    vehicles: Tuple[VehicleRow, ...]
    mission: Aged[f.MissionTold]
    mission_alive: bool
    file: MissionFile
    running: Optional[int]
    progress: float
    check: Optional[Tuple[Line, ...]]
    actions: Dict[str, Action]
    events: Tuple[Event, ...]
    stereo: StereoHealth
    above: Tuple[Above, ...]
    control_recorder: Aged[f.Recorder]
    map: Aged[f.MapTold]
    stop: Aged[f.StopTold]
    home_set: bool
    rehearsal: Rehearsal
    cameras: Tuple[CameraPicture, ...]
    map_pictures: MapPictures
    after: Tuple[Step, ...]
    places: Places
    goals: Tuple[Goal, ...]
    problems: Tuple[str, ...]
    master_problem: str = ""
    stage: Stage = Stage()
    ground_views: Tuple[GroundView, ...] = ()
    recorded: bool = False

    @property
    def check_state(self) -> State:
        """The worst line; unknown where none is heard. Amber that was accepted counts as green."""
        if not self.check:
            return State.UNKNOWN
        return worst([li for li in self.check if not li.passes] or [Line("", "", State.GREEN, "")])

    def against_others(self, name: str) -> Tuple[Relative, ...]:
        """Of one vehicle, as both places are now; of those that are not known only the name."""
        places = {v.name: v.place for v in self.vehicles}
        own = places[name]
        return tuple(
            relative(own.value, place.value) if not own.stale and not place.stale else Relative(other)
            for other, place in places.items() if other != name
        )  # fmt: skip

    @property
    def headline(self) -> str:
        """One line: what the mission does and waits for."""
        return f"RECORDING: {self._does}" if self.recorded else self._does

    @property
    def _does(self) -> str:
        m = self.mission.value
        if m is None:
            return "no mission is heard"
        if not self.mission_alive and m.phase in OVER:
            return f"{m.phase}: {m.detail}".rstrip(": ") + ". The flight is over; After [F5] maps what was recorded"
        if not self.mission_alive:
            return f"THE MISSION IS NOT HEARD (was in {m.phase})"
        if m.waits_for == "resume":
            resume = self.actions["hand_over"]
            ends = "Resume goes on" if resume.enabled else f"Resume is locked: {resume.why_not}"
            return f"PAUSED: {'; '.join(m.problems[:1]) or m.detail}".rstrip(": ") + f". {ends}"
        if m.phase == "CONFIGURATIONS" and m.problems:
            return f"PAUSED: {m.problems[0]}"
        waits = f", waits for {m.waits_for.replace('_', ' ').upper()}" if m.waits_for else ""
        stage = f", {self.stage.words}" if self.stage.words else ""
        return f"{m.phase}{waits}: {m.detail}".rstrip(": ") + stage
