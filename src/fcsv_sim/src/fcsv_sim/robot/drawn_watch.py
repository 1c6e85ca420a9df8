# SPDX-License-Identifier: Apache-2.0
"""Vehicles that hold and watch, with drawn pictures and the matching that flies."""

from dataclasses import replace
from typing import Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.ground.views import DepthView
from fcsv_sim.render.bodies import BoxedThing
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.robot.places.survey import HoverStation
from fcsv_sim.robot.things import Box
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.movers import ball_radius_m, panelled
from fcsv_sim.world.town import Town
from fcsv_stereo.errors import StereoError
from fcsv_stereo.model import FLOWN, Configuration, ConfigurationInput, MapInput, Picture
from fcsv_stereo.pipeline import METHODS

BASELINE_M = 6.0
_PANEL_M = 0.2
_SHAKE_RAD, _HOVER_M = np.radians(1.0), 0.03
# errors of what the vehicles know of themselves: of the reference since the map, of the other's
# place beside it
_POSE_RAD, _POSE_M = np.radians((0.03, 0.15)), (0.01, 0.05)


class DrawnWatch:
    """Two vehicles that hold at a station, and the depth that live matching makes of an instant; a
    view takes more than a second."""

    def __init__(self, town: Town, station: HoverStation, seed: int):
        self._random = np.random.default_rng([seed, 41])
        parameters = CameraParameters(distortion=(0.0,) * 5, mount_deg=0.0)
        T_body_cam = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
        renderer = Renderer(town)
        self._cameras = [
            SimulatedCamera(renderer, T_body_cam, parameters, seed + k) for k in (0, 1)
        ]
        self._T_world_station = transforms.from_xyz_yaw(station.xyz_m, station.yaw_rad)
        self._method = METHODS["joint"]

    def look(self, stamp_s: float, things: Sequence[BoxedThing]) -> Optional[DepthView]:
        """Depth of an instant, in the world; None where nothing matched."""
        left, right = (self._picture(k, stamp_s, things) for k in (0, 1))
        between = Configuration.between(left.T_home_cam, right.T_home_cam)
        pair = ConfigurationInput(replace(between, name="watch"), [left], [right])
        try:
            r = self._method.map(MapInput("session", [pair], prior=FLOWN), self._method.monitor)
        except StereoError:
            return None
        K, T = r.reference.camera.K, r.reference.T_home_cam
        return DepthView("watch", r.depth, r.sigma, r.kind.astype(np.uint8), K, T, stamp_s)

    def _picture(self, k: int, stamp_s: float, things: Sequence[BoxedThing]) -> Picture:
        random = self._random
        off = np.array([0.0, -k * BASELINE_M, 0.0]) + random.normal(0.0, _HOVER_M, 3)
        T = transforms.from_xyz_rpy(off, random.normal(0.0, _SHAKE_RAD, 3))
        shot = self._cameras[k].shoot(stamp_s, self._T_world_station @ T, things)
        error = transforms.from_xyz_rpy(
            random.normal(0.0, _POSE_M[k], 3), random.normal(0.0, _POSE_RAD[k], 3)
        )
        T_home_cam = shot.T_world_cam @ error
        camera = self._cameras[k].model
        name = f"uav{k + 1}/{stamp_s:.3f}"
        return Picture(name, f"uav{k + 1}", stamp_s, shot.rgb, camera, T_home_cam)


def drawn_box(box: Box) -> BoxedThing:
    """The box as cameras see it: panels in several colours, the same for boxes of one size."""
    half_m = (*box.half_m, 0.5 * box.high_m)
    boxes = panelled(half_m, _PANEL_M, np.random.default_rng(7))
    T_world_thing = transforms.from_xyz_yaw([box.x_m, box.y_m, box.z_m], box.yaw_rad)
    return BoxedThing(boxes, T_world_thing, ball_radius_m(boxes))
