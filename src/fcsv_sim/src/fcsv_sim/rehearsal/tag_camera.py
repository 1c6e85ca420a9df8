# SPDX-License-Identifier: Apache-2.0
"""What a rehearsed vehicle's camera sees of the tag in front: by where both truly are, with the
errors of a tag."""

from typing import Optional

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.streams.arrivals import RELAY
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle
from fcsv_tracking.tags import corner_points

_PICTURE_S = 0.18  # 5 pictures a second
_TAG_M = (1.0, 6.0)  # from how near and how far a tag is seen
# so far off the column's first heading pilots hold theirs: it counts as that one
_AHEAD_RAD = 0.12
_CORNER_PX, _FOCAL_PX = 0.15, 600.0
_PLACE = 0.02  # error of the place that one picture tells: share of the distance


class TagCamera:
    """Is the camera of ``vehicle``, which flies behind ``front``."""

    def __init__(
        self, vehicle: RehearsedVehicle, front: RehearsedVehicle, random: np.random.Generator
    ):
        self._vehicle, self._front, self._random = vehicle, front, random
        self._due_s = 0.0

    def look(self, now_s: float) -> Optional[tm.SeenTags]:
        """The next picture, where it is due and the tag is in it."""
        vehicle, front = self._vehicle, self._front
        if now_s < self._due_s or not (vehicle.sampled_now and front.sampled_now):
            return None
        yaw_rad = transforms.yaw(vehicle.body.T_world_body)
        yaw_rad = yaw_rad if abs(yaw_rad) > _AHEAD_RAD else 0.0
        step = rotations.turn_about_z(-yaw_rad) @ (front.p_world_m - vehicle.p_world_m)
        sees = (
            _TAG_M[0] < step[0] < _TAG_M[1]
            and abs(step[1]) < 0.5 * step[0]
            and abs(step[2]) < 0.4 * step[0]
        )
        self._due_s = now_s + _PICTURE_S
        if not sees:
            return None
        geometry = vehicle.geometry
        T_cam_world = transforms.invert(vehicle.body.T_world_body @ geometry.T_body_cam)
        T_cam_tag = T_cam_world @ front.body.T_world_body @ front.geometry.T_body_tag
        p_cam = transforms.apply(T_cam_tag, corner_points(front.geometry.tag_size_m))
        corners = p_cam[:, :2] / p_cam[:, 2:] + self._random.normal(
            0.0, _CORNER_PX / _FOCAL_PX, (4, 2)
        )
        p_cam_tag = T_cam_tag[:3, 3] + self._random.normal(0.0, _PLACE, 3) * np.linalg.norm(step)
        tag = tm.SeenTag(front.geometry.tag_id, front.geometry.tag_size_m, corners, p_cam_tag)
        T_odom_cam, stamp_s = vehicle.T_odom_body @ geometry.T_body_cam, vehicle.odometry.stamp_s
        return tm.SeenTags(vehicle.name, RELAY, stamp_s, T_odom_cam, _FOCAL_PX, [tag])
