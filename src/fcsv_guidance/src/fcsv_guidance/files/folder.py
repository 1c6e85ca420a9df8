# SPDX-License-Identifier: Apache-2.0
"""The folder that ``ground`` and ``map --products ground`` write: the ground of maps in all its
forms."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Optional, Sequence, Tuple, Union

import numpy as np

from fcsv_guidance.errors import EndNotSeenError, GroundError
from fcsv_guidance.files.map_files import write_layers, write_map_server
from fcsv_guidance.files.octomap_files import write_octomap
from fcsv_guidance.files.picture import RouteDrawn, draw
from fcsv_guidance.files.stations import require_new_files, station_files, write_stations
from fcsv_guidance.files.tiles import JudgedGround, judged, judged_by_tiles
from fcsv_guidance.ground import tuning
from fcsv_guidance.ground.fitting import require_one_frame
from fcsv_guidance.ground.model import Ground, ground_from
from fcsv_guidance.ground.site_views import SitePlace
from fcsv_guidance.ground.standing import require_fine_cells
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.look_from import LookFrom, look_from, write_look_from
from fcsv_guidance.route.search import NO_ROUTE_KNOWN, NoRoute, Route, plan_route
from fcsv_stereo.map_files.staging import StagedFolder

PICTURE = "ground.png"
DOCUMENT = "ground.json"
#: Side of a cell, where a robot's radius is not less.
LARGEST_CELL_M = 0.1
_LARGEST_VOXEL_M = 10.0
Begin = Callable[[str, float], None]


@dataclass(frozen=True)
class GroundOptions:
    """Side of a cell, how far from a camera the grid reaches, and the voxels of an OctoMap (None:
    none is written).

    Raises GroundError on one that is not positive, or voxels that are too large.
    """

    cell_m: float = LARGEST_CELL_M
    reach_m: float = 60.0
    voxel_m: Optional[float] = None

    def __post_init__(self):
        for option, value in (
            ("--cell-m", self.cell_m),
            ("--reach-m", self.reach_m),
            ("--octomap", self.voxel_m),
        ):
            if value is not None and not 0.0 < value < np.inf:
                raise GroundError(f"{option}: must be above 0 m, got {value}")
        if self.voxel_m is not None and self.voxel_m > _LARGEST_VOXEL_M:
            raise GroundError(
                f"--octomap: voxels are at most {_LARGEST_VOXEL_M:.0f} m, got {self.voxel_m:g}"
            )

    @classmethod
    def of_robot(
        cls,
        robot: Robot,
        cell_m: Optional[float] = None,
        reach_m: float = 60.0,
        voxel_m: Optional[float] = None,
    ) -> "GroundOptions":
        """The options with cells for a robot, where ``cell_m`` does not say it."""
        cell_m = min(LARGEST_CELL_M, robot.radius_m) if cell_m is None else cell_m
        return cls(cell_m, reach_m, voxel_m)


@dataclass(frozen=True)
class RouteAsked:
    """A route from ``start_m`` to ``goal_m`` (x, y in home), as plan_route takes it; ``mission``:
    the file that says where to look from where none is known."""

    start_m: Tuple[float, float]
    goal_m: Tuple[float, float]
    place_sigma_m: float = 0.0
    through_unknown: Optional[float] = None
    mission: Optional[Path] = None


@dataclass(frozen=True)
class GroundWritten:
    """``summary``: one line on the ground; ``found``: a Route or a NoRoute where one was asked
    for; ``looks``: where to look from, where that was asked for and a place shows what lacks;
    ``stations``: files of write_stations for it."""

    paths: Sequence[Path]
    summary: str
    found: Union[Route, NoRoute, None]
    looks: Optional[LookFrom] = None
    stations: Sequence[Path] = ()


def require_new(out: Path) -> None:
    """Raises GroundError unless ``out`` is not there, or an empty folder."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise GroundError(f"{out}: exists and is not an empty folder; give another with -o")


