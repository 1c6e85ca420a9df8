# SPDX-License-Identifier: Apache-2.0
"""What ``map --products ground`` calls by name (fcsv_stereo.products.ground)."""

from pathlib import Path
from typing import Tuple

from fcsv_guidance.ground_folder import PICTURE, GroundOptions, write_ground
from fcsv_guidance.robot import load_robot
from fcsv_guidance.views import DepthView
from fcsv_stereo.model import MapResult
from fcsv_stereo.posed.local_origin import moved

__all__ = ["load_robot", "write"]
VOXEL_M = 0.2


def write(result: MapResult, robot_file: Path, folder: Path) -> Tuple[str, Path]:
    """A map's ground for the robot in a file, its OctoMap included, into ``folder``: one line on
    it, and its picture.

    Raises GuidanceError where the map has no ground, ConfigError naming file and field of the
    robot.
    """
    reference = result.reference
    T_home_cam = moved(reference.T_home_cam, result.origin_m)
    view = DepthView(
        reference.name,
        result.depth,
        result.sigma,
        result.kind,
        reference.camera.K,
        T_home_cam,
        reference.stamp_s,
    )
    written = write_ground([view], load_robot(robot_file), folder, GroundOptions(voxel_m=VOXEL_M))
    return written.summary, Path(folder) / PICTURE
