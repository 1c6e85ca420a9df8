# SPDX-License-Identifier: Apache-2.0
"""Whether a tracker on the ground can follow a pair through a mission; refused before anything is
started."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.mission import Mission
from fcsv_sim.demo.site import PairSite
from fcsv_sim.sensors.v120_duo import V120Duo, V120DuoErrors
from fcsv_tracking.gimbal.config import GroundRobot
from fcsv_tracking.gimbal.reach import gimbal_problem

_OUT_OF_VIEW_M = 20.0  # as far as the odometry's drift is known (docs/design/trackers.md)


def require_gimbal_reach(robot: GroundRobot, site: PairSite, mission: Mission, vehicles) -> None:
    """Every vehicle near enough to its gimbal, inside its limits and with a tag towards it. Raises
    MissionError."""
    for index, c in enumerate(mission.configurations):
        for name in vehicles:
            # the robot stands at the world's origin
            T_ground_body = site.expected_body(mission, index, name, vehicles)
            problem = gimbal_problem(robot.by_vehicle[name], T_ground_body)
            if problem:
                raise MissionError(
                    f"mission '{mission.name}': configurations[{index}].baseline_m: {c.title} puts {name} {problem}; "
                    "use a shorter baseline or another home_height_m"
                )


def require_mocap_view(
    T_world_mocap: np.ndarray, site: PairSite, mission: Mission, vehicles
) -> None:
    """All line up in view, where odometry is tied to the mocap, and leave it by no more than is
    known. MissionError."""
    duo = V120Duo(V120DuoErrors(), T_world_mocap, 0)
    for name, T in site.line_up(mission, vehicles).items():
        for aside_m in (-site.sway_m, 0.0, site.sway_m):
            if not duo.in_view(transforms.transform(T[:3, :3], T[:3, 3] + [0.0, aside_m, 0.0])):
                raise MissionError(
                    f"mission '{mission.name}': home_height_m: {mission.home_height_m:g} lines {name} up out of the "
                    "mocap's view (47 x 43 degrees, 45 degrees up); try 2.0"
                )
    for index, c in enumerate(mission.configurations):
        if c.baseline_m > _OUT_OF_VIEW_M:
            raise MissionError(
                f"mission '{mission.name}': configurations[{index}].baseline_m: {c.title} leads further out of the "
                f"mocap's view than odometry alone is good for ({_OUT_OF_VIEW_M:g} m); use a shorter baseline"
            )
