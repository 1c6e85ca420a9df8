# SPDX-License-Identifier: Apache-2.0
"""What others are told of the ground: grids and what changed in them, routes, and why there is
none.

A port: messages and time in, what is to be published out. It takes maps as they come; views that
watch the place take their freedom back where something changed.
"""

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Deque, List, Optional, Sequence, Tuple, Union

import numpy as np

from fcsv_geometry.config import require_positive
from fcsv_guidance.clock import ahead_of_clock
from fcsv_guidance.errors import EndNotSeenError, GroundError, RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import standing, tuning
from fcsv_guidance.ground.fitting import require_one_frame
from fcsv_guidance.ground.known import STILL_S, GroundSeen, KnownGround, watch_seen
from fcsv_guidance.ground.model import (
    LAYERS,
    Ground,
    cell_probability,
    ground_from,
    window_of,
    within,
)
from fcsv_guidance.ground.occupancy import occupancy, percents_of
from fcsv_guidance.ground.own_pixels import robot_pixels
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.messages import Goal, OwnVehicle, RobotPlace
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.following import Polyline
from fcsv_guidance.route.grid_regions import Region, changed_region
from fcsv_guidance.route.planning import RouteRules, plan_clear, with_room
from fcsv_guidance.route.search import NO_ROUTE_KNOWN, NoRoute, Route
from fcsv_stereo.depth import pixels_of

_MOST_NAMED = 5  # cells in a sentence
_JUDGED_M = 0.4  # beyond a radius: how far a cell has to do with whether another is an obstacle
_STANDS_M = 0.15  # a place that moves by less may be noise
_OWN_VEHICLE_M, _OWN_VEHICLE_S = 1.2, 0.7  # its size, and how far it flies until then


@dataclass(frozen=True)
class MapSeen:
    """A finished map, in place of one of the same name and stamp, or with ``live`` the newest state
    of one that grows: it watches the place where there are finished maps. ``watching``: what
    vehicles that hold see now. ``others``: finished maps that came with it, which are laid at
    once."""

    view: DepthView
    live: bool = False
    watching: bool = False
    others: Tuple[DepthView, ...] = ()


@dataclass(frozen=True)
class GoalDropped:
    """The robot shall go nowhere, for this reason."""

    reason: str


@dataclass(frozen=True)
class GridMessage:
    """The whole grid: percents (rows, columns) int8 of ``ground.occupancy``, and of where the
    robot can stand with its middle. ``stamp_s``: of the newest picture in it, -inf where none is
    dated."""

    stamp_s: float
    grid: Grid
    occupied: np.ndarray
    stands: np.ndarray


@dataclass(frozen=True)
class GridChanged:
    """What changed since; 1 x 1 cells where only the stamp did."""

    stamp_s: float
    occupied: Region
    stands: Region


@dataclass(frozen=True)
class RouteMessage:
    """A route from where the robot is to its goal, (N,2) in home."""

    points_home_m: np.ndarray


@dataclass(frozen=True)
class NoRouteMessage:
    """There is none: the reason, and the middles (N,2) in home of the cells that would have to be
    seen first. ``waits``: for a map, a goal, or the robot's place; the ground says nothing yet."""

    reason: str
    to_see_m: np.ndarray
    waits: bool = False


@dataclass(frozen=True)
class RobotHold:
    """The robot shall stand where it is for this reason, and keep its route; empty: no more.
    ``asks``: until somebody looked and gives the goal again."""

    reason: str
    asks: bool = False


@dataclass(frozen=True)
class GroundRules:
    """How the ground is laid, and when a route is planned anew. ``watched``: the grids are as old as
    the last view that watches, not as their maps. The robot is held while something came near in
    the last ``still_s``, or came up to it and was not seen to leave."""

    cell_m: float = 0.1
    reach_m: float = 60.0  # of the grid, from the first maps' cameras
    # x0, x1, y0, y1 of the grid in place of that
    area_m: Optional[Tuple[float, float, float, float]] = None
    replan_s: float = 1.0  # least time between two plans
    off_m: float = 0.4  # beside its route the robot gets another
    goal_m: float = 0.3  # so near the goal it is reached
    # until another plan, of a robot that stands on its route or has none: its place changes, too
    retry_s: float = 5.0
    oldest_place_s: float = 2.0  # without a newer one nobody knows where the robot is
    watched: bool = False
    still_s: float = STILL_S
    route: RouteRules = field(default_factory=RouteRules)

    def __post_init__(self):
        require_positive(self)
        if self.area_m is None:
            return
        x0, x1, y0, y1 = self.area_m
        if not (x0 < x1 and y0 < y1):
            raise ValueError(
                f"area_m: must be x0, x1, y0, y1 with x0 < x1, y0 < y1, got {self.area_m}"
            )
        try:
            Grid.around((x0, y0), (x1, y1), self.cell_m)
        except GroundError as error:
            raise ValueError(f"area_m: {error}") from error


