# SPDX-License-Identifier: Apache-2.0
"""The mission of a demo of System I (thesis 4.1, figure 4.2): two Tellos look over a small maze from
stations around a robot whose gimbals follow them, in an order in which these lose nobody on the way;
then they hold before it and follow it."""

from dataclasses import dataclass
from typing import Dict, Sequence, Tuple

import numpy as np
import yaml

from fcsv_geometry import transforms
from fcsv_geometry.missions.mission import Mission
from fcsv_guidance.robot import Robot
from fcsv_sim.errors import SimulationError
from fcsv_sim.robot.gimbals.survey import GimbalSurvey, T_world_level
from fcsv_sim.robot.gimbals.ways import GimbalWays
from fcsv_sim.robot.places.looking import Lookout
from fcsv_sim.robot.places.survey import HoverStation
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.town import Town

#: Where the reference lines up, ahead of the robot and aside, and how far right of it the other (m).
AHEAD_M, ASIDE_M, BESIDE_M = 2.6, 0.65, 1.35
_LEAST_STATIONS = 5  # cells that few views show are not surely free


@dataclass(frozen=True)
class GimbalMission:
    """``reference_xy_m``: where the reference lines up (world), looking along x; ``document``: the
    mission's file; ``words``: where the vehicles look from."""

    reference_xy_m: Tuple[float, float]
    document: Dict[str, object]
    words: str

    def text(self) -> str:
        """The mission's file."""
        return yaml.safe_dump(self.document, sort_keys=False)


def gimbal_mission(
    town: Town, robot: Robot, survey: GimbalSurvey, base: Mission, document: Dict[str, object]
) -> GimbalMission:
    """The mission for a small place: ``document`` (that of ``base``, whose bounds it flies by) with
    its stations. Raises SimulationError where no order of stations keeps the vehicles seen."""
    plan, rules = town.plan, survey.plan()
    ways = GimbalWays(survey, T_world_level(plan), BESIDE_M, base.flight)
    lever_m = survey.T_body_cam[:3, 3]
    x, y = plan.start_m
    z_m = float(plan.height(x, y)) + base.home_height_m
    at = HoverStation((float(x - AHEAD_M), float(y + ASIDE_M), z_m), 0.0)
    home = _view(at.T_world_body, lever_m)
    able = [s for s in survey.candidates(plan) if ways.leads(home, _view(s.T_world_body, lever_m))]
    if not able:
        raise SimulationError("on the way to every station the gimbals lose sight of a vehicle")
    lookout = Lookout(town, Footing.of(plan).clearance(robot), rules.look, able)
    chosen = lookout.first(_LEAST_STATIONS, rules.most).stations
    stations = [_view(s.T_world_body, lever_m) for s in chosen]
    legs = ways.ordered([home, *stations, home])
    if legs is None:
        raise SimulationError("on the way to every station the gimbals lose sight of a vehicle")
    last = {"axis": "horizontal", "baseline_m": BESIDE_M, "follow_s": document.pop("follow_s")}
    names = [*(f"look {k}" for k in range(1, len(legs))), "hold"]
    listed = [_station(home, way, base, name) for name, way in zip(names, legs)]
    listed[-1]["configurations"] = [last]
    at_m = [way[-1][:3, 3] for way in legs[:-1]]
    words = f"the vehicles look into the maze from {len(at_m)} places around the robot: "
    words += ", ".join(f"({p[0]:.1f}, {p[1]:.1f}, {p[2]:.1f}) m" for p in at_m)
    return GimbalMission(at.xyz_m[:2], {**document, "stations": listed}, words)


def _view(T_world_body: np.ndarray, lever_m: np.ndarray) -> np.ndarray:
    """T_world_view of a viewpoint whose reference vehicle, level, is there."""
    return T_world_body @ transforms.transform(np.eye(3), lever_m)


def _station(
    home: np.ndarray, way: Sequence[np.ndarray], base: Mission, name: str
) -> Dict[str, object]:
    """The station to which ``way`` leads, in home."""
    *via, (x_m, y_m, up_m, heading_deg) = (_in_home(home, T) for T in way)
    found = {"name": name, "place_m": [x_m, y_m], "height_m": round(base.home_height_m + up_m, 3)}
    found["headings_deg"] = [heading_deg]
    return {**found, "via": [[x, y, heading] for x, y, _, heading in via]} if via else found


def _in_home(home: np.ndarray, T_world_view: np.ndarray) -> Tuple[float, float, float, float]:
    """x, y, z (m) and heading (degrees)."""
    T = transforms.invert(home) @ T_world_view
    x_m, y_m, z_m = (round(float(v), 3) for v in T[:3, 3])
    return x_m, y_m, z_m, round(float(np.degrees(transforms.yaw(T))), 1)
