# SPDX-License-Identifier: Apache-2.0
"""System I rehearsed: a small maze that two Tellos map while gimbals on the robot follow them, and a
drive by these gimbals."""

from pathlib import Path
from typing import Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry.programs.workspace import bringup
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_guidance.place.hold_places import HoldPlaces, hold_places
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.planning import plan_over
from fcsv_guidance.route.search import NoRoute
from fcsv_sim.bringup import vehicles_folder
from fcsv_sim.errors import SimulationError
from fcsv_sim.robot.contact import TrueGround
from fcsv_sim.robot.gimbals.survey import START_YAW_RAD, GimbalSurvey
from fcsv_sim.robot.gimbals.tracked_place import GimbalPlaces
from fcsv_sim.robot.places.mapped import MappedPlace, mapped_place
from fcsv_sim.robot.rehearsal.faults import RobotFault
from fcsv_sim.robot.rehearsal.one_drive import LONGEST_S, PlaceGuides, RobotDrive
from fcsv_tracking.gimbal.config import Gimbal, load_ground_robot

SMALL = "small_maze"
_PLANNED_SIGMA_M = 0.05


def gimbals_of_robot() -> Sequence[Gimbal]:
    """Gives those of config/gimbal/ground_robot.yaml."""
    return load_ground_robot(bringup() / "config" / "gimbal" / "ground_robot.yaml").gimbals


def small_survey() -> GimbalSurvey:
    """Two Tellos that the robot's gimbals follow; the first of these follows the reference."""
    gimbals = gimbals_of_robot()
    name = gimbals[0].vehicle
    return GimbalSurvey(gimbals, load_vehicles(vehicles_folder(), (name,))[name].T_body_cam)


def small_place(seed: int, robot: Robot, folder: Path) -> MappedPlace:
    """The small maze of a seed, mapped by two Tellos. Raises SimulationError where no station's
    pictures make a map."""
    return mapped_place(SMALL, seed, robot, folder, survey_plan=small_survey().plan())


def gimbal_drive(
    place: MappedPlace,
    robot: Robot,
    fault: RobotFault,
    seed: int,
    longest_s: float = LONGEST_S,
    guides: Optional[PlaceGuides] = None,
) -> Tuple[RobotDrive, Optional[HoldPlaces]]:
    """A drive through a small maze and where the vehicles hold meanwhile: beside the route that the
    maps show, None where they show none and no vehicle is needed beside one."""
    plan, gimbals = place.town.plan, gimbals_of_robot()
    known = place.known(robot)
    route = plan_over(known.grid, known.stands, plan.start_m, plan.goal_m, _PLANNED_SIGMA_M)
    shown = not isinstance(route, NoRoute)
    ends = [plan.start_m, (plan.start_m[0] + 1.0, plan.start_m[1])]
    way_m = np.asarray(route.points_home_m if shown else ends)
    holds = hold_places(way_m, gimbals, START_YAW_RAD)
    if holds is None:
        raise SimulationError(f"{place.name}: the gimbals see no two places beside the way")
    true, start = TrueGround(place.footing, place.clear), (*plan.start_m, START_YAW_RAD)
    places = GimbalPlaces(gimbals, holds, true, start, place.town.seed, seed, longest_s, way_m)
    drive = RobotDrive(place, robot, fault, seed, places, START_YAW_RAD, guides)
    return drive, holds if shown else None
