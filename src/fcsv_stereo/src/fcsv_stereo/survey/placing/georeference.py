# SPDX-License-Identifier: Apache-2.0
"""The world's part of a survey: what the user gives, what photographs say, and the site in a
projected reference system."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

import gtsam
import numpy as np

from fcsv_stereo.errors import SurveyError
from fcsv_stereo.model import Cloud
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.edges.edge import Edge
from fcsv_stereo.survey.placing import earth
from fcsv_stereo.survey.placing.adjust import Adjusted, Placed, adjust
from fcsv_stereo.survey.placing.control_points import (
    ControlList,
    check_names,
    read_control_points,
    sights,
)
from fcsv_stereo.survey.placing.earth import EarthFrame
from fcsv_stereo.survey.placing.world import Statement, WorldFit, adjust_world, statements_of
from fcsv_stereo.survey.views.view import View

HEIGHTS = ("ellipsoid", "geoid")


@dataclass(frozen=True)
class WorldOptions:
    """``control``: gcp_list.txt; ``checks``: names after commas or a share of its points; ``crs``
    of the output (empty: that of the control points where it is projected, else UTM's zone);
    ``sigma_m`` of control points per axis; ``heights``: the surface that heights count from, where
    the user says it; ``gps``: whether GPS counts.

    Raises SurveyError on a wrong one.
    """

    control: Optional[Path] = None
    checks: str = ""
    crs: str = ""
    sigma_m: float = tuning.CONTROL_SIGMA_M
    heights: str = ""
    gps: bool = True

    def __post_init__(self):
        if self.crs:
            earth.projected_crs(self.crs)
        if not 0.0 < self.sigma_m < np.inf:
            raise SurveyError(f"--control-sigma-m: must be positive, got {self.sigma_m}")
        if self.heights and self.heights not in HEIGHTS:
            raise SurveyError(f"--heights: is {' or '.join(HEIGHTS)}, got {self.heights}")
        if self.checks and self.control is None:
            raise SurveyError("--check-points names points of --gcp, which is not given")

    def read(self) -> "WorldInput":
        """Reads the control points. Raises InputError or SurveyError."""
        control = read_control_points(self.control) if self.control else None
        return WorldInput(self, control, check_names(control, self.checks) if control else [])


@dataclass(frozen=True)
class WorldInput:
    """What is given: options, control points that were read, and which of them are check points."""

    options: WorldOptions
    control: Optional[ControlList]
    checks: List[str]


@dataclass(frozen=True)
class World:
    """The site on the earth: ``crs`` (EPSG:NUMBER, or WKT), what heights count from, in words, and
    how well all of it fits."""

    crs: str
    heights: str
    fit: WorldFit


def place(
    views: Sequence[View], edges: Sequence[Edge], given: WorldInput
) -> Tuple[Adjusted, Optional[EarthFrame], Optional[World]]:
    """The adjustment in the earth's coordinates, the frame it is in and what is said of it; None
    where neither control points nor GPS fix it."""
    fixes = {v.name: v.gps for v in views if v.gps is not None and given.options.gps}
    cam_m = {v.name: v.gps_cam_m for v in views}
    if given.control is None and not fixes:
        return adjust_without(views, edges, given), None, None
    seen, remarks = sights(given.control, views) if given.control else ([], [])
    at = _geographic(given, fixes)
    frame = EarthFrame.about(np.array(list(at.values())), _crs(given))
    places = dict(zip(at, frame.from_geographic(np.array(list(at.values())))))
    points = {n: places["point", n] for n in (given.control.points if given.control else ())}
    statements = statements_of(seen, points, given.options.sigma_m)
    statements += [
        _fix(n, g, cam_m[n], places["view", n], heights=not points)
        for n, g in sorted(fixes.items())
    ]
    adjusted, fit = adjust_world(views, edges, statements, given.checks)
    unseen = [n for n in points if n not in {s.point for s in seen}]
    if unseen:
        remarks.append(f"control points that no view tells: {', '.join(unseen)}")
    adjusted = replace(adjusted, remarks=[*adjusted.remarks, *remarks])
    if fit is None:
        return adjusted, None, None
    return adjusted, frame, World(earth.name_of(frame.crs), _heights(given, fixes), fit)


def adjust_without(views, edges, given: WorldInput) -> Adjusted:
    """The adjustment in a frame of its own."""
    adjusted = adjust(views, edges)
    if not given.options.crs:
        return adjusted
    said = "--crs has no effect: neither control points nor GPS say where the site is on the earth"
    return replace(adjusted, remarks=[*adjusted.remarks, said])


def _geographic(given: WorldInput, fixes: Dict[str, Gps]) -> Dict[Tuple[str, str], np.ndarray]:
    """Longitude, latitude, height of all points and fixes."""
    at = {}
    if given.control is not None:
        names = list(given.control.points)
        xyz = np.array([given.control.points[n] for n in names])
        found = earth.to_geographic(given.control.crs, xyz)
        at.update({("point", n): p for n, p in zip(names, found)})
    for name, g in fixes.items():
        at["view", name] = np.array([g.longitude_deg, g.latitude_deg, g.height_m])
    return at


def _crs(given: WorldInput):
    if given.options.crs:
        return earth.projected_crs(given.options.crs)
    if given.control is not None and earth.in_metres(given.control.crs):
        return given.control.crs
    return None


def _fix(view: str, gps: Gps, p_cam: np.ndarray, p: np.ndarray, heights: bool) -> Statement:
    """GPS of a view; beside control points its height has no say: the two may count from
    surfaces 100 m apart."""
    up = float(np.hypot(gps.height_sigma_m, gps.height_step_m)) if heights else tuning.FREE_M
    across = float(np.hypot(gps.sigma_m, gps.step_m))
    sigma = np.array([across, across, up])
    return Statement(view, p_cam, np.zeros((3, 3)), p, sigma)


def _heights(given: WorldInput, fixes: Dict[str, Gps]) -> str:
    if given.options.heights:
        return f"above the {given.options.heights}, as the user says"
    if given.control is not None:
        return f"as {given.control.path.name} has them, which does not say above what"
    return (
        "as GPS has them: of flights and most RTK above the ellipsoid, by EXIF above sea level"
        if fixes
        else ""
    )


def projected_placed(placed: Placed, frame: EarthFrame) -> Placed:
    """A view in the projected system: the similarity that is nearest there to what the projection
    does (lengths across the ground and heights differ by up to 0.1 % more)."""
    at = similarity.place(placed.S_site_cam)
    J = frame.turn_at(at)
    stretch = float(np.cbrt(np.linalg.det(J)))
    U, _, Vt = np.linalg.svd(J)
    T = np.eye(4)
    T[:3, :3] = U @ Vt @ similarity.rotation(placed.S_site_cam)
    T[:3, 3] = frame.to_projected(at[None])[0]
    S: gtsam.Similarity3 = similarity.of_pose(T, placed.scale * stretch)
    return replace(placed, S_site_cam=S)


def projected(adjusted: Adjusted, frame: EarthFrame) -> Adjusted:
    """All views in the projected system."""
    placed = {n: projected_placed(p, frame) for n, p in adjusted.placed.items()}
    return replace(adjusted, placed=placed)


def projected_cloud(cloud: Cloud, frame: EarthFrame, from_m: np.ndarray) -> Cloud:
    """Each point by itself in the projected system, less ``frame.rounded_origin()``; ``from_m``:
    the origin that the cloud left out before."""
    if not len(cloud):
        return cloud
    p = frame.to_projected(cloud.points_home_m.astype(float) + from_m) - frame.rounded_origin()
    return replace(cloud, points_home_m=p.astype(np.float32))
