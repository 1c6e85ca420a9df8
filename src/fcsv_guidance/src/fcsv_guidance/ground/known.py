# SPDX-License-Identifier: Apache-2.0
"""What is known of the ground now: maps that were made before, and views that watch it and take its
freedom back."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Deque, Dict, Iterable, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import standing, together, tuning
from fcsv_guidance.ground.beside import LOOK_AGAIN_S, WALKS_MPS, BesideWatch
from fcsv_guidance.ground.comparing import THING_M, Compared, compared
from fcsv_guidance.ground.model import LAYERS, Ground, ground_from, window_of, within
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.messages import ClearanceMap, RobotPlace
from fcsv_guidance.robot import Robot

_SIGMAS = 4.0  # a height that differs by so much, and by CHANGED_M, is another
# below the smallest step that stops a robot for System III; noise of one cell stays below
CHANGED_M = 0.12
_MOVES_CELLS = 4  # fewer that change are noise
_STIRS_M = 0.25  # beside what has changed before: the edge of a thing that stands, no motion
# beyond a footprint: how far a cell has to do with its probability (standing.features)
_JUDGED_M = 0.8
_OWN_M = 0.15  # beside the footprint: what is seen there may be the robot itself
_HOLDS, _CLOSES = 0.3, 0.999  # how surely something came: the robot is held, ground closes
_OWN_NOISE = 3.0  # standard deviations of a view by which the robot's own depth is off
_AHEAD_M = 0.35  # beside what was measured of a thing: its depth there, or the robot's own edge
_FREEING_VIEWS = 3  # that must show the ground where something stood, before it counts as free
_TOLD = 2.0  # standard deviations of a view's noise by which a thing that it would free was nearer
#: The robot stands while something came near in the last STILL_S, and until STILL_VIEWS have come
#: since.
STILL_S, STILL_VIEWS = 2.5, 2
_KEPT_VIEWS = 100  # more than come in STILL_S
_SEEN_LATE_S = 2.5  # to the next picture but one, as one may miss who comes, and to the robot


@dataclass(frozen=True)
class GroundSeen:
    """What one view shows of the ground, on the grid that all share. ``source``: its station; the
    newest of a source counts. ``watching``: it is one of a series that shows what changes.
    ``eye_m`` (3,) in home: of its camera, where the robot may stand in the picture. ``compared``:
    a watching view with what the maps foretell for it, where one does."""

    stamp_s: float
    source: str
    ground: Ground
    watching: bool = False
    eye_m: Optional[np.ndarray] = None
    compared: Optional[Compared] = None


def watch_seen(
    view: DepthView, maps: Sequence[DepthView], grid: Grid, own: Optional[np.ndarray] = None
) -> GroundSeen:
    """What a watching view shows, laid on ``grid`` and compared with the ``maps``; ``own``: pixels in
    which it may show the robot. Raises GroundError where no pixel has a depth."""
    view, shows = compared(view, maps, grid, own)
    ground = ground_from([view], grid=grid)
    return GroundSeen(view.stamp_s, view.name, ground, True, view.T_home_cam[:3, 3], shows)


class KnownGround:
    """Where ``robot`` can stand by all that was seen: by maps alone as stand_probability of a Ground
    has it.

    A cell in which a watching view shows another height than every map is changed: it counts for
    the maps no more, until a watching view shows the height of the maps again. What hides behind
    stays as it was.

    A cell in which views surely show something nearer than the maps foretell is closed, until
    _FREEING_VIEWS views, each good enough to tell the thing from the ground, have shown the ground
    there as it is mapped, or, where it is hidden, beside it, or what is mapped behind the thing. A
    view that sees none of these says nothing.
    What one view shows well enough to hold the robot closes its cells, too, until a view shows the
    ground there.
    """

    def __init__(self, robot: Robot):
        self._robot = robot
        self._maps: Dict[str, GroundSeen] = {}
        self._watching: Dict[str, GroundSeen] = {}
        # probability, whole footprint known
        self._stands: Dict[str, Tuple[np.ndarray, np.ndarray]] = {}
        self._together = np.zeros((0, 0))  # probability by all maps together
        self._changed: Optional[np.ndarray] = None
        #: how surely something stands in a cell, 0 to 1, whether that closed it, and by how much
        #: inverse depth (1/m) it was nearer than the ground, at which height (m)
        self._things = self._closed = self._shift = self._at_z_m = np.zeros((0, 0))
        self._went: Dict[str, np.ndarray] = {}  # by source: what its last view showed as gone
        self.stands: Optional[np.ndarray] = None
        self.clear_m: Optional[np.ndarray] = None
        self.version = 0
        # of each view: its stamp, and the middles (N,2) of cells into which something came: it may
        # be on its way
        self._came: Deque[Tuple[float, np.ndarray]] = deque(maxlen=_KEPT_VIEWS)
        #: who came up to the robot
        self.beside = BesideWatch()

    @property
    def grid(self) -> Optional[Grid]:
        """None before the first map."""
        return next((seen.ground.grid for seen in self._maps.values()), None)

    @property
    def changed(self) -> np.ndarray:
        """(rows, columns) bool: cells in which something else was seen than the maps show."""
        return self._changed

    @property
    def closed(self) -> np.ndarray:
        """(rows, columns) bool: cells in which something stands that came after the maps."""
        return self._closed | (self._things >= _HOLDS)

    @property
    def newest_map_s(self) -> float:
        """-inf before the first map."""
        return max((seen.stamp_s for seen in self._maps.values()), default=-np.inf)

    @property
    def oldest_watch_s(self) -> float:
        """Stamp of the watching source that has been silent longest; -inf where none watches."""
        return min((seen.stamp_s for seen in self._watching.values()), default=-np.inf)

    def receive(self, seen: GroundSeen, place: Optional[RobotPlace]) -> bool:
        """Whether what is known of freedom changed. ``place``: of the robot, which a watching view
        does not take for an obstacle. Raises GroundError where the view has another grid than the
        first."""
        if not seen.watching:
            return self.receive_maps([seen])
        self._require_fit(seen)
        if self._changed is None:
            raise GroundError(
                f"{seen.source}: watches a place that has no map yet; give the map first"
            )
        before = self._watching.get(seen.source)
        if before is not None and seen.stamp_s <= before.stamp_s:
            return False
        self._watching[seen.source] = seen
        return self._watched(seen, place, None if before is None else before.ground)

    def receive_maps(self, maps: Iterable[GroundSeen]) -> bool:
        """The same of maps that came together, which are judged once."""
        is_new = False
        for seen in maps:
            self._require_fit(seen)
            before = self._maps.get(seen.source)
            if before is not None and seen.stamp_s < before.stamp_s:
                continue  # a map that grows may keep its reference
            if self._changed is None:
                self._changed = np.zeros(seen.ground.grid.shape, bool)
                self._closed = self._changed.copy()
                layers = np.zeros((3, *self._changed.shape), np.float32)
                self._things, self._shift, self._at_z_m = layers
            self._maps[seen.source] = seen
            self._stands[seen.source] = standing.by_one(seen.ground, self._robot)
            is_new = True
        if not is_new:
            return False
        grounds = [seen.ground for seen in self._maps.values()]
        self._together = together.probability(grounds, self._robot)
        return self._weighed()

    def clearance(self, stamp_s: float) -> ClearanceMap:
        """Gives the map as a follower takes it."""
        return ClearanceMap(stamp_s, self.grid, self.clear_m)

    def moving(self, now_s: float, place: RobotPlace, still_s: float = STILL_S) -> str:
        """Why the robot stands for what moves: something has just come near, or may stand beside
        it; empty where nothing has. Near is what WALKS_MPS comes, and the robot drives, until a
        picture shows it and the robot stands."""
        if self.beside.may_stand:
            return (
                "something came up to the robot and was not seen to leave: look, and give the goal "
                f"again once nothing has come near for {LOOK_AGAIN_S:g} s"
            )
        lately = [
            cells_m
            for later, (stamp_s, cells_m) in enumerate(reversed(self._came))
            if later < STILL_VIEWS or now_s - stamp_s < still_s
        ]
        came_m = np.concatenate([np.empty((0, 2)), *lately])
        off_m = np.hypot(*(came_m - [place.x_m, place.y_m]).T).min(initial=np.inf)
        off_m = max(float(off_m) - self._robot.radius_m, 0.0)
        return "" if off_m >= self._near_m else f"something moves {off_m:.1f} m from the robot"

    @property
    def _near_m(self) -> float:
        speed_mps = self._robot.speed_mps
        stops_s = speed_mps / self._robot.slows_mps2
        return (WALKS_MPS + speed_mps) * _SEEN_LATE_S + (WALKS_MPS + 0.5 * speed_mps) * stops_s

    def _require_fit(self, seen: GroundSeen) -> None:
        if not np.isfinite(seen.stamp_s):
            raise GroundError(
                f"{seen.source}: a view without a stamp cannot be told from an old one"
            )
        if self.grid is not None and seen.ground.grid != self.grid:
            raise GroundError(
                f"{seen.source}: its grid is not that of the maps before; make it on the same grid"
            )

    def _own_m(self, seen: GroundSeen, place: RobotPlace) -> float:
        more_m = 0.0 if seen.compared is None else _AHEAD_M
        return self._robot.radius_m + _OWN_M + 2 * place.sigma_m + more_m

    def _own(self, seen: GroundSeen, place: RobotPlace) -> np.ndarray:
        """(rows, columns) bool: cells in which a view may show the robot, or its edge above what it
        hides. In a view that is compared it is seen too near or too far by noise, and as far beside
        as a thing's cells reach."""
        noise = 0.0 if seen.compared is None else seen.compared.noise
        grid, robot = self.grid, self._robot
        xy = grid.middle_of(*np.indices(grid.shape)) - [place.x_m, place.y_m]
        own_m = self._own_m(seen, place)
        if seen.eye_m is None:
            return np.hypot(xy[..., 0], xy[..., 1]) < own_m
        away = np.array([place.x_m, place.y_m]) - seen.eye_m[:2]
        far_m = float(np.hypot(*away))
        row, column, inside = grid.cells_of(place.x_m, place.y_m)
        heights = [s.ground.height_m[row, column] for s in self._maps.values()] if inside else []
        low_m = float(np.nanmedian(heights)) if np.isfinite(heights).any() else 0.0
        above_m = max(float(seen.eye_m[2]) - low_m - robot.height_m, robot.height_m)
        along = xy @ (away / max(far_m, 1e-6))
        hides_m = min(far_m, far_m * robot.height_m / above_m)
        off_m = _OWN_NOISE * noise * (far_m**2 + above_m**2)
        rest = xy - np.clip(along, -off_m, hides_m + off_m)[..., None] * (away / max(far_m, 1e-6))
        return np.hypot(rest[..., 0], rest[..., 1]) < own_m

    def _watched(
        self, seen: GroundSeen, place: Optional[RobotPlace], last: Optional[Ground]
    ) -> bool:
        ground, grid = seen.ground, self.grid
        own = np.zeros(grid.shape, bool) if place is None else self._own(seen, place)
        if place is not None:
            nothing = {name: np.where(own, np.nan, getattr(ground, name)) for name in LAYERS}
            ground = replace(ground, maps=(), **nothing)
        maps = [other.ground for other in self._maps.values()]
        mapped = np.logical_or.reduce([other.known for other in maps])
        if seen.compared is None:
            same = np.logical_or.reduce([_agrees(ground, other) for other in maps])
        else:
            # cells cut what stands at an edge, and move with the pose: the picture alone decides
            surely_came = seen.compared.came >= _CLOSES
            same = ~(surely_came | self._went_again(seen.source, seen.compared.went))
        differs = ground.known & mapped & ~same
        changed = np.where(ground.known & mapped, differs, self._changed)
        changed = changed & ~_lone(changed)
        cells = changed | self._changed
        if last is not None:  # beyond the maps it is compared with itself
            moved = ground.known & last.known & ~mapped & ~_agrees(ground, last)
            cells |= moved & ~_lone(moved)
        stirs = standing.disk(_STIRS_M, grid.cell_m)
        came = changed & ~(standing.most(self._changed | (self._things > 0), stirs) > 0)
        closed = self.closed
        new, gone = self._compared(seen, place, own)
        came |= new
        changed &= ~gone
        came &= came.sum() >= _MOVES_CELLS
        self._came.append((seen.stamp_s, grid.middle_of(*np.nonzero(came))))
        self._changed = changed
        before = self._stands.get(seen.source)
        if before is None:
            self._stands[seen.source] = standing.by_one(ground, self._robot)
        elif not cells.any():
            return (closed != self.closed).any() and self._weighed()
        else:
            self._stands[seen.source] = self._judged_near(ground, cells, before)
        return self._weighed()

    def _went_again(self, source: str, went: np.ndarray) -> np.ndarray:
        """(rows, columns) bool: where the view before showed, too, that something is gone. What one
        view shows behind a thing may lie where no other view of this camera looks."""
        before, self._went[source] = self._went.get(source), went
        if before is None:
            return np.zeros(went.shape, bool)
        return went & (standing.most(before, standing.disk(_STIRS_M, self.grid.cell_m)) > 0)

    def _compared(
        self, seen: GroundSeen, place: Optional[RobotPlace], own: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray]:
        """Takes what the view shows against the maps beside the robot's ``own`` cells; (rows,
        columns) bool, where something came beside what stood there, and where what stood is gone
        though the view does not see it."""
        shows, nowhere = seen.compared, np.zeros(self.grid.shape, bool)
        if shows is None:
            return nowhere, nowhere
        # cells behind the robot: what is seen beside its pixels stands there
        came = np.where(own, shows.apart, shows.came)
        stirs = standing.disk(_STIRS_M, self.grid.cell_m)
        surely = came >= _HOLDS
        new = surely & ~(standing.most(self._things > 0, stirs) > 0)
        if place is not None:
            beside = surely & ~own
            off_px = cv2.distanceTransform((~own).astype(np.uint8), cv2.DIST_L2, 5)[beside]
            things_m = self.grid.middle_of(*np.nonzero(beside))
            off_m, robot_m = off_px * self.grid.cell_m, np.array([place.x_m, place.y_m])
            self.beside.observe(seen.stamp_s, things_m, off_m, robot_m)
        hidden = self._hidden(seen, came)
        is_past = self._looked_past(shows, came)
        frees = (came <= 0) & (self._shift > _TOLD * shows.noise) & (shows.same | hidden | is_past)
        self._at_z_m = np.where(came > 0, shows.at_z_m, self._at_z_m)
        things = np.minimum(self._things + came, 1.0) - frees / np.float32(_FREEING_VIEWS)
        things[things < 0.5 / _FREEING_VIEWS] = 0.0
        things[_rests(things, came, self.grid.cell_m)] = 0.0
        if place is not None:  # where the robot itself stands, which no view can show, is no thing
            off = self.grid.middle_of(*np.indices(self.grid.shape)) - [place.x_m, place.y_m]
            things[np.hypot(off[..., 0], off[..., 1]) < self._robot.radius_m] = 0.0
        self._closed = ((things >= _CLOSES) | self._closed) & (things > 0)
        self._shift = np.where(things > 0, np.maximum(self._shift, shows.shift * (came > 0)), 0.0)
        self._things = things.astype(np.float32)
        return new, (hidden | is_past) & (things <= 0)

    def _looked_past(self, shows: Compared, came: np.ndarray) -> np.ndarray:
        """(rows, columns) bool: where a thing was, and what is mapped behind it is seen."""
        cells = np.nonzero((self._things > 0) & (came <= 0))
        points_m = np.column_stack([self.grid.middle_of(*cells), self._at_z_m[cells]])
        is_past = np.zeros(self.grid.shape, bool)
        is_past[cells] = shows.looks_past(points_m)
        return is_past

    def _hidden(self, seen: GroundSeen, came: np.ndarray) -> np.ndarray:
        """(rows, columns) bool: cells of a thing that the view does not see, beside ground that it
        sees as it is mapped and away from what it still sees of the thing. A thing reaches behind
        what hides it as far as its depth is uncertain."""
        near = standing.disk(_AHEAD_M, self.grid.cell_m)
        ground, known = seen.compared.same & (came <= 0), seen.ground.known
        stays = (came > 0) | ((self._things > 0) & known & ~ground)
        return ~known & (standing.most(ground, near) > 0) & ~(standing.most(stays, near) > 0)

    def _judged_near(self, ground: Ground, cells: np.ndarray, before) -> Tuple:
        """What was judged ``before``, anew where ``cells`` (rows, columns) matter."""
        reach = int(
            np.ceil(_JUDGED_M / ground.grid.cell_m + self._robot.radius_m / ground.grid.cell_m)
        )
        inner, outer = window_of(cells, reach), window_of(cells, 2 * reach)
        part = within(outer, inner)
        judged = tuple(old.copy() for old in before)
        for new, old in zip(standing.by_one(ground.part(outer), self._robot), judged):
            old[inner] = new[part]
        return judged

    def _weighed(self) -> bool:
        """Freedom by all views; whether it is another than before."""
        around = standing.disk(self._robot.radius_m, self.grid.cell_m)
        doubtful = standing.most(self._changed, around) > 0
        maps = [self._stands[name] for name in self._maps]
        watching = [self._stands[name] for name in self._watching if name in self._stands]
        # a watch that repeats it is no more
        mapped = np.logical_or.reduce([whole for _, whole in maps]) & ~doubtful
        each = [np.where(doubtful, np.nan, p) for p, _ in maps] + [
            np.where(mapped, np.nan, p) for p, _ in watching
        ]
        whole = [whole & ~doubtful for _, whole in maps] + [
            whole & ~mapped for _, whole in watching
        ]
        by_maps = np.where(doubtful, np.float32(np.nan), self._together)
        stands = standing.weighed(each, whole, around, by_maps)
        for p, _ in watching:  # what is in the way now, no number of older maps can say otherwise
            stands = np.where(doubtful & (p < tuning.FREE_P), np.minimum(stands, p), stands)
        if self.closed.any():
            blocked = standing.most(self.closed, around) > 0
            stands = np.where(blocked, np.float32(0.0), stands)
        before, self.stands = self.stands, stands
        self.clear_m = np.maximum(self.grid.clear_m(stands >= tuning.FREE_P), 0.0)
        if before is not None and ((before >= tuning.FREE_P) == (stands >= tuning.FREE_P)).all():
            return False
        self.version += 1
        return True


