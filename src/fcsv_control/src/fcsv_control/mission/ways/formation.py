# SPDX-License-Identifier: Apache-2.0
"""The column as one rigid body: its way to another viewpoint, first straight, then about the
reference's axis."""

import math
from dataclasses import dataclass
from typing import Dict, List, Mapping

import numpy as np

from fcsv_control.mission.ways.gliding import GlideRate
from fcsv_control.mission.ways.places import heading_rad, level_camera
from fcsv_geometry import rotations, transforms
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.missions.stations import Viewpoint

# a turn: trackers and tags follow it, and the outermost vehicle flies its arc well below its bounds
_TURN_RADPS, _TURN_RADPS2 = math.radians(20.0), math.radians(20.0)
_ARC_SHARE = 0.5
_LEAST_M, _LEAST_RAD = 0.05, math.radians(0.5)  # a leg that is shorter is left out

#: T_view_cam by vehicle: the figure that is kept
Figure = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class FormationLeg:
    """A straight way by ``shift_m`` (3,), or a turn by ``turn_rad`` to the left, of the frame
    ``T_home_view`` (4x4) in which the figure stands."""

    T_home_view: np.ndarray
    shift_m: np.ndarray
    turn_rad: float
    rate: GlideRate

    def frame(self, share: float) -> np.ndarray:
        """T_home_view after a share 0..1 of the leg."""
        p = self.T_home_view[:3, 3] + share * self.shift_m
        R = transforms.from_xyz_yaw(np.zeros(3), share * self.turn_rad)[:3, :3]
        return transforms.transform(R @ self.T_home_view[:3, :3], p)

    def places(self, figure: Figure, share: float) -> Dict[str, np.ndarray]:
        """T_home_cam of each vehicle then."""
        T_home_view = self.frame(share)
        return {n: T_home_view @ T for n, T in figure.items()}


def frame_of(T_home_cam: np.ndarray, T_view_cam: np.ndarray) -> np.ndarray:
    """T_home_view, level, in which a camera has its place of the figure.

    >>> T = transforms.from_xyz_yaw([3.0, 4.0, 0.0], 0.5)
    >>> T_view_cam = transforms.from_xyz_yaw([-3.5, 0.0, 0.0], 0.0) @ T_HOME_CAM_AT_HOME
    >>> bool(np.allclose(frame_of(T @ T_view_cam, T_view_cam), T))
    True
    """
    return level_camera(T_home_cam) @ transforms.invert(level_camera(T_view_cam))


def formation_legs(
    T_from: np.ndarray, T_to: np.ndarray, figure: Figure, flight: FlightBounds
) -> List[FormationLeg]:
    """Legs from one frame (T_home_view, level) to another; none where they are the same."""
    legs = []
    shift_m = T_to[:3, 3] - T_from[:3, 3]
    length_m = float(np.linalg.norm(shift_m))
    if length_m > _LEAST_M:
        level_m, up_m = float(np.hypot(*shift_m[:2])), float(shift_m[2])
        speed_mps, slows_mps2 = flight.along(level_m, up_m)
        rate = GlideRate(speed_mps / length_m, slows_mps2 / length_m)
        legs.append(FormationLeg(T_from, shift_m, 0.0, rate))
    turn_rad = rotations.wrap(_yaw_rad(T_to) - _yaw_rad(T_from))
    if abs(turn_rad) > _LEAST_RAD:
        T = transforms.transform(T_from[:3, :3], T_to[:3, 3])
        legs.append(FormationLeg(T, np.zeros(3), turn_rad, _turn_rate(turn_rad, figure, flight)))
    return legs


def legs_to(
    T_from: np.ndarray, viewpoint: Viewpoint, figure: Figure, flight: FlightBounds
) -> List[FormationLeg]:
    """Legs from a frame (T_home_view, level) to a viewpoint, through the places on its way."""
    frames = [T_from, *viewpoint.T_home_ways]
    ways = zip(frames[:-1], frames[1:])
    return [leg for a, b in ways for leg in formation_legs(a, b, figure, flight)]


def _turn_rate(turn_rad: float, figure: Figure, flight: FlightBounds) -> GlideRate:
    reach_m = max(max(float(np.hypot(*T[:2, 3])) for T in figure.values()), 1e-3)
    most = min(
        _TURN_RADPS,
        _ARC_SHARE * flight.speed_mps / reach_m,
        math.sqrt(_ARC_SHARE * flight.acceleration_mps2 / reach_m),
    )
    ramp = min(_TURN_RADPS2, _ARC_SHARE * flight.acceleration_mps2 / reach_m)
    return GlideRate(most / abs(turn_rad), ramp / abs(turn_rad))


def _yaw_rad(T_home_view: np.ndarray) -> float:
    return heading_rad(T_home_view @ T_HOME_CAM_AT_HOME)
