# SPDX-License-Identifier: Apache-2.0
"""System I as the thesis drew it (figure 4.2): two Tellos that gimbals on a robot follow map a small
maze, and the robot drives through it by what its gimbals see of them."""

from dataclasses import replace
from pathlib import Path
from typing import Dict, Mapping, Tuple

import numpy as np

from fcsv_geometry.config import read_yaml
from fcsv_geometry.missions.mission import load_mission
from fcsv_guidance.robot import load_robot
from fcsv_sim.bringup import mission_file, robot_file
from fcsv_sim.demo.fleet import FleetPlan
from fcsv_sim.demo.site import PairSite
from fcsv_sim.demo.tellos import SimulatedTellos
from fcsv_sim.machines.machines import MachineError
from fcsv_sim.robot.gimbals.mission import BESIDE_M, gimbal_mission
from fcsv_sim.robot.gimbals.rehearsal import SMALL, small_survey
from fcsv_sim.robot.gimbals.survey import START_YAW_RAD
from fcsv_sim.tello.places import TelloPlace
from fcsv_sim.world.town import Town

GUIDANCE, ROBOT = "guidance", "small"
_FOLLOW_S = 150.0
_CELL_M, _REACH_M = 0.05, 9.0  # of the ground
_OLDEST_MAP_S = 3600.0  # nothing but the robot moves in the place: its map stays true
_DRIVES = {"sim_robot_drives": True, "base_odometry": "/odom", "base_pose": "/robot_pose"}


def world_of(wished: str, default: str) -> str:
    """The world that is driven through. Raises MachineError where another is wished."""
    if wished not in (SMALL, default):
        raise MachineError(f"--world {wished}: system {GUIDANCE} drives through {SMALL}")
    return SMALL


def guided_site(seed: int, gimbal_site: PairSite, out: Path) -> Tuple[Path, PairSite, str]:
    """The mission's file, which is written to ``out``, where the vehicles line up, and where they
    look from in words. Raises SimulationError where the gimbals see no way."""
    base = mission_file(GUIDANCE)
    town, robot = Town.generate(seed, SMALL), load_robot(robot_file(ROBOT))
    document = {**read_yaml(base), "follow_s": _FOLLOW_S}
    chosen = gimbal_mission(town, robot, small_survey(), load_mission(base), document)
    out.mkdir(parents=True, exist_ok=True)
    path = out / "mission.yaml"
    path.write_text(chosen.text())
    site = replace(
        gimbal_site,
        launch_args={**gimbal_site.launch_args, **_DRIVES},
        reference_xy_m=chosen.reference_xy_m,
        beside_m=BESIDE_M,
        heading_deg=-float(np.degrees(START_YAW_RAD)),
    )
    return path, site, chosen.words


class GuidedTellos(SimulatedTellos):
    """Tellos before a tracker on a robot, and what guides that, from the start."""

    def __init__(self, plan: FleetPlan, places: Mapping[str, TelloPlace]):
        super().__init__(plan, plan.robot_site, places)

    def _launch(self) -> None:
        plan = self.plan
        robot: Dict[str, object] = {"robot": robot_file(ROBOT)}
        self.launches["robot"] = self.control.launch(
            "fcsv_bringup",
            "sim_robot.launch",
            **robot,
            part="robot",
            world=plan.world,
            seed=plan.seed,
            folder=plan.guide_folder,
            sim_dir=plan.sim_folder,
            tag=False,
            yaw_deg=f"{np.degrees(START_YAW_RAD):.6f}",
        )
        self.launches["guidance"] = self.control.launch(
            "fcsv_bringup",
            "guidance.launch",
            **robot,
            live=True,
            stations=True,
            drive="cmd_vel",
            gimbals=self._vehicles,
            follow=True,
            cell_m=_CELL_M,
            reach_m=_REACH_M,
            oldest_map_s=_OLDEST_MAP_S,
        )
        super()._launch()