def _agrees(a: Ground, b: Ground) -> np.ndarray:
    """(rows, columns) bool: both know the cell, and neither its edges nor what hangs above tell of
    another surface."""
    sigma = np.hypot(a.sigma_m, b.sigma_m)
    bound = np.maximum(CHANGED_M, _SIGMAS * sigma)
    with np.errstate(invalid="ignore"):
        apart = np.maximum(a.low_m - b.high_m, b.low_m - a.high_m)  # negative where they overlap
        return (apart <= bound) & (np.abs(a.height_m - b.height_m) <= bound + (b.high_m - b.low_m))


def _rests(things: np.ndarray, came: np.ndarray, cell_m: float) -> np.ndarray:
    """(rows, columns) bool: of ``things``, groups of which the view shows nothing, smaller than a
    thing: what is left of one that went, where the robot hides the ground."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats((things > 0).astype(np.uint8))
    few = stats[:, cv2.CC_STAT_AREA] * cell_m**2 < THING_M**2
    few[labels[came > 0]] = False
    return few[labels] & (things > 0)


def _lone(cells: np.ndarray) -> np.ndarray:
    """Those of which none of the eight around is one too: a wrong pixel, no thing."""
    count = cv2.boxFilter(
        cells.astype(np.float32), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    return cells & (count < 1.5)