def write_ground(
    views: Sequence[DepthView],
    robot: Robot,
    out: Path,
    options: GroundOptions = GroundOptions(),
    asked: Optional[RouteAsked] = None,
    begin: Begin = lambda step, share: None,
    place: Optional[SitePlace] = None,
) -> GroundWritten:
    """All files of the ground that ``views`` show, and the route that is ``asked`` for, into folder
    ``out``. ``place``: the views are a site's; it is made by tiles, and its layers are in the site's
    reference system.

    The folder appears when all of it is written. Raises GuidanceError where there is no ground, the
    route cannot be asked for, or ``out`` or the mission's file is not new, OSError where the disk does not take the
    files; then, and when it is interrupted, nothing is written.
    """
    out = Path(out)
    require_new(out)
    require_fine_cells(options.cell_m, robot, "--cell-m")
    if asked is not None and asked.mission is not None:
        require_new_files(asked.mission, 0 if place else len(views), out)
    begin("the ground", 0.2)
    if place is None:
        ground = ground_from(views, options.cell_m, reach_m=options.reach_m)
        require_one_frame(ground)
        begin("where the robot can stand", 0.4)
        judgement = judged(ground, robot)
    else:
        judgement = judged_by_tiles(
            views,
            robot,
            options.cell_m,
            options.reach_m,
            progress=lambda share: begin(f"the ground, {share:.0%}", 0.2 + 0.3 * share),
        )
    ground, stands = judgement.ground, judgement.stands
    found, looks = None, None
    if asked is not None:
        begin("the route", 0.5)
        found = _route(judgement, robot, asked)
        if asked.mission is not None and isinstance(found, NoRoute) and len(found.to_see):
            looks = look_from(ground, robot, found.to_see, views[0])
    with StagedFolder(out, require_new) as staged:
        folder, paths = staged.folder, []
        if options.voxel_m is not None:  # first: it may be refused
            begin("the OctoMap", 0.6)
            paths += write_octomap(views, folder, "map", options.voxel_m, options.reach_m)
        begin("writing", 0.8)
        paths += write_map_server(judgement.occupied, ground.grid, folder, "map")
        paths += write_map_server(judgement.occupied, ground.grid, folder, "map_scaled", True)
        paths += write_layers(judgement.layers, ground.grid, folder, place)
        drawn = None if asked is None else RouteDrawn(asked.start_m, asked.goal_m, found, looks)
        draw(ground, robot, stands, folder / PICTURE, drawn)
        document = {**_document(ground, stands, robot.name, found), **_placed(place)}
        (folder / DOCUMENT).write_text(json.dumps(document, indent=1))
        names = [*(path.name for path in paths), PICTURE, DOCUMENT]
        stations: Sequence[Path] = ()
        if looks is not None:
            stations = _write_looks(looks, asked.mission, ground, () if place else views)
    paths = [out / name for name in names]
    return GroundWritten(paths, _summary(ground, stands), found, looks, stations)


def _write_looks(
    looks: LookFrom, mission: Path, ground: Ground, maps: Sequence[DepthView]
) -> Sequence[Path]:
    """The mission, and stations where there are ``maps``; all of them, or none. The stations."""
    try:
        write_look_from(looks, mission, ground.views)
        return write_stations(looks, mission, maps) if maps else ()
    except BaseException:
        for path in (mission, *station_files(mission, len(maps))):
            path.unlink(missing_ok=True)
        raise


def _route(judgement: JudgedGround, robot: Robot, asked: RouteAsked) -> Union[Route, NoRoute]:
    """Plans as plan_route; where a mission shall say where to look from, an end that was not seen
    is a cell to see."""
    try:
        return plan_route(
            judgement.ground,
            robot,
            asked.start_m,
            asked.goal_m,
            asked.place_sigma_m,
            asked.through_unknown,
            judgement.stands,
        )
    except EndNotSeenError as error:
        if asked.mission is None:
            raise
        return NoRoute(f"{NO_ROUTE_KNOWN}: {error}", np.array([error.cell]))


def _placed(place: Optional[SitePlace]) -> dict:
    """Where a site's coordinates lie: all of this folder's, but those of GeoTIFF, lack
    ``origin_m``."""
    if place is None:
        return {}
    return {"crs": place.crs or None, "origin_m": place.origin_m.tolist()}


def _summary(ground: Ground, stands: np.ndarray) -> str:
    grid, free = ground.grid, stands >= tuning.FREE_P
    size = f"{grid.columns * grid.cell_m:.0f} x {grid.rows * grid.cell_m:.0f} m in cells of {grid.cell_m:g} m"
    return f"{size}: {ground.known.mean():.0%} known, {free.mean():.0%} free to stand on (p >= {tuning.FREE_P})"


def _document(
    ground: Ground, stands: np.ndarray, robot: str, found: Union[Route, NoRoute, None]
) -> dict:
    grid = ground.grid
    document = {
        "robot": robot,
        "maps": list(ground.views),
        "grid": {
            "x0_m": grid.x0_m,
            "y0_m": grid.y0_m,
            "cell_m": grid.cell_m,
            "shape": list(grid.shape),
        },
        "known": float(ground.known.mean()),
        "free": float((stands >= tuning.FREE_P).mean()),
    }
    if isinstance(found, NoRoute):
        document["no_route"] = {
            "reason": found.reason,
            "to_see_m": grid.middle_of(*found.to_see.T).tolist(),
        }
    elif found is not None:
        document["route"] = {
            "points_m": found.points_home_m.tolist(),
            "length_m": found.length_m,
            "risk": found.risk,
            "unknown_m": grid.middle_of(*found.unknown_cells.T).tolist(),
        }
    return document
