# SPDX-License-Identifier: Apache-2.0
"""What a mission says of the air, as lines and places in home that can be drawn."""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np
import yaml

from fcsv_geometry import config, strict_yaml
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.camera_places import mover_end, mover_place
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.mission import Mission

_SIDES = 48  # of the fence's circle
_POSTS = 8


@dataclass(frozen=True)
class PlannedPlace:
    """Is the place of configuration ``index``: a pose of the moving camera, 4x4; of a sweep where
    it begins and ``end_m`` (3,)."""

    index: int
    T_home_cam: np.ndarray
    end_m: Optional[np.ndarray] = None


def read_mission(text: str) -> Mission:
    """Reads a mission from a mission file's text as the mission node tells it. Raises
    ConfigError."""
    try:
        document = strict_yaml.parse(text)
    except yaml.YAMLError as error:
        problem = str(getattr(error, "problem", None) or error).replace("\n", " ")
        raise ConfigError(f"/mission/file: not YAML: {problem}") from error
    return config.from_mapping(document, Mission, "/mission/file")


def fence_lines(fence: Fence, home_height_m: float) -> np.ndarray:
    """(N, 2, 3) ends of lines in home (m): the circle and the polygon at the floor and at the
    ceiling, with posts.

    The fence's heights are above the take-off place, and home is ``home_height_m`` above it.

    >>> lines = fence_lines(Fence(floor_m=1.0, ceiling_m=40.0, radius_m=60.0), 8.0)
    >>> lines.shape, sorted({float(z) for z in lines[..., 2].ravel()})
    ((104, 2, 3), [-7.0, 32.0])
    """
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    circle = fence.radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
    heights_m = (fence.floor_m - home_height_m, fence.ceiling_m - home_height_m)
    lines = _walls(circle, circle[:: _SIDES // _POSTS], heights_m)
    if fence.polygon:
        corners = np.array(fence.polygon, float)
        lines += _walls(corners, corners, heights_m)
    return np.array(lines)


def _walls(
    ring: np.ndarray, posts: np.ndarray, heights_m: Sequence[float]
) -> List[List[Tuple[float, float, float]]]:
    lines = []
    for z in heights_m:
        for a, b in zip(ring, np.roll(ring, -1, axis=0)):
            lines.append([(a[0], a[1], z), (b[0], b[1], z)])
    return lines + [[(x, y, heights_m[0]), (x, y, heights_m[1])] for x, y in posts]


def planned_places(mission: Mission) -> List[PlannedPlace]:
    """Gives the places of every configuration, in the order of the list.

    >>> text = "name: a\\nconfigurations:\\n  - {axis: horizontal, baseline_m: 4.0}\\n"
    >>> [(p.index, p.T_home_cam[:3, 3].tolist()) for p in planned_places(read_mission(text))]
    [(0, [0.0, -4.0, 0.0])]
    """
    return [
        PlannedPlace(
            i, mover_place(mission, i), None if c.sweep is None else mover_end(mission, i)[:3, 3]
        )
        for i, c in enumerate(mission.configurations)
    ]
