# SPDX-License-Identifier: Apache-2.0
"""A drawn place as the product maps it, kept in files: pictures of a place are drawn and mapped
once."""

import json
import os
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, List, Optional, Protocol, Sequence, Tuple

import numpy as np

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.known import GroundSeen, KnownGround
from fcsv_guidance.ground.model import Ground, ground_from
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.planning import plan_over
from fcsv_guidance.route.search import NoRoute
from fcsv_sim.errors import SimulationError
from fcsv_sim.robot.places.looking import LOOK, Looked, Lookout, LookRules
from fcsv_sim.robot.places.survey import HoverStation, TrackedPose, survey
from fcsv_sim.world.footing import Clearance, Footing
from fcsv_sim.world.place import PlacePlan
from fcsv_sim.world.town import Town

CELL_M = 0.1
PLANNED_SIGMA_M = 0.2  # of the robot's place, for which stations are chosen
_ARRAYS = ("depth", "sigma", "kind", "K", "T_home_cam")


class SurveyTracker(Protocol):
    """Whatever tells where the vehicles are, where it is no odometry of their own."""

    def candidates(self, plan: PlacePlan) -> Sequence[HoverStation]:
        """Stations at which it sees both vehicles."""

    def tracked(self, plan: PlacePlan, seed: int) -> TrackedPose:
        """What it tells at one station."""


@dataclass(frozen=True)
class SurveyPlan:
    """How a place is mapped: from ``least`` to ``most`` stations until they see a way, then from as
    many as ``more``. ``cell_m`` of the ground; ``planned_sigma_m``: of the robot's place, for which
    stations are chosen. Without a ``tracker`` vehicles stand anywhere, and know their places."""

    look: LookRules = LOOK
    cell_m: float = CELL_M
    planned_sigma_m: float = PLANNED_SIGMA_M
    least: int = 5
    most: int = 8
    more: int = 4
    tracker: Optional[SurveyTracker] = None


SURVEY_PLAN = SurveyPlan()  # of System III


@dataclass(frozen=True)
class MappedPlace:
    """``views`` and ``grounds``: what each station's map shows, in the world's frame, None where
    nothing matched; the rest is the truth."""

    world: str
    town: Town
    footing: Footing
    clear: Clearance
    looked: Looked
    views: Tuple[Optional[DepthView], ...]
    grounds: Tuple[Optional[Ground], ...]

    @property
    def name(self) -> str:
        """Gives the name of its folder and of its rows."""
        return f"{self.world} {self.town.seed}"

    def known(self, robot: Robot) -> KnownGround:
        """Gives where a robot can stand by all its maps."""
        known, numbered = KnownGround(robot), enumerate(self.grounds)
        known.receive_maps(_seen_from(n, ground) for n, ground in numbered if ground is not None)
        return known


def mapped_place(
    world: str,
    seed: int,
    robot: Robot,
    folder: Path,
    step: Optional[Callable[[str], None]] = None,
    survey_plan: SurveyPlan = SURVEY_PLAN,
) -> MappedPlace:
    """The place of a seed, mapped from stations that see the robot's ways, and then, where the
    truth has a way and the maps show none, from some more; ``step`` is told of each station.

    Maps that ``folder`` holds of the same stations are read, new ones are written there. Raises
    SimulationError where no station's pictures make a map.
    """
    town = Town.generate(seed, world)
    plan, footing, sigma_m = town.plan, Footing.of(town.plan), survey_plan.planned_sigma_m
    clear = footing.clearance(robot)
    tracker, look = survey_plan.tracker, survey_plan.look
    lookout = Lookout(town, clear, look, None if tracker is None else tracker.candidates(plan))
    lookout.first(survey_plan.least, survey_plan.most)
    x0, x1, y0, y1 = plan.area_m
    grid = Grid.around((x0, y0), (x1, y1), survey_plan.cell_m)
    folder.mkdir(parents=True, exist_ok=True)
    known, views, grounds = KnownGround(robot), [], []
    wanted, more = clear.leads(plan.start_m, plan.goal_m), survey_plan.more
    number = 0
    while number < len(lookout.looked().stations):
        station = lookout.looked().stations[number]
        if step is not None:
            step(f"station {number + 1}")
        found = _mapped_at(
            town, station, 100 * seed + number, folder / f"station{number}.npz", survey_plan
        )
        ground = ground_from([found], grid=grid) if found is not None else None
        views.append(found)
        grounds.append(ground)
        if ground is not None:
            known.receive(_seen_from(number, ground), None)
        number += 1
        if number == len(lookout.looked().stations) and wanted and more and known.grid is not None:
            way = plan_over(known.grid, known.stands, plan.start_m, plan.goal_m, sigma_m)
            if isinstance(way, NoRoute) and lookout.another(
                _free(known, lookout.looked(), sigma_m)
            ):
                more -= 1
    if not any(ground is not None for ground in grounds):
        raise SimulationError(f"{world} {seed}: no station's pictures make a map")
    return MappedPlace(world, town, footing, clear, lookout.looked(), tuple(views), tuple(grounds))


def _seen_from(number: int, ground: Ground) -> GroundSeen:
    return GroundSeen(0.0, f"station {number}", ground)


def _free(known: KnownGround, looked: Looked, place_sigma_m: float) -> np.ndarray:
    """(rows, columns) bool of the stations' grid: the robot can stand there with room for its
    place's sigma."""
    xy = looked.grid.middle_of(*np.indices(looked.grid.shape))
    row, column, inside = known.grid.cells_of(xy[..., 0], xy[..., 1])
    return inside & (known.clear_m[row, column] > 2 * place_sigma_m)


def _mapped_at(
    town: Town, station: HoverStation, seed: int, file: Path, survey_plan: SurveyPlan
) -> Optional[DepthView]:
    found = _read(file, station)
    if found is None:
        tracker = survey_plan.tracker
        tracked = None if tracker is None else tracker.tracked(town.plan, seed)
        found = survey(town, [station], seed, survey_plan.look.survey, tracked)
        _write(file, station, found)
    return replace(found[0], name=file.stem) if found else None  # as it is read again


def _read(file: Path, station: HoverStation) -> Optional[List[DepthView]]:
    """What a file holds; None where it holds no map of this station."""
    try:
        with np.load(file, allow_pickle=False) as stored:
            if json.loads(str(stored["station"])) != _listed(station):
                return None
            if "depth" not in stored:
                return []
            return [DepthView(file.stem, *(stored[name] for name in _ARRAYS), 0.0)]
    # none, or half written
    except (FileNotFoundError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _write(file: Path, station: HoverStation, found: List[DepthView]) -> None:
    arrays = {name: getattr(view, name) for view in found for name in _ARRAYS}
    part = file.with_suffix(".part.npz")
    np.savez_compressed(part, station=json.dumps(_listed(station)), **arrays)
    os.replace(part, file)


def _listed(station: HoverStation):
    return [*map(float, station.xyz_m), float(station.yaw_rad)]
