# SPDX-License-Identifier: Apache-2.0
"""A small place as two Tellos map it that gimbals on the standing robot follow (thesis 4.1): where
they may look from, and what the gimbals tell of their cameras."""

from dataclasses import dataclass
from typing import List, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.errors import SimulationError
from fcsv_sim.gimbal.gimbal_camera import GimbalCameraParameters
from fcsv_sim.robot.places.looking import LookRules
from fcsv_sim.robot.places.mapped import SurveyPlan
from fcsv_sim.robot.places.survey import HoverStation, SurveyRules, TrackedPose
from fcsv_sim.tello.pictures import SimulatedVideoParameters
from fcsv_sim.trials.gimbal_evaluation import Setup, follow
from fcsv_sim.world.place import PlacePlan
from fcsv_stereo.model import PosePrior
from fcsv_tracking.gimbal.config import Gimbal
from fcsv_tracking.gimbal.reach import gimbal_problem

#: The robot stands with its back to the maze: behind it the gimbals see nothing.
START_YAW_RAD = np.pi
# of the robot, and above the ground, of places that are tried
_AWAY_M, _HEIGHTS_M = (1.8, 2.4, 3.0, 3.5), (1.7, 2.1, 2.5)
_BEARINGS, _HEADINGS = 12, 12
_FACES_RAD = np.radians(75.0)  # a heading is tried where the place's middle lies so near to it
_HOLDS_S = 1.2  # in front of the gimbals before a picture is taken
_CORNERS_PX = 0.05  # noise that the detector leaves on drawn pictures


@dataclass(frozen=True)
class GimbalSurvey:
    """Tellos that look over a place, each followed by its gimbal on a robot that stands at the
    start; the first of ``gimbals`` follows the reference. ``T_body_cam`` 4x4 of their cameras."""

    gimbals: Sequence[Gimbal]
    T_body_cam: np.ndarray

    def plan(self) -> SurveyPlan:
        """Gives how a small place is mapped: Tellos' pictures, pairs 0.9 and 1.4 m wide."""
        camera = SimulatedVideoParameters().camera
        # of a picture's pose before it is refined (docs/lab/gimbal.md)
        prior = PosePrior(float(np.radians(0.4)), 0.006, 0.002)
        survey = SurveyRules(
            camera, self.T_body_cam, (0.9, 1.4), 0.05, float(np.radians(1.0)), prior
        )
        look = LookRules(survey, 7.5, 0.1, 0.2, 0.3, 0.05, 150.0, 0.03, 0.005)
        return SurveyPlan(look, 0.05, 0.05, 4, 8, 4, self)

    def candidates(self, plan: PlacePlan) -> List[HoverStation]:
        """Stations about the robot at which its gimbals see both vehicles at every baseline."""
        x, y = plan.start_m
        x0, x1, y0, y1 = plan.area_m
        T_ground_world = transforms.invert(T_world_level(plan))
        baselines_m = self.plan().look.survey.baselines_m
        found = []
        for bearing in np.arange(_BEARINGS) * 2 * np.pi / _BEARINGS:
            for away_m in _AWAY_M:
                at = (float(x + away_m * np.cos(bearing)), float(y + away_m * np.sin(bearing)))
                ahead = np.arctan2(0.5 * (y0 + y1) - at[1], 0.5 * (x0 + x1) - at[0])
                for yaw in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS:
                    if np.cos(yaw - ahead) < np.cos(_FACES_RAD):
                        continue
                    for high_m in _HEIGHTS_M:
                        z = float(plan.height(*at)) + high_m
                        station = HoverStation((*at, z), float(yaw))
                        if self._seen(T_ground_world, station, baselines_m):
                            found.append(station)
        if not found:
            raise SimulationError("the gimbals see no place from which two vehicles could look")
        return found

    def _seen(self, T_ground_world: np.ndarray, station: HoverStation, baselines_m) -> bool:
        places = [station, *(station.beside(b) for b in baselines_m)]
        owners = [self.gimbals[0], *[self.gimbals[1]] * (len(places) - 1)]
        return not any(
            gimbal_problem(gimbal, T_ground_world @ place.T_world_body)
            for gimbal, place in zip(owners, places)
        )

    def tracked(self, plan: PlacePlan, seed: int) -> TrackedPose:
        """What the gimbals tell of cameras, in a home that lies where the robot is said to stand:
        level, as it is not quite. The gimbals' own errors are those of the place, ``seed // 100``,
        the noise another for each picture."""
        T_level, T_true = T_world_level(plan), T_world_ground(plan)
        pictures = [0]

        def tracked(vehicle: int, T_world_cam: np.ndarray) -> np.ndarray:
            body = transforms.invert(T_true) @ T_world_cam @ transforms.invert(self.T_body_cam)
            pictures[0] += 1
            holds_s = _HOLDS_S + 0.1 * pictures[0]
            owns = gimbal_seed(seed // 100, vehicle)
            run = follow(self.gimbals[vehicle], _HoldingTrack(body), holds_s, owns, SETUP)
            if not run.given:
                raise SimulationError(f"gimbal {vehicle + 1} does not see its vehicle")
            return T_level @ run.given[-1][1].T_G_D @ self.T_body_cam

        return tracked


#: The gimbals' cameras where pictures are not drawn: as few pictures a second as a busy machine takes.
SETUP = Setup(camera=GimbalCameraParameters(rate_hz=10.0), corners_px=_CORNERS_PX)


def gimbal_seed(seed: int, number: int) -> int:
    """Gives the seed of a gimbal's own errors, the same while a place is mapped and driven in."""
    return 1000 + 10 * seed + number


def T_world_ground(plan: PlacePlan) -> np.ndarray:
    """Where the robot stands while the place is mapped: the slope of the ground below it."""
    x, y = plan.start_m
    d = 0.15
    slope_x = float(plan.height(x + d, y) - plan.height(x - d, y)) / (2 * d)
    slope_y = float(plan.height(x, y + d) - plan.height(x, y - d)) / (2 * d)
    T_level = T_world_level(plan)
    up = np.array([-slope_x, -slope_y, 1.0]) / np.sqrt(slope_x**2 + slope_y**2 + 1.0)
    ahead = T_level[:3, 0] - (T_level[:3, 0] @ up) * up
    ahead /= np.linalg.norm(ahead)
    R = np.column_stack([ahead, np.cross(up, ahead), up])
    return transforms.transform(R, T_level[:3, 3])


def T_world_level(plan: PlacePlan) -> np.ndarray:
    """Gives where it would stand if it stood level."""
    x, y = plan.start_m
    return transforms.from_xyz_yaw([x, y, float(plan.height(x, y))], START_YAW_RAD)


class _HoldingTrack:
    """A vehicle that holds."""

    def __init__(self, T_ground_body: np.ndarray):
        self._T_ground_body = T_ground_body

    def at(self, _stamp_s: float) -> np.ndarray:
        """T_G_D."""
        return self._T_ground_body
