# SPDX-License-Identifier: Apache-2.0
"""Pictures of the simulated world from a vehicle that flies in it now, and the notes of where they
were truly taken."""

from pathlib import Path
from typing import List, Sequence

import cv2

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.render.bodies import BoxedThing, RenderedBody
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, Shot, SimulatedCamera
from fcsv_sim.truth import TruthReader
from fcsv_sim.world.movers import ROBOT, ball_radius_m, movers, placed_boxes, things
from fcsv_sim.world.place import PlacePlan
from fcsv_sim.world.town import Town
from fcsv_tracking.robot_tags import load_robot_tags

_HEADER = "stamp_s,vehicle,x,y,z,qx,qy,qz,qw\n"


class Photographer:
    """The camera of ``vehicle``; ``vehicles`` are seen where they are, and, where ``moving``, a car
    and a walker, in a place that a robot drives through the robot, with the tags that
    ``robot_file`` names, and what comes into its way.

    Raises ConfigError where a file is wrong, SimulationError where nothing can move in this town.
    """

    def __init__(
        self,
        vehicle: str,
        vehicles: Sequence[str],
        vehicles_dir: str,
        sim_dir: str,
        town: Town,
        seed: int,
        camera: CameraParameters,
        moving: bool = False,
        robot_file: str = "",
    ):
        self._vehicle = vehicle
        geometries = load_vehicles(vehicles_dir, list(dict.fromkeys([*vehicles, vehicle])))
        self._others: List = [
            (g, TruthReader(sim_dir, n)) for n, g in geometries.items() if n != vehicle
        ]
        is_place = isinstance(town.plan, PlacePlan)
        self._movers = movers(town.plan) if moving and not is_place else []
        tags = tuple(load_robot_tags(robot_file, geometries).values()) if robot_file else ()
        self._placed = [
            (boxes, ball_radius_m(boxes), tags if name == ROBOT else (), TruthReader(sim_dir, name))
            for name, boxes in placed_boxes().items()
        ]
        self._placed = self._placed if is_place and (moving or robot_file) else []
        self._truth = TruthReader(sim_dir, vehicle)
        cv2.setNumThreads(1)  # the machine is shared with everything that flies
        own = geometries[vehicle]
        self._camera = SimulatedCamera(
            Renderer(town), own.T_body_cam, camera, seed * 1000 + own.system_id
        )
        self._notes = _open_notes(Path(sim_dir) / f"truth_cameras_{vehicle}.csv")

    @property
    def model(self):
        """The camera's lens and picture."""
        return self._camera.model

    def photograph(self, stamp_s: float, samples: int) -> Shot:
        """A picture of a moment that just passed, noted. Raises PoseUnavailable where nobody
        flies."""
        T_world_body = self._truth.wait_for(stamp_s)
        bodies = [*self._others_at(stamp_s), *things(self._movers, stamp_s)]
        bodies += self._placed_at(stamp_s)
        shot = self._camera.shoot(stamp_s, T_world_body, bodies, samples)
        self._note(shot)
        return shot

    def _others_at(self, stamp_s: float) -> List[RenderedBody]:
        """Bodies of the other vehicles; one without truth is not there."""
        bodies = []
        for geometry, truth in self._others:
            try:
                bodies.append(RenderedBody(geometry, truth.wait_for(stamp_s)))
            except PoseUnavailable:
                continue
        return bodies

    def _placed_at(self, stamp_s: float) -> List[BoxedThing]:
        """The robot and the crate, once they are there."""
        bodies = []
        for boxes, radius_m, tags, truth in self._placed:
            try:
                T_world_thing = truth.wait_for(stamp_s)
            except PoseUnavailable:
                continue
            bodies.append(BoxedThing(boxes, T_world_thing, radius_m, tags))
        return bodies

    def _note(self, shot: Shot) -> None:
        """The truth, before the picture leaves: no recorded picture is without it. The stamp as ROS
        cuts it off."""
        seconds = int(shot.stamp_s)
        nanoseconds = int((shot.stamp_s - seconds) * 1_000_000_000)
        values = [*shot.T_world_cam[:3, 3], *transforms.quaternion_xyzw(shot.T_world_cam)]
        row = ",".join(f"{v:.9f}" for v in values)
        self._notes.write(f"{seconds}.{nanoseconds:09d},{self._vehicle},{row}\n")


def _open_notes(path: Path):
    path.parent.mkdir(parents=True, exist_ok=True)
    notes = open(path, "a", buffering=1)
    if notes.tell() == 0:
        notes.write(_HEADER)
    return notes
