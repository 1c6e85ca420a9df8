# SPDX-License-Identifier: Apache-2.0
"""The robot's tags in drawn pictures: a vehicle's simulated camera shows them where the robot is, and
what the detector reads there is the robot's place."""

import cv2
import numpy as np
import pytest

from fcsv_geometry import rotations, transforms
from fcsv_geometry.vehicles.telemetry import SeenTag
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_guidance.place.tag_fix import RobotSight, tag_fix
from fcsv_sim.sensors.camera import CameraParameters
from fcsv_sim.sensors.photographer import Photographer
from fcsv_sim.truth import TruthWriter
from fcsv_sim.world.town import Town
from fcsv_tracking.robot_tags import load_robot_tags
from fcsv_tracking.tags import ON_BOARD_DECIMATE, TagDetector

SURE = 1e-8 * np.eye(6)  # the camera's true pose is known


@pytest.mark.parametrize("yaw_deg", [200.0, 135.0])
def test_a_drawn_robot_is_located_by_its_tags(root, tmp_path, yaw_deg):
    """Three sigma of what it states: of noise and blur at 8 m, in one picture."""
    robot, folder = root / "config/robots/rescue.yaml", root / "config/vehicles"
    tags, town = load_robot_tags(robot, {}), Town.generate(29, "low_maze")
    camera = Photographer(
        "uav1", ["uav1"], str(folder), str(tmp_path), town, 1, CameraParameters(), False, str(robot)
    )
    T_world_robot = transforms.from_xyz_yaw([6.0, 0.0, 0.0], np.radians(yaw_deg))
    T_world_body = transforms.from_xyz_yaw([-2.0, 0.0, 2.0], 0.0)
    for name, T in (("uav1", T_world_body), ("robot", T_world_robot)):
        TruthWriter(tmp_path, name).write(10.0, T, np.zeros(3))
    shot = camera.photograph(10.0, 3)
    detector = TagDetector({i: t.size_m for i, t in tags.items()}, ON_BOARD_DECIMATE, sharp=True)
    found = detector.detect(cv2.cvtColor(shot.rgb, cv2.COLOR_RGB2GRAY), camera.model)
    seen = [SeenTag(o.id, o.size_m, o.corners_normalized, o.T_cam_tag[:3, 3]) for o in found]
    sight = RobotSight("uav1", 10.0, shot.T_world_cam, SURE, camera.model.fx, seen)
    fix = tag_fix(sight, tags, np.radians(25.0))
    off = np.array([fix.x_m, fix.y_m]) - T_world_robot[:2, 3]
    assert off @ np.linalg.solve(fix.covariance[:2, :2], off) < 11.8  # chi2, 3 sigma
    assert np.hypot(*off) < 0.3
    if np.isfinite(fix.covariance[2, 2]):
        turned = rotations.wrap(fix.yaw_rad - np.radians(yaw_deg))
        assert abs(turned) < 3 * fix.covariance[2, 2] ** 0.5
    assert load_vehicles(folder, ["uav1"])["uav1"].tag_id not in tags
