# SPDX-License-Identifier: Apache-2.0
"""Where vehicles would have to look from, so that a robot's way becomes known: a place, a heading
and baselines, as a mission.

What is known of the ground hides what lies behind it; what is not known hides nothing, as far as
anybody can say.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import List, Optional, Tuple

import cv2
import numpy as np

from fcsv_geometry import config
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.programs.writing import write_whole
from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.robot import Robot
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.planning.mission import configuration_lines, mission_document
from fcsv_stereo.planning.plan import Plan, PlanRequest, make_plan

#: (m) from what is looked at, and above the ground, of places that are tried. Beyond 42 m, from
#: 10 m above, rows of pixels lie 0.3 m apart on the ground.
_FROM_M = ((24.0, 8.0), (28.0, 10.0), (31.0, 10.0), (36.0, 14.0), (40.0, 18.0))
_REACH_M = 42.0
_HEADINGS = 24
_MOST_CELLS = 400  # that are looked at; more are thinned out
_AROUND_M = 0.25  # what must be seen beside a footprint
_STEP_M = 0.1  # along a line of sight
_HIDES_M = 0.05  # a line of sight passes so far above what does not hide it
_MARGIN_PX, _LEFT_SHARE = 10.0, 0.08  # the left edge is not in the other camera's picture
_ERROR_M = 0.5  # of depth at the farthest cell, which the baselines are planned for
_BASELINES, _SHORTEST_M = 3, 2.0
_OTHERS_CELLS = 1e-3  # weight of how near the place is, per m, against the share of cells seen


@dataclass(frozen=True)
class LookFrom:
    """Where the reference vehicle is to hold: ``p_home_cam`` (3,) m, ``yaw_rad`` of its heading in
    home, ``above_m`` the ground that it looks at; ``sees`` is the share of the cells that it would
    see, between ``nearest_m`` and ``farthest_m``; ``plan`` has the baselines."""

    p_home_cam: np.ndarray
    yaw_rad: float
    above_m: float
    sees: float
    nearest_m: float
    farthest_m: float
    plan: Plan

    def in_words(self) -> str:
        """One line for whoever brings the reference there."""
        x, y, z = self.p_home_cam
        turned = np.degrees(self.yaw_rad)
        side = "left" if turned >= 0 else "right"
        return (
            f"look from ({x:.1f}, {y:.1f}) m, {z:+.1f} m from home's height ({self.above_m:.0f} m above the "
            f"ground there), heading {abs(turned):.0f} deg to the {side} of home's x: it shows "
            f"{self.sees:.0%} of the cells that must be seen, {self.nearest_m:.0f} to {self.farthest_m:.0f} m away"
        )


def look_from(
    ground: Ground, robot: Robot, to_see: np.ndarray, view: DepthView
) -> Optional[LookFrom]:
    """The place that shows most of the cells ``to_see`` (N,2) rows and columns, as the footprint
    of ``robot`` needs them, to the camera of ``view``; None where no place shows one.

    Raises GroundError where there is no cell to see.
    """
    targets = _targets(ground, robot, to_see)
    camera = view.camera
    heights = np.where(ground.known, ground.high_m, -np.inf)
    level_m = _level_m(ground, targets)
    points = np.column_stack([ground.grid.middle_of(*targets.T), np.full(len(targets), level_m)])
    was_m = view.T_home_cam[:2, 3]
    best, best_rated = None, 0.0
    for p_home_cam, yaw_rad in _places(points, level_m):
        seen = _pictured(points, p_home_cam, yaw_rad, camera)
        if not seen.any():
            continue
        seen[seen] &= nothing_hides(ground, heights, points[seen], p_home_cam)
        nearer = _OTHERS_CELLS * float(np.hypot(*(p_home_cam[:2] - was_m)))
        rated = float(seen.mean()) - nearer
        if seen.any() and (best is None or rated > best_rated):
            best, best_rated = (p_home_cam, yaw_rad, seen), rated
    return None if best is None else _planned(*best, points, level_m, camera)


def write_look_from(found: LookFrom, path: Path, maps: Tuple[str, ...] = ()) -> None:
    """The mission file of one place; ``maps`` are those in whose home it is. Raises GroundError
    where it cannot be flown, OSError where the disk does not take it."""
    document = mission_document(found.plan, path.stem)
    document["home_height_m"] = round(found.above_m, 1)
    try:
        config.from_mapping(document, Mission, str(path))
    except ConfigError as error:
        raise GroundError(f"{path}: the place cannot be flown: {error}") from error
    head = ["# Where to look from, so that the robot's way becomes known (fcsv_guidance ground).\n"]
    head.append(f"# Bring the reference there before home is set: {found.in_words()}.\n")
    head += [f"# In the home of {name}.\n" for name in maps]
    fields = [f"name: {document['name']}\n", f"home_height_m: {document['home_height_m']}\n"]
    write_whole(path, "".join([*head, *fields, *configuration_lines(document)]))


def next_commands(path: Path) -> List[str]:
    """What to do with it, as commands to paste."""
    return [
        f"judge it:             rosrun fcsv_control check {path} --vehicles uav1,uav2",
        f"rehearse it:          rosrun fcsv_sim rehearse {path}",
        f"fly it with vehicles: docs/user/flying.md, with mission:={path.resolve()}",
    ]


def _targets(ground: Ground, robot: Robot, to_see: np.ndarray) -> np.ndarray:
    """(N,2) rows and columns: what is not known below footprints in the cells."""
    if not len(to_see):
        raise GroundError("no cell would have to be seen: what is known closes every way")
    wanted = np.ones(ground.grid.shape, np.uint8)
    wanted[tuple(np.asarray(to_see).T)] = 0
    away_m = cv2.distanceTransform(wanted, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * ground.grid.cell_m
    missing = np.argwhere((away_m <= robot.radius_m + _AROUND_M) & ~ground.known)
    missing = missing if len(missing) else np.asarray(to_see)
    return missing[:: max(1, len(missing) // _MOST_CELLS)]


def _level_m(ground: Ground, targets: np.ndarray) -> float:
    """Height of the known ground about the cells, in home."""
    low, high = targets.min(0) - 50, targets.max(0) + 51
    near = ground.low_m[max(0, low[0]) : high[0], max(0, low[1]) : high[1]]
    near = near if np.isfinite(near).any() else ground.low_m
    return float(np.nanpercentile(near, 25))


def _places(points: np.ndarray, level_m: float):
    """Places (3,) that look at the cells' middle and at their first and last third, from all
    sides; with the heading."""
    along = np.linalg.svd(points[:, :2] - points[:, :2].mean(0), full_matrices=False)[2][0]
    spots = np.percentile(points[:, :2] @ along, (17, 50, 83))
    middle = points[:, :2].mean(0)
    for spot in spots:
        at = middle + (spot - middle @ along) * along
        for yaw_rad in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS - np.pi:
            ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
            for far_m, above_m in _FROM_M:
                yield np.array([*(at - far_m * ahead), level_m + above_m]), float(yaw_rad)


def _pictured(points, p_home_cam, yaw_rad: float, camera: PinholeCamera) -> np.ndarray:
    """(N,) bool: whether the picture of a level camera holds them, so near that they are
    mapped."""
    off = points - p_home_cam
    ahead = off[:, 0] * np.cos(yaw_rad) + off[:, 1] * np.sin(yaw_rad)
    right = off[:, 0] * np.sin(yaw_rad) - off[:, 1] * np.cos(yaw_rad)
    z = np.maximum(ahead, 1e-3)
    u, v = camera.fx * right / z + camera.cx, camera.fy * -off[:, 2] / z + camera.cy
    inside = (u > _LEFT_SHARE * camera.width) & (u < camera.width - _MARGIN_PX)
    inside &= (v > 0) & (v < camera.height - _MARGIN_PX)
    above_m = float(p_home_cam[2] - points[0, 2])
    return inside & (ahead > 1.0) & (ahead < max(_REACH_M, _REACH_M * np.sqrt(above_m / 10.0)))


def nothing_hides(
    ground: Ground, heights: np.ndarray, points: np.ndarray, p_home_cam: np.ndarray
) -> np.ndarray:
    """(N,) bool: whether nothing known hides ``points`` (N,3) from a camera (3,), all in home (m).
    ``heights`` (rows, columns): up to where the ground hides, -inf where it is unknown."""
    highest_m = float(np.max(heights, initial=-np.inf))
    rise_m = p_home_cam[2] - points[:, 2]
    flat = np.hypot(*(p_home_cam[:2] - points[:, :2]).T)
    # above what is highest nothing hides
    need_m = np.clip((highest_m - points[:, 2]) / rise_m, 0.0, 1.0) * flat
    along = np.arange(2 * _STEP_M, max(float(need_m.max()), 0.3), _STEP_M)
    shares = along / flat[:, None]
    xy = points[:, None, :2] + shares[..., None] * (p_home_cam[:2] - points[:, :2])[:, None]
    z = points[:, None, 2] + shares * rise_m[:, None]
    row, column, inside = ground.grid.cells_of(xy[..., 0], xy[..., 1])
    hides = inside & (shares < 1.0) & (heights[row, column] > z + _HIDES_M)
    return ~hides.any(1)


def _planned(p_home_cam, yaw_rad, seen, points, level_m: float, camera) -> LookFrom:
    ahead = (points - p_home_cam)[seen][:, :2] @ [np.cos(yaw_rad), np.sin(yaw_rad)]
    nearest_m, farthest_m = float(ahead.min()), float(ahead.max())
    range_m = float(np.ceil(farthest_m))
    request = PlanRequest(range_m, ErrorThreshold(_ERROR_M, False), camera, count=1, whole=True)
    longest_m = make_plan(request).baselines[-1].baseline_m
    lengths_m = {max(_SHORTEST_M, round(longest_m * k / _BASELINES)) for k in (1, 2, 3)}
    plan = make_plan(replace(request, count=None, baselines_m=sorted(lengths_m)))
    above_m = float(p_home_cam[2] - level_m)
    return LookFrom(p_home_cam, yaw_rad, above_m, float(seen.mean()), nearest_m, farthest_m, plan)
