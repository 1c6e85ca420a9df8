# SPDX-License-Identifier: Apache-2.0
"""Where two vehicles look from so that a robot's ways are seen: stations chosen by what a place's
true heights hide.

The choice knows the truth; what is then called free comes from the pictures alone.
"""

from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.standing import disk, least
from fcsv_guidance.route.search import cheapest
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.caster import make_caster
from fcsv_sim.render.rays import T, ray_buffer, set_rays
from fcsv_sim.robot.places.survey import SURVEY, HoverStation, SurveyRules
from fcsv_sim.world.footing import Clearance
from fcsv_sim.world.town import Town

REACH_M = 42.0  # beyond, from 10 m above, rows of pixels lie 0.3 m apart on the ground
_ROWS_M = 0.37  # so far apart they may lie where one look shall do: the ground takes 0.4 m together
_HEADINGS = 8
_FROM_M = ((31.0, 10.0), (36.0, 14.0))  # distance to what is looked at, height
# of one station that shall do: further back than the nearest that shows the start, and aside
_BACK_M, _ASIDE_M = (2.5, 4.5), (-8.0, -4.0, 0.0, 4.0, 8.0)
_MARGIN_PX = 10.0
# weight of a cell of the shortest way against any other that the robot can come to
_ON_THE_WAY = 8.0
_MARGINS_M = (1.0, 1.5, 2.0, 2.5)  # in way_margin_m


@dataclass(frozen=True)
class LookRules:
    """How well what is called seen must be seen: to ``reach_m``, with ``around_m`` beside a
    footprint, right of the ``left_px`` of the picture that the other camera's lacks. A way keeps
    ``way_margin_m`` beside the footprint, for the errors of map and place; what lies ``way_m``
    beside the shortest is worth most. ``near_m``: nothing hides what a ray comes so near to, and
    ``near_share`` of its length."""

    survey: SurveyRules = SURVEY
    reach_m: float = REACH_M
    cell_m: float = 0.4
    way_margin_m: float = 0.4
    way_m: float = 1.0
    around_m: float = 0.25
    left_px: float = 50.0
    near_m: float = 0.05
    near_share: float = 0.02

    @property
    def camera(self) -> PinholeCamera:
        return self.survey.camera.model


LOOK = LookRules()  # of System III, whose robot knows its place to 0.2 m


@dataclass(frozen=True)
class Looked:
    """Stations, and ``sights`` (N, rows, columns) bool of ``grid``: whether a station sees all that
    lies below a robot's footprint, to the rules' reach."""

    stations: Tuple[HoverStation, ...]
    grid: Grid
    sights: np.ndarray
    way_margin_m: float = LOOK.way_margin_m

    def leads(
        self,
        clear: Clearance,
        start_m,
        goal_m,
        margin_m: float,
        closed: Optional[np.ndarray] = None,
    ) -> bool:
        """Whether a way with so much margin leads from start to goal through footprints that a
        station sees, and not through cells ``closed`` (rows, columns)."""
        xy = self.grid.middle_of(*np.indices(self.grid.shape))
        stands = self.sights.any(0) & (
            clear.at(xy[..., 0], xy[..., 1]) >= clear.robot.radius_m + margin_m
        )
        if closed is not None:
            stands &= ~closed
        _, parts = cv2.connectedComponents(stands.astype(np.uint8), connectivity=4)
        ends = [parts[self.grid.cell_of(*xy)] for xy in (start_m, goal_m)]
        return bool(ends[0] == ends[1] != 0)


