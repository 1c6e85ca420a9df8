# SPDX-License-Identifier: Apache-2.0
"""What a survey found: ``site.json`` for programs, ``adjustment.json`` for those who want to know
why."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.model import Cloud
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.placing.adjust import Adjusted, Placed
from fcsv_stereo.survey.placing.earth import EarthFrame
from fcsv_stereo.survey.placing.georeference import World
from fcsv_stereo.survey.surface.points import ViewPoints
from fcsv_stereo.survey.surface.quantiles import quantiles
from fcsv_stereo.survey.surface.rasters import RASTERS
from fcsv_stereo.survey.views.view_file import ViewFile

OCTREE = "site.copc.laz"
CLOUDS = ("site.ply", "site.laz", OCTREE)
#: of clouds, in place of a map's number of the configuration
VIEWS_DIMENSION = ("views", "views that agree on it")
# farther from the origin float32 has steps of more than a millimetre
_FAR_M, _STEP_M = 10_000.0, 1000.0


@dataclass(frozen=True)
class Missing:
    """An input that is not in the site, and why."""

    name: str
    source: str
    reason: str


@dataclass(frozen=True)
class Tile:
    """A square of the site: its files in OUT, its number of points, and between which corners (m)
    they lie."""

    name: str
    files: List[str]
    count: int
    low_m: List[float]
    high_m: List[float]


@dataclass(frozen=True)
class Site:
    """All of it: views that were mapped, how they were adjusted, the points (m, less ``origin_m``)
    of each that has a place, what is missing, and, where it is on the earth, how that is known and
    the frame of the adjustment: once there are points, all coordinates are of ``world.crs``.
    ``extras``: a line on each product that was asked for, by its file."""

    views: List[ViewFile]
    adjusted: Adjusted
    joined: Dict[str, ViewPoints]
    origin_m: np.ndarray
    missing: List[Missing]
    world: Optional[World] = None
    frame: Optional[EarthFrame] = None
    tiles: List[Tile] = field(default_factory=list)
    extras: Dict[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Points of the site."""
        return sum(p.count for p in self.joined.values())

    @cached_property
    def box_m(self) -> np.ndarray:
        """(2,3) least and largest coordinates of the points, less ``origin_m``; they must be
        there."""
        boxes = [(p.low_m, p.high_m) for p in self.joined.values() if p.count]
        low, high = np.array(boxes, float).transpose(1, 0, 2)
        return np.stack([low.min(axis=0), high.max(axis=0)])

    @cached_property
    def median_sigma_m(self) -> float:
        """Median of all points; NaN where there are none."""
        return float(quantiles(lambda: (c.sigma_m[:, None] for c in self.clouds()), (0.5,))[0, 0])

    @property
    def crs(self) -> str:
        """Reference system of all coordinates; empty for a frame of the site's own."""
        return self.world.crs if self.world else ""

    def parts(self) -> Iterator[ViewPoints]:
        """The points of each view that has any."""
        return (p for p in self.joined.values() if p.count)

    def clouds(self) -> Iterator[Cloud]:
        """The points of one view after the other. Raises OSError."""
        return (p.load() for p in self.parts())

    def files(self) -> List[str]:
        """The site's own files that there are."""
        if not self.count:
            return list(CLOUDS[:1])
        lacking = {m.name for m in self.missing}
        return [n for n in (*CLOUDS, *RASTERS, *self.extras) if n not in lacking]


def withdraw(out: Path) -> None:
    """Takes an earlier site.json away, before what it tells of changes. Raises OSError."""
    (out / "site.json").unlink(missing_ok=True)


def origin_of(placed: Sequence[Placed]) -> np.ndarray:
    """(3,) m that a cloud in float32 leaves out; zero near the site's origin."""
    places = np.array([similarity.place(p.S_site_cam) for p in placed]).reshape(-1, 3)
    if not len(places) or np.abs(places).max() < _FAR_M:
        return np.zeros(3)
    return np.round(np.median(places, axis=0) / _STEP_M) * _STEP_M


def T_site_home(view: ViewFile, placed: Placed) -> np.ndarray:
    """4x4 similarity from the view's home to the site."""
    return similarity.matrix(placed.S_site_cam) @ transforms.invert(view.T_home_cam)


