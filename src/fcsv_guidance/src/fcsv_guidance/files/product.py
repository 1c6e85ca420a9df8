# SPDX-License-Identifier: Apache-2.0
"""What ``map`` and ``survey`` call by name for ``--products ground``
(fcsv_stereo.products.ground)."""

from pathlib import Path
from typing import Callable, Sequence, Tuple

import numpy as np

from fcsv_guidance.files.folder import PICTURE, GroundOptions, write_ground
from fcsv_guidance.ground.site_views import SiteDepthViews, SitePlace
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.robot import load_robot
from fcsv_stereo.model import MapResult
from fcsv_stereo.posed.local_origin import moved
from fcsv_stereo.survey.surface.merge import SiteView

__all__ = ["load_robot", "write", "write_site"]
VOXEL_M, SITE_VOXEL_M = 0.2, 0.5


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
    robot = load_robot(robot_file)
    written = write_ground([view], robot, folder, GroundOptions.of_robot(robot, voxel_m=VOXEL_M))
    return written.summary, Path(folder) / PICTURE


def write_site(
    names: Sequence[str],
    load: Callable[[int], SiteView],
    place: Tuple[str, np.ndarray],
    robot_file: Path,
    folder: Path,
) -> str:
    """A survey's ground for the robot in a file, its OctoMap included, into ``folder``: one line on
    it. ``load`` gives a view by its number; ``place``: reference system, and the origin (3,) that
    views leave out. Raises as ``write``."""
    views, robot = SiteDepthViews(names, load), load_robot(robot_file)
    options = GroundOptions.of_robot(robot, voxel_m=SITE_VOXEL_M)
    return write_ground(views, robot, folder, options, place=SitePlace(*place)).summary