class Lookout:
    """Chooses stations of a place one by one: each adds most to what was not seen of the ways that
    the robot has."""

    def __init__(
        self,
        town: Town,
        clear: Clearance,
        rules: LookRules = LOOK,
        candidates: Optional[Sequence[HoverStation]] = None,
    ):
        plan = town.plan
        self.grid = _grid(town, rules)
        self._ends = plan.start_m, plan.goal_m
        self._clear, self._rules = clear, rules
        self._candidates = _candidates(plan) if candidates is None else list(candidates)
        around = disk(clear.robot.radius_m + rules.around_m, rules.cell_m)
        self._sights = [
            least(seen, around, 0.0) > 0 for seen in _seen(town, self.grid, self._candidates, rules)
        ]
        self._worth = _worth(clear, self.grid, plan.start_m, plan.goal_m, rules)
        self._chosen: List[int] = []

    def looked(self) -> Looked:
        """Gives what is seen from what was chosen so far."""
        sights = np.array([self._sights[i] for i in self._chosen]).reshape(-1, *self.grid.shape)
        stations = tuple(self._candidates[i] for i in self._chosen)
        return Looked(stations, self.grid, sights, self._rules.way_margin_m)

    def first(self, least_count: int = 5, most_count: int = 8) -> Looked:
        """Stations until they see a way with the rules' margin beside the footprint, or there are
        ``most_count``."""
        seen = np.zeros(self.grid.shape, bool)
        while len(self._chosen) < most_count:
            if not self._add(self._worth * ~seen):
                break
            seen |= self._sights[self._chosen[-1]]
            enough = len(self._chosen) >= least_count
            if enough and self.looked().leads(self._clear, *self._ends, self._rules.way_margin_m):
                break
        if not self._chosen:
            raise SimulationError(
                "no station sees anything of the place that the robot can come to"
            )
        return self.looked()

    def another(self, free: np.ndarray) -> bool:
        """One station more for what is not yet ``free`` (rows, columns of ``grid``) on the shortest
        way; whether there is one."""
        return self._add(
            np.where(self._worth >= _ON_THE_WAY, self._worth, 0.1 * self._worth) * ~free
        )

    def _add(self, worth: np.ndarray) -> bool:
        gains = [float(worth[sight].sum()) for sight in self._sights]
        for i in self._chosen:
            gains[i] = 0.0
        best = int(np.argmax(gains))
        if gains[best] <= 0.0:
            return False
        self._chosen.append(best)
        return True


def first_look(town: Town, clear: Clearance, height_m: float) -> Tuple[HoverStation, bool]:
    """The one station ``height_m`` above the ground, looking along x, that sees the roomiest way
    from start to goal, else most of what the robot can come to; and whether it sees a way with
    LOOK's margin beside the footprint."""
    plan, grid = town.plan, _grid(town, LOOK)
    camera = LOOK.camera
    # where the lowest row of the picture shows the ground
    nearest_m = height_m * camera.fy / (camera.height - 1 - _MARGIN_PX - camera.cy)
    x_m = plan.start_m[0] - clear.robot.radius_m - LOOK.around_m - nearest_m
    stations = [
        HoverStation(
            (float(x_m - back_m), float(y_m), float(plan.height(x_m, y_m)) + height_m), 0.0
        )
        for back_m in _BACK_M
        for y_m in sorted({*_ASIDE_M, plan.start_m[1], plan.goal_m[1]}, key=abs)
    ]
    worth = _worth(clear, grid, plan.start_m, plan.goal_m, LOOK)
    rules = replace(LOOK, reach_m=float(np.sqrt(_ROWS_M * height_m * camera.fy)))
    rated, margins_m = [], [share * LOOK.way_margin_m for share in _MARGINS_M]
    for station, seen in zip(stations, _seen(town, grid, stations, rules)):
        leads_m = (m for m in margins_m if _leads(town, clear, grid, station, seen, m))
        rated.append((max(leads_m, default=0.0), float((worth * seen).sum()), station))
    margin_m, _, station = max(rated, key=lambda each: each[:2])
    return station, margin_m > 0.0


