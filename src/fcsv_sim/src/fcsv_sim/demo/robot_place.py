# SPDX-License-Identifier: Apache-2.0
"""A demo with a robot on the ground: where its vehicles look from, and its drive over their map."""

import json
from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.robot import load_robot
from fcsv_sim.bringup import robot_file
from fcsv_sim.demo import gimbal_guided
from fcsv_sim.demo.fleet import FleetPlan
from fcsv_sim.demo.narration import Narrator
from fcsv_sim.demo.pose_errors import true_pose
from fcsv_sim.machines.machines import Machine, MachineError
from fcsv_sim.people.operator import Field
from fcsv_sim.robot.guided import GuidedDrive, GuidedResult, drive_guided, drive_result, in_words
from fcsv_sim.robot.placed import place_of
from fcsv_sim.robot.places.looking import first_look
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.town import Town
from fcsv_stereo.evaluating.truth import load_truth

ROBOT = "rescue"
_HOME = "T_world_home.npy"


def start_for(world: str, seed: int, height_m: float) -> Tuple[Tuple[float, float], str]:
    """Where the column is to stand (x, y; world, m) so that its reference, ``height_m`` above and
    looking along x, sees as much as can be seen of the robot's ways; and that in words."""
    town = Town.generate(seed, world)
    clear = Footing.of(place_of(town)).clearance(load_robot(robot_file(ROBOT)))
    station, leads = first_look(town, clear, height_m)
    start = (station.xyz_m[0] - Field.start_xy_m[0], station.xyz_m[1] - Field.start_xy_m[1])
    seen = "a way to the goal can be seen from there" if leads else "it hides a part of every way"
    place = f"({station.xyz_m[0]:.1f}, {station.xyz_m[1]:.1f}, {height_m:g}) m"
    return start, f"the vehicles look into the {world} from {place}, along x: {seen}"


def write_home(plan: FleetPlan, T_world_home: np.ndarray) -> None:
    """Where home truly is, for the drive's picture after the flight."""
    plan.guide_folder.mkdir(parents=True, exist_ok=True)
    np.save(plan.guide_folder / _HOME, T_world_home)


def guided_drive(plan: FleetPlan, T_world_home: np.ndarray) -> GuidedDrive:
    """The drive of a demo: over the map of its flight, or while its vehicles watch."""
    in_flight = plan.watch or plan.robot_site is not None
    return GuidedDrive(
        () if in_flight else (plan.folder / "map",),
        plan.world,
        plan.seed,
        robot_file(ROBOT if plan.robot_site is None else gimbal_guided.ROBOT),
        T_world_home,
        plan.guide_folder,
        sim_dir=plan.sim_folder if plan.watch else None,
        gimbals=plan.robot_site is not None,
        follower=plan.follower,
    )


def drive_robot(plan: FleetPlan, say: Narrator) -> int:
    """Guides a robot over the map of the flight, or tells of its drive in flight; exit status 1
    where it touched something, or did not arrive and nobody said why."""
    if plan.watch or plan.robot_site is not None:
        result = _driven_in_flight(plan, say)
    else:
        result = _driven_afterwards(plan, say)
    print("\n" + "\n".join(in_words(result)))
    return 0 if result.is_sound else 1


def _driven_in_flight(plan: FleetPlan, say: Narrator) -> GuidedResult:
    home = plan.guide_folder / _HOME
    if not home.is_file():
        raise MachineError("no robot was guided: the vehicles had no map before they held")
    drive = guided_drive(plan, np.load(home))
    views = sorted(report.parent for report in plan.folder.glob("site/views/*/report.json"))
    return drive_result(drive, views or (plan.folder / "map",), say)


def _driven_afterwards(plan: FleetPlan, say: Narrator) -> GuidedResult:
    reference = json.loads((plan.folder / "map" / "report.json").read_text())["reference"]
    truth = load_truth(plan.session_folder / "truth")
    T_world_home = true_pose(truth, reference["image"]) @ transforms.invert(
        np.array(reference["T_home_cam"])
    )
    say("a robot is guided over the map, by the nodes of guidance.launch")
    with Machine("guidance", plan.run_folder) as machine:
        return drive_guided(guided_drive(plan, T_world_home), machine, say)
