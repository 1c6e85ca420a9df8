# SPDX-License-Identifier: Apache-2.0
"""The thesis's three ways of knowing where the cameras are, each as a demo: what flies, how, and
how it is mapped."""

from dataclasses import dataclass
from functools import partial
from typing import Callable, Dict, List, Optional, Tuple

import numpy as np

from fcsv_control.flight_check import speeds
from fcsv_geometry import transforms
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.programs.workspace import bringup
from fcsv_sim.autopilot.parameters import DEFAULTS
from fcsv_sim.bringup import vehicles_folder
from fcsv_sim.demo import flights, reach
from fcsv_sim.demo.fleet import FleetPlan
from fcsv_sim.demo.gimbal_guided import GUIDANCE
from fcsv_sim.demo.narration import Narrator
from fcsv_sim.demo.site import PairSite
from fcsv_sim.demo.tellos import received_stamps
from fcsv_tracking.gimbal.config import load_ground_robot

# all of it on two cores that others use too
_SLOW = {"sim_rate_hz": 8.0, "lost_s": 1.5, "search_dwell_s": 1.0}
GIMBAL_SITE = PairSite("gimbal.launch", _SLOW, (2.6, 1.4), late=True)
MOCAP_SITE = PairSite("mocap.launch", {}, (3.4, 0.5), beside_m=1.0, sway_m=0.35)
_TELLOS = ("tello1", "tello2")
_BY_HAND = ("--method", "thesis", "--trim-vertical", "20", "60", "60")
#: As launch/mocap.launch stands the simulated tracker: on the ground, looking up at 45 degrees
#: (thesis 5.7).
T_WORLD_MOCAP = transforms.from_xyz_rpy([0.0, 0.0, 0.3], np.radians([0.0, -45.0, 0.0]))
#: The mocap's level frame: its place, level, looking where it looks (docs/design/trackers.md).
_T_WORLD_LEVEL = transforms.from_xyz_yaw(T_WORLD_MOCAP[:3, 3], 0.0)


@dataclass(frozen=True)
class MapRun:
    """One call of the map command: its folder beside session/, and its arguments."""

    folder: str = "map"
    arguments: Tuple[str, ...] = ()


@dataclass(frozen=True)
class System:
    """``fly`` gives seconds flown and metres moved; ``require`` raises MissionError on what it
    cannot fly."""

    vehicles: Tuple[str, ...]
    mission: str
    fly: Callable[[FleetPlan, Narrator], Tuple[float, float]]
    maps: Callable[[Mission], Tuple[MapRun, ...]] = lambda _mission: (MapRun(),)
    require: Callable[[Mission], None] = lambda _mission: None
    grows: bool = False  # flies vehicles that only the mission names, too
    # where all fly in one odometry frame that the simulation knows
    T_world_odom: Optional[np.ndarray] = None
    # of pictures that have none of their own
    stamps: Optional[Callable[[FleetPlan], Dict[str, List[float]]]] = None

    def fleet(self, mission: Mission) -> Tuple[str, ...]:
        """Who flies it: the column, front first. Raises MissionError where that cannot fly it."""
        named = sorted(
            {c.vehicle for c in mission.configurations if c.vehicle} - set(self.vehicles)
        )
        known = (
            [n for n in named if (vehicles_folder() / f"{n}.yaml").is_file()] if self.grows else []
        )
        fleet = (*self.vehicles, *known)
        mission.check_vehicles(fleet)
        return fleet


def _gimbal_can(mission: Mission) -> None:
    robot = load_ground_robot(bringup() / "config" / "gimbal" / "ground_robot.yaml")
    reach.require_gimbal_reach(robot, GIMBAL_SITE, mission, _TELLOS)


def _mocap_can(mission: Mission) -> None:
    reach.require_mocap_view(T_WORLD_MOCAP, MOCAP_SITE, mission, _TELLOS)


def _autopilots_can(mission: Mission) -> None:
    """The simulated autopilots fly as fast as their parameters say; the flight check would hold
    other missions."""
    have, planned = (
        {name: value for name, (value, _) in DEFAULTS.items()},
        mission.flight.autopilot_parameters,
    )
    wrong = {name for names in speeds.others(have, planned) for name in names}
    name = next((n for n in planned if n in wrong), None)
    if name is not None:
        raise MissionError(
            f"mission '{mission.name}': flight: plans with {name} {planned[name]:g}, the simulated autopilots have "
            f"{have[name]:g}: leave speeds and accelerations out"
        )


def _mocap_maps(mission: Mission) -> Tuple[MapRun, ...]:
    """Gives, besides the map that every demo makes, that of thesis 5.7 where its baselines were
    flown: 1 m up to 20 m, 2 m beyond, the noisy 3 m left out."""
    vertical = sorted({c.baseline_m for c in mission.configurations if c.axis == "vertical"})
    return (
        (MapRun(), MapRun("map_thesis", _BY_HAND)) if vertical == [1.0, 2.0, 3.0] else (MapRun(),)
    )


def _before(site: PairSite, T_world_odom: np.ndarray, mission: str, **more) -> System:
    """Two Tellos before a tracker on the ground."""
    fly = partial(flights.fly_tellos, site)
    return System(_TELLOS, mission, fly, stamps=received_stamps, T_world_odom=T_world_odom, **more)


#: A demo without vehicles (tilting.py), by its name beside the systems that fly.
TILTING = "tilting"

SYSTEMS: Dict[str, System] = {
    "tags": System(
        ("uav1", "uav2"), "short", flights.fly_fleet, grows=True, require=_autopilots_can
    ),
    "gimbal": _before(GIMBAL_SITE, np.eye(4), "gimbal", require=_gimbal_can),
    "mocap": _before(MOCAP_SITE, _T_WORLD_LEVEL, "mocap", maps=_mocap_maps, require=_mocap_can),
    GUIDANCE: System(_TELLOS, GUIDANCE, flights.fly_guided, stamps=received_stamps),
    "tello": _before(MOCAP_SITE, _T_WORLD_LEVEL, "tello", require=_mocap_can),
}