def _leads(town: Town, clear: Clearance, grid: Grid, station: HoverStation, seen, margin_m) -> bool:
    """Whether a way keeps ``margin_m`` from what stops the robot, and from what is hidden."""
    sight = least(seen, disk(clear.robot.radius_m + margin_m, grid.cell_m), 0.0) > 0
    ends = town.plan.start_m, town.plan.goal_m
    return Looked((station,), grid, sight[None]).leads(clear, *ends, margin_m)


def _grid(town: Town, rules: LookRules) -> Grid:
    x0, x1, y0, y1 = town.plan.area_m
    return Grid.around((x0, y0), (x1, y1), rules.cell_m)


def _candidates(plan) -> List[HoverStation]:
    """Places that look at nine spots of the area and at start and goal, from eight sides."""
    x0, x1, y0, y1 = plan.area_m
    spots = [(x, y) for x in np.linspace(x0, x1, 5)[1:4] for y in np.linspace(y0, y1, 5)[1:4]]
    found = []
    for x, y in [*spots, plan.start_m, plan.goal_m]:
        for yaw in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS:
            for far, high in _FROM_M:
                at = (float(x - far * np.cos(yaw)), float(y - far * np.sin(yaw)))
                found.append(HoverStation((*at, float(plan.height(*at)) + high), float(yaw)))
    return found


def _worth(clear: Clearance, grid: Grid, start_m, goal_m, rules: LookRules) -> np.ndarray:
    """(rows, columns) of what it is worth to see a cell: 0 where the robot can come neither from
    start nor goal."""
    xy = grid.middle_of(*np.indices(grid.shape))
    far = clear.at(xy[..., 0], xy[..., 1])
    stands = far >= clear.robot.radius_m
    _, parts = cv2.connectedComponents(stands.astype(np.uint8), connectivity=4)
    ends = [grid.cell_of(*at) for at in (start_m, goal_m)]
    worth = (stands & np.isin(parts, [parts[end] for end in ends if stands[end]])).astype(float)
    way = cheapest(np.where(stands, 1.0 + 1.0 / np.maximum(far, 0.1), np.inf), *ends)
    if way is not None:
        near = np.zeros(grid.shape, np.uint8)
        near[tuple(way.T)] = 1
        worth[(cv2.dilate(near, disk(rules.way_m, grid.cell_m)) > 0) & stands] = _ON_THE_WAY
    for end in ends:
        worth[tuple(slice(max(0, i - 2), i + 3) for i in end)] += 5 * _ON_THE_WAY
    return worth


def _seen(town: Town, grid: Grid, stations: Sequence[HoverStation], rules: LookRules):
    """Gives, for each station (rows, columns) float32, 1 where nothing hides the ground from it."""
    camera = rules.camera
    xy = grid.middle_of(*np.indices(grid.shape)).reshape(-1, 2)
    points = np.column_stack([xy, town.plan.drawn_height(*xy.T)])
    caster, rays = make_caster(town.vertices, town.triangles, 1), ray_buffer(len(points))
    for station in stations:
        T_world_cam = station.T_world_body @ rules.survey.T_body_cam
        off = points - T_world_cam[:3, 3]
        p_cam = off @ T_world_cam[:3, :3]
        z = np.maximum(p_cam[:, 2], 1e-3)
        u, v = camera.fx * p_cam[:, 0] / z + camera.cx, camera.fy * p_cam[:, 1] / z + camera.cy
        pictured = (p_cam[:, 2] > 1.0) & (u > rules.left_px) & (u < camera.width - _MARGIN_PX)
        pictured &= (v > 0) & (v < camera.height - _MARGIN_PX) & (p_cam[:, 2] < rules.reach_m)
        length = np.linalg.norm(off, axis=1)
        set_rays(rays, np.tile(T_world_cam[:3, 3], (len(points), 1)), off / length[:, None])
        caster.cast(rays)
        open_ = rays[:, T] > length - rules.near_m - rules.near_share * length
        yield (pictured & open_).reshape(grid.shape).astype(np.float32)
