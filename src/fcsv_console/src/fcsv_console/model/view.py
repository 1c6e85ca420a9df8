# SPDX-License-Identifier: Apache-2.0
"""Everything that is shown at one moment: immutable, so that a layer may keep it, compare it and
draw it later."""

from dataclasses import dataclass
from typing import Dict, FrozenSet, Optional, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model.actions import Action
from fcsv_console.model.after import Places, Step
from fcsv_console.model.air import Above
from fcsv_console.model.events import Event
from fcsv_console.model.goals import BaselineGoal
from fcsv_console.model.ground_views import GroundView
from fcsv_console.model.guide import Guide
from fcsv_console.model.guided_robot import GuidedRobot
from fcsv_console.model.hearing import Aged
from fcsv_console.model.mission_file import USUAL, MissionFile, Optics
from fcsv_console.model.pictures import CameraPicture, MapPictures
from fcsv_console.model.poses import Relative, relative
from fcsv_console.model.rehearsal import Rehearsal
from fcsv_console.model.stage import Stage
from fcsv_console.model.stereo import StereoHealth
from fcsv_console.model.vehicles import VehicleRow
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line, worst
from fcsv_geometry.missions.phases import OVER


@dataclass(frozen=True)
class ConsoleView:
    """``running``: index of the running configuration, None where none is; ``progress``: 0..1 of
    the list, ``stage``: how far the running one is; ``recorded``: a recording is played, nobody
    flies; ``starting``: what was not heard yet may still come, ``waiting``: lines of the flight
    check that are so at every start; ``ended``: the mission is over and its machines are silent;
    ``optics``: whose camera ranges and errors are computed with."""

    now_s: float
    vehicles: Tuple[VehicleRow, ...]
    mission: Aged[f.MissionReport]
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
    map: Aged[f.MapReport]
    stop: Aged[f.StopReport]
    home_set: bool
    rehearsal: Rehearsal
    cameras: Tuple[CameraPicture, ...]
    map_pictures: MapPictures
    after: Tuple[Step, ...]
    places: Places
    goals: Tuple[BaselineGoal, ...]
    problems: Tuple[str, ...]
    master_problem: str = ""
    stage: Stage = Stage()
    ground_views: Tuple[GroundView, ...] = ()
    guided_robot: GuidedRobot = GuidedRobot()
    recorded: bool = False
    optics: Optics = USUAL
    calibration: Optional[f.CalibrationReport] = None
    starting: bool = False
    waiting: FrozenSet[Tuple[str, str]] = frozenset()
    ended: bool = False
    guide: Guide = Guide("")

    @property
    def over(self) -> bool:
        """Whether the mission told that it ended."""
        return self.mission.value is not None and self.mission.value.phase in OVER

    @property
    def starts(self) -> bool:
        """Whether nobody flies yet and all that is wrong is so at every start."""
        if self.mission.value is not None and self.mission.value.phase != "WAIT_VEHICLES":
            return False
        if self.check is None:
            return self.starting
        return bool(self.waiting) and all(
            li.passes or li.state is Grade.AMBER or self.waits(li) for li in self.check
        )

    def waits(self, line: Line) -> bool:
        """Whether a line of the flight check is as it is at every start."""
        return (line.vehicle, line.name) in self.waiting

    @property
    def check_state(self) -> Grade:
        """The worst line; unknown where none is heard. Amber that was accepted counts as green."""
        if not self.check:
            return Grade.UNKNOWN
        return worst([li for li in self.check if not li.passes] or [Line("", "", Grade.GREEN, "")])

    def against_others(self, name: str) -> Tuple[Relative, ...]:
        """Gives the places of one vehicle, as both places are now; of those that are not known only
        the name."""
        places = {v.name: v.place for v in self.vehicles}
        own = places[name]
        return tuple(
            relative(own.value, place.value)
            if not own.stale and not place.stale
            else Relative(other)
            for other, place in places.items()
            if other != name
        )

    @property
    def headline(self) -> str:
        """One line: what goes on, with figures, and what comes next."""
        return self.guide.headline