GroundMessage = Union[GridMessage, GridChanged, RouteMessage, NoRouteMessage, RobotHold]


class GroundServer:
    """The ground that ``robot`` drives on. Raises GroundError where cells are too large for it."""

    def __init__(self, robot: Robot, rules: GroundRules = GroundRules()):
        standing.require_fine_cells(rules.cell_m, robot, "cell_m")
        self._robot, self._rules = robot, rules
        self._views: List[DepthView] = []
        self._live: Optional[DepthView] = None
        self._taken: List[DepthView] = []  # of which the maps' ground was laid
        self._known = KnownGround(robot)
        # what the maps show together, and the same with what watching views show in its place
        self._mapped: Optional[Ground] = None
        self._ground: Optional[Ground] = None
        self._alone: Optional[np.ndarray] = None  # cell_probability of that
        self._stands: Optional[np.ndarray] = None
        self._whole_grid: Optional[GridMessage] = None
        self._place: Optional[RobotPlace] = None
        self._placed_s = -np.inf  # when that came
        self._places: Deque[RobotPlace] = deque(maxlen=200)
        self._vehicles: Deque[OwnVehicle] = deque(maxlen=100)
        # where it was when it last moved, and since when it stands there
        self._stood: Tuple[float, float, float] = (np.inf, np.inf, -np.inf)
        self._goal: Optional[Goal] = None
        self._route: Optional[Route] = None
        # freedom and time of the last plan
        self._planned = (-1, -np.inf)
        self._waits_for_place, self._none_reason, self._held = False, "", RobotHold("")
        self._out: List[GroundMessage] = []

    @property
    def whole_grid(self) -> Optional[GridMessage]:
        """The whole grid as it is now; None before the first map."""
        return self._whole_grid

    @property
    def ground(self) -> Optional[Ground]:
        """None before the first map."""
        return self._ground

    @property
    def eye_m(self) -> Optional[np.ndarray]:
        """(3,) in home: of the camera of the newest live or watching view; None without."""
        return None if self._live is None else self._live.T_home_cam[:3, 3]

    @property
    def known(self) -> KnownGround:
        """Where the robot can stand."""
        return self._known

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known, RouteError where a goal is
        not finite, GroundError where a map shows no ground."""
        if isinstance(message, MapSeen):
            self._on_map(message)
        elif isinstance(message, RobotPlace):
            self._on_place(now_s, message)
        elif isinstance(message, OwnVehicle):
            self._vehicles.append(message)
        elif isinstance(message, Goal):
            message.require_finite()
            self._known.beside.forget(now_s)
            self._goal, self._route, self._planned = message, None, (-1, -np.inf)
            self._none_reason = ""
        elif isinstance(message, GoalDropped):
            if self._goal is not None:
                self._out.append(NoRouteMessage(message.reason, np.empty((0, 2)), True))
            self._goal = self._route = None
        else:
            raise TypeError(f"a ground server does not know {type(message).__name__}")

    def pending(self) -> Sequence[GroundMessage]:
        """What is to be published before a route is planned: the robot stops by it."""
        out, self._out = self._out, []
        return out

    def step(self, now_s: float) -> Sequence[GroundMessage]:
        """What is to be published now."""
        self._forget_what_lies_ahead(now_s)
        if self._goal is not None and self._wants_plan(now_s):
            self._planned = (self._known.version, now_s)
            said = self._planned_route(now_s)
            if isinstance(said, RouteMessage) or said.reason != self._none_reason:
                self._out.append(said)
            self._none_reason = said.reason if isinstance(said, NoRouteMessage) else ""
        self._hold(now_s)
        return self.pending()

    def plan(self, start_m, goal_m, tolerance_m: float = 0.0) -> Union[Route, NoRoute]:
        """A route between two places of home, or why there is none; the goal may move by
        ``tolerance_m`` where no robot can stand on it. It keeps clear by the sigma of the robot's
        place, where that is known.

        Raises RouteError where start, goal or tolerance is none, before the first map too.
        """
        if not 0.0 <= tolerance_m < np.inf:
            raise RouteError(f"the tolerance ({tolerance_m}) is none; give 0 or more (m)")
        Goal(*goal_m).require_finite()
        if self._ground is None:
            raise RouteError(f"{NO_ROUTE_KNOWN}: no map has come")
        sigma_m = 0.0 if self._place is None else self._place.sigma_m
        grid, rules = self._ground.grid, self._rules.route
        if tolerance_m > 0:
            free = self._stands >= tuning.FREE_P
            roomy = free & (grid.clear_m(free) > rules.keeps_m(sigma_m))
            goal_m = with_room(grid, roomy, goal_m, tolerance_m)
        return plan_clear(grid, self._stands, tuple(start_m), tuple(goal_m), sigma_m, rules)

    def in_words(self, found: NoRoute) -> NoRouteMessage:
        """Its reason with the first of the cells that would have to be seen, and all of them."""
        return _in_words(found.reason, self._ground.grid.middle_of(*found.to_see.T))

    # ---- maps ------------------------------------------------------------------------------------

    def _on_map(self, seen: MapSeen) -> None:
        if seen.watching or (seen.live and self._views):
            self._on_watch(seen.view)
            return
        new = [seen.view, *seen.others]
        same = {(v.name, v.stamp_s) for v in new}
        others = [v for v in self._views if (v.name, v.stamp_s) not in same]
        views = self._views if seen.live else [*others, *new]
        live = seen.view if seen.live else self._live
        taken = views or [live]
        ground = ground_from(taken, self._rules.cell_m, self._grid(), self._rules.reach_m)
        if seen.others:
            require_one_frame(ground)
        known = self._known
        # else what was seen to change stays
        if known.grid != ground.grid or not (seen.live or self._views):
            known = KnownGround(self._robot)
            known.version = self._known.version
        stamps = [view.stamp_s if np.isfinite(view.stamp_s) else 0.0 for view in taken]
        alone = zip(stamps, taken, ground.maps or (ground,))
        known.receive_maps([GroundSeen(stamp_s, view.name, each) for stamp_s, view, each in alone])
        self._views, self._live, self._known, self._taken = views, live, known, taken
        self._mapped = self._ground = ground
        self._alone = cell_probability(ground, self._robot)
        self._update_grid()

    def _grid(self) -> Optional[Grid]:
        if self._rules.area_m is not None:
            x0, x1, y0, y1 = self._rules.area_m
            return Grid.around((x0, y0), (x1, y1), self._rules.cell_m)
        return self._ground.grid if self._ground is not None and not self._views else None

    def _on_watch(self, view: DepthView) -> None:
        """Compares a view with the maps; a robot whose place is not known would be a thing that
        came."""
        if self._known.grid is None:
            raise GroundError(f"{view.name}: watches a place that has no map yet")
        if not self._places:
            raise GroundError(f"{view.name}: the robot's place is not known, which it may show")
        near = min(self._places, key=lambda p: abs(p.stamp_s - view.stamp_s))
        for own in self._vehicles:
            if abs(own.stamp_s - view.stamp_s) < _OWN_VEHICLE_S:
                view = view.without(own.p_home_m, _OWN_VEHICLE_M)
                self._require_shown(view, near, own)
        z_m = self._ground_z_m(near)
        own = robot_pixels(view, near, self._robot, z_m) if np.isfinite(z_m) else None
        seen = watch_seen(view, self._taken, self._known.grid, own)
        new, freedom = seen.ground, self._known.version
        self._known.receive(seen, near)
        self._live = view
        if self._known.version == freedom:
            self._whole_grid = replace(self._whole_grid, stamp_s=self._stamp_s())
            same = Region(0, 0, self._whole_grid.occupied[:1, :1])
            stands = Region(0, 0, self._whole_grid.stands[:1, :1])
            self._out.append(GridChanged(self._whole_grid.stamp_s, same, stands))
            return
        changed = self._known.changed
        shown, was = changed & new.known, self._ground.height_m
        layers = {}
        for name in LAYERS:
            before = np.where(changed, getattr(self._ground, name), getattr(self._mapped, name))
            layers[name] = np.where(shown, getattr(new, name), before)
        self._ground = replace(self._mapped, **layers)
        with np.errstate(invalid="ignore"):
            other = (self._ground.height_m != was) & (changed | np.isfinite(was))
        self._renew_obstacles(other | changed)
        self._update_grid()

    def _ground_z_m(self, place: RobotPlace) -> float:
        """Height of the maps' ground below the robot, in home; NaN where it is not known."""
        row, column, inside = self._known.grid.cells_of(place.x_m, place.y_m)
        return float(self._mapped.height_m[row, column]) if inside else float("nan")

    def _require_shown(self, view: DepthView, place: RobotPlace, own: OwnVehicle) -> None:
        """Raises GroundError where a vehicle of ours hides the robot: nobody watches it then."""
        z_m = self._ground_z_m(place)
        if not np.isfinite(z_m):
            return
        robot_m = np.array([[place.x_m, place.y_m, z_m + 0.5 * self._robot.height_m]])
        (row,), (column,), _, (shown,) = pixels_of(view.camera, view.T_home_cam, robot_m)
        to_robot, to_own = (
            robot_m[0] - view.T_home_cam[:3, 3],
            own.p_home_m - view.T_home_cam[:3, 3],
        )
        near = to_own @ to_robot < to_robot @ to_robot
        if shown and near and view.hides(row, column, own.p_home_m, _OWN_VEHICLE_M):
            raise GroundError(f"{view.name}: {own.vehicle} hides the robot: nobody watches it")

    def _renew_obstacles(self, cells: np.ndarray) -> None:
        """Obstacles anew, where ``cells`` (rows, columns) matter."""
        if not cells.any():
            return
        reach = int(np.ceil((self._robot.radius_m + _JUDGED_M) / self._ground.grid.cell_m))
        inner, outer = window_of(cells, reach), window_of(cells, 2 * reach)
        new = cell_probability(self._ground.part(outer), self._robot)
        self._alone = self._alone.copy()
        self._alone[inner] = new[within(outer, inner)]

    def _stamp_s(self) -> float:
        """When the grids were seen last."""
        if self._rules.watched:
            return self._known.oldest_watch_s
        stamps = [view.stamp_s for view in (*self._views, self._live) if view is not None]
        return max([s for s in stamps if np.isfinite(s)], default=-np.inf)

    def _update_grid(self) -> None:
        ground, stands, stamp_s = self._ground, self._known.stands, self._stamp_s()
        now = GridMessage(
            stamp_s,
            ground.grid,
            occupancy(ground, self._robot, stands, self._alone),
            percents_of(stands),
        )
        before, self._whole_grid, self._stands = self._whole_grid, now, stands
        if before is None or before.grid != now.grid:
            self._out.append(now)
            return
        unchanged = Region(0, 0, now.occupied[:1, :1]), Region(0, 0, now.stands[:1, :1])
        occupied = changed_region(before.occupied, now.occupied) or unchanged[0]
        self._out.append(
            GridChanged(
                stamp_s, occupied, changed_region(before.stands, now.stands) or unchanged[1]
            )
        )

    # ---- routes ----------------------------------------------------------------------------------

    def _on_place(self, now_s: float, place: RobotPlace) -> None:
        x_m, y_m, _ = self._stood
        if not np.hypot(place.x_m - x_m, place.y_m - y_m) <= _STANDS_M:
            self._stood = (place.x_m, place.y_m, now_s)
        self._place, self._placed_s = place, now_s
        self._places.append(place)

    def _known_place(self, now_s: float) -> Optional[RobotPlace]:
        """Where the robot is; None where that was never known, or is no more."""
        if ahead_of_clock(now_s, self._placed_s):
            return None  # the clock was set back since
        return self._place if now_s - self._placed_s <= self._rules.oldest_place_s else None

    def _forget_what_lies_ahead(self, now_s: float) -> None:
        """Nobody waits until a clock that was set back is as late again."""
        x_m, y_m, stood_s = self._stood
        self._stood = (x_m, y_m, min(stood_s, now_s))
        if self._planned[1] > now_s:
            self._planned = (self._planned[0], -np.inf)

    def _hold(self, now_s: float) -> None:
        """Whether the robot has to stand, where that is another than before."""
        hold, known = RobotHold(""), self._known
        if self._goal is not None and self._place is not None:
            reason = known.moving(now_s, self._place, self._rules.still_s)
            hold = RobotHold(reason, known.beside.may_stand)
        before, self._held = self._held, hold
        if (bool(hold.reason), hold.asks) != (bool(before.reason), before.asks):  # metres change
            self._out.append(hold)

    def _wants_plan(self, now_s: float) -> bool:
        (version, planned_s), place = self._planned, self._known_place(now_s)
        changed, soon = version != self._known.version, now_s - planned_s < self._rules.replan_s
        if self._route is None:
            changed |= place is not None and self._waits_for_place
            # its place may be known better
            return not soon and (changed or now_s - planned_s > self._rules.retry_s)
        if place is None:
            return False  # it stands on its route until it is found again
        if np.hypot(place.x_m - self._goal.x_m, place.y_m - self._goal.y_m) <= self._rules.goal_m:
            return False  # it is there
        if changed and not self._is_clear(place):
            return True  # the answer to a way that closes does not wait
        if soon:
            return False
        if _off_m(self._route.points_home_m, (place.x_m, place.y_m)) > self._rules.off_m:
            return True
        # it stands: what its place allows is another than when it was planned
        return now_s - max(planned_s, self._stood[2]) > self._rules.retry_s

    def _planned_route(self, now_s: float) -> Union[RouteMessage, NoRouteMessage]:
        place = self._known_place(now_s)
        self._route, self._waits_for_place = None, place is None
        try:
            if place is None:
                raise RouteError("the robot's place is not known")
            if self._ground is None:
                raise RouteError("no map has come")
            found = self.plan((place.x_m, place.y_m), (self._goal.x_m, self._goal.y_m))
        except EndNotSeenError as error:
            seen_m = self._ground.grid.middle_of(*np.array([error.cell]).T)
            return NoRouteMessage(f"{NO_ROUTE_KNOWN}: {error}", seen_m)
        except RouteError as error:
            waits = place is None or self._ground is None
            return NoRouteMessage(f"{NO_ROUTE_KNOWN}: {error}", np.empty((0, 2)), waits)
        if isinstance(found, NoRoute):
            return self.in_words(found)
        self._route = found
        return RouteMessage(found.points_home_m)

    def _is_clear(self, place: RobotPlace) -> bool:
        """Whether what is left of the route keeps clear of what is known now; near the robot it may
        be as near as the robot already is."""
        route = Polyline.of(self._route.points_home_m)
        along = np.append(np.arange(0.0, route.length_m, 0.05), route.length_m)
        points = route.at(along)
        at = int(np.argmin(np.hypot(*(points - [place.x_m, place.y_m]).T)))
        row, column, inside = self._whole_grid.grid.cells_of(*points[at + 6 :].T)
        clear_m = np.where(inside, self._known.clear_m[row, column], 0.0)
        return bool((clear_m > self._rules.route.sigmas * place.sigma_m).all())


def densely(points: np.ndarray, step_m: float) -> np.ndarray:
    """(M,2): the polyline (N,2) with its corners and no two points farther apart than ``step_m``.

    >>> densely(np.array([[0.0, 0.0], [1.0, 0.0]]), 0.5).tolist()
    [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]
    """
    pieces = [
        a
        + np.linspace(0, 1, max(1, int(np.ceil(np.hypot(*(b - a)) / step_m))) + 1)[:-1, None]
        * (b - a)
        for a, b in zip(points[:-1], points[1:])
    ]
    return np.concatenate([*pieces, points[-1:]])


def _off_m(points: np.ndarray, xy) -> float:
    return float(np.hypot(*(densely(points, 0.1) - np.asarray(xy)).T).min())


def _in_words(reason: str, to_see_m: np.ndarray) -> NoRouteMessage:
    if not len(to_see_m):
        return NoRouteMessage(reason, to_see_m)
    named = ", ".join(f"({x:.1f}, {y:.1f})" for x, y in to_see_m[:_MOST_NAMED])
    more = f" and {len(to_see_m) - _MOST_NAMED} more" if len(to_see_m) > _MOST_NAMED else ""
    return NoRouteMessage(f"{reason}; look at {named}{more}", to_see_m)