def site_document(site: Site) -> dict:
    """site.json."""
    adjusted, views = site.adjusted, []
    for view in (v for v in site.views if v.name in adjusted.placed):
        p = adjusted.placed[view.name]
        views.append(
            {
                "name": view.name,
                "input": _absolute(view.source),
                "T_site_home": T_site_home(view, p).tolist(),
                "scale": p.scale,
                "sigma_scale": p.sigma_scale,
                "sigma_m": p.sigma_m,
                "sigma_yaw_deg": float(np.degrees(p.sigma_yaw_rad)),
                "overlaps": overlaps(adjusted, view.name),
            }
        )
    edges = [
        {"a": e.a, "b": e.b, "kept": e.kept, "reason": e.reason, "residual_m": e.residual_m}
        for e in adjusted.edges
    ]
    low, high = (site.box_m + site.origin_m).tolist() if site.count else (None, None)
    tiles = [
        {"name": t.name, "files": t.files, "points": t.count, "min_m": t.low_m, "max_m": t.high_m}
        for t in site.tiles
    ]
    missing = [
        {"name": m.name, "input": _absolute(m.source), "reason": m.reason} for m in site.missing
    ]
    return {
        "crs": site.crs or None,
        "heights": site.world.heights if site.world else None,
        "origin": site.origin_m.tolist(),
        "views": views,
        "edges": edges,
        **_world(site.world),
        "files": site.files(),
        "points": site.count,
        "min_m": low,
        "max_m": high,
        "tiles": tiles,
        "missing": missing,
    }


def _absolute(source: str) -> str:
    """A path that does not depend on the working directory; none stays none."""
    return source and str(Path(source).absolute())


def _world(world: Optional[World]) -> dict:
    """What fixes the site on the earth; null where nothing does."""
    if world is None:
        return {"world": None, "gps": None, "control_points": None}
    fit = world.fit
    gps = [
        {
            "view": r.statement.view,
            "residual_m": r.off_m.tolist(),
            "sigma_m": r.sigma_m.tolist(),
            "used": r.used,
        }
        for r in fit.gps
    ]
    points = [
        {
            "name": p.name,
            "check": p.check,
            "used": p.used,
            "views": p.views,
            "residual_m": p.off_m.tolist(),
            "sigma_m": p.sigma_m.tolist(),
        }
        for p in fit.points
    ]
    sigmas = {
        "sigma_m": fit.sigma_m,
        "sigma_heading_deg": float(np.degrees(fit.sigma_heading_rad)),
        "sigma_scale": fit.sigma_scale,
    }
    return {"world": sigmas, "gps": gps or None, "control_points": points or None}


def overlaps(adjusted: Adjusted, name: str) -> List[str]:
    """Views that a kept edge joins with a view."""
    return [e.b if e.a == name else e.a for e in adjusted.edges if e.kept and name in (e.a, e.b)]


def adjustment_document(site: Site) -> dict:
    """adjustment.json; ``scale_sigma`` is what a view's input says of its map's scale."""
    adjusted, prior = site.adjusted, {v.name: v.prior for v in site.views}
    return {
        "remarks": adjusted.remarks,
        "views": {
            n: {
                "S_site_cam": similarity.matrix(p.S_site_cam).tolist(),
                "alone": p.alone,
                "datum": p.datum,
                "scale_sigma": prior[n].scale,
                "covariance": p.covariance.tolist(),
                "covariance_to_datum": p.relative.tolist(),
                "points": site.joined[n].count,
                "seen_by_two": site.joined[n].agreed,
                "told_by_surer_views": site.joined[n].duplicates,
                "seen_through": site.joined[n].seen_through,
            }
            for n, p in adjusted.placed.items()
        },
        "edges": [
            {
                "a": e.a,
                "b": e.b,
                "matches": e.matches,
                "reason": e.reason,
                "residual_m": e.residual_m,
                "S_a_b": None if e.S_a_b is None else similarity.matrix(e.S_a_b).tolist(),
                "covariance": None if e.covariance is None else e.covariance.tolist(),
            }
            for e in adjusted.edges
        ],
        "loops": [
            {
                "views": loop.views,
                "closing_m": loop.closing_m,
                "closing_deg": loop.closing_deg,
                "closing_scale": loop.closing_scale,
            }
            for loop in adjusted.loops
        ],
    }
