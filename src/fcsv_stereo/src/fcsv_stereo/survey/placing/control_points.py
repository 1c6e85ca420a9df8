# SPDX-License-Identifier: Apache-2.0
"""Ground control points: ODM's ``gcp_list.txt``, and what a view's depth says of them.

The first line names the reference system; each further one is ``x y z pixel_x pixel_y picture
[name]``; ``#`` begins a comment; double quotes hold a name with blanks. Pixels count as OpenCV's:
the middle of the first one is (0, 0).
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
from pyproj import CRS

from fcsv_geometry.programs.writing import in_words
from fcsv_stereo.errors import InputError, SurveyError
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.edges.features import located
from fcsv_stereo.survey.placing import earth
from fcsv_stereo.survey.views.view import View

REFERENCE = "reference.png"
_WORD = re.compile(r'"[^"]*"|\S+')
_PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
_FAR_OUTSIDE_DEG = 10.0


@dataclass(frozen=True)
class Mark:
    """A control point ``point`` (its name) at pixel ``uv`` of a picture."""

    point: str
    picture: str
    uv: Tuple[float, float]
    line: int


@dataclass(frozen=True)
class ControlList:
    """``points``: name to (3,) coordinates in ``crs``, x before y, m; ``marks`` in pictures."""

    path: Path
    crs: CRS
    points: Dict[str, np.ndarray]
    marks: List[Mark]


def read_control_points(path: Path) -> ControlList:
    """Reads ``gcp_list.txt``. Raises InputError naming file and line."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(in_words(error, path)) from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8; save it so") from error
    told = [(n, s.strip()) for n, s in enumerate(lines, 1) if s.strip() and s.strip()[0] != "#"]
    if not told:
        raise InputError(f"{path}: is empty; its first line names the reference system")
    number, head = told[0]
    try:
        crs = earth.crs_of(head)
    except SurveyError as error:
        raise InputError(f"{path}, line {number}: {error}") from error
    if crs.is_projected and not earth.in_metres(crs):
        raise InputError(f"{path}, line {number}: '{head}' has not metres; convert the points")
    points: Dict[str, np.ndarray] = {}
    marks = [_mark(path, number, text, points) for number, text in told[1:]]
    if not marks:
        raise InputError(f"{path}: holds no control point")
    for name, xyz in points.items():
        _require_place(path, crs, name, xyz)
    return ControlList(path, crs, points, marks)


def _require_place(path: Path, crs: CRS, name: str, xyz: np.ndarray) -> None:
    """Raises InputError where a point is no place, or is far outside of where its reference system
    is used, as one whose x and y are exchanged."""
    try:
        longitude, latitude, _ = earth.to_geographic(crs, xyz[None])[0]
    except SurveyError as error:
        raise InputError(f"{path}: {name}: {error}; are x and y exchanged?") from error
    area = crs.area_of_use
    if area is None or area.west > area.east:  # not told, or across the date line
        return
    over = max(
        area.west - longitude, longitude - area.east, area.south - latitude, latitude - area.north
    )
    if over > _FAR_OUTSIDE_DEG:
        raise InputError(
            f"{path}: {name}: {xyz[0]:g} {xyz[1]:g} is at {latitude:.1f}, {longitude:.1f} degrees, far outside of "
            f"{earth.name_of(crs)}: are x and y exchanged, or is it another system?"
        )


def _mark(path: Path, number: int, text: str, points: Dict[str, np.ndarray]) -> Mark:
    """A line; its point is put into ``points``."""
    words = [w.strip('"') for w in _WORD.findall(text)]
    where = f"{path}, line {number}"
    if len(words) < 6:
        raise InputError(
            f"{where}: has {len(words)} words; x y z pixel_x pixel_y picture [name] are needed"
        )
    if len(words) > 6 and Path(words[6]).suffix.lower() in _PICTURES:
        raise InputError(
            f"{where}: '{words[5]}' and '{words[6]}' are two words; put a picture's name with blanks into double quotes"
        )
    try:
        values = [float(w) for w in words[:5]]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from error
    if not np.isfinite(values).all():
        raise InputError(f"{where}: its numbers must be finite")
    xyz = np.array(values[:3])
    name = words[6] if len(words) > 6 else _unnamed(xyz, points)
    if name in points and not np.allclose(points[name], xyz, atol=1e-6, rtol=0.0):
        raise InputError(
            f"{where}: {name} is at {xyz.tolist()}, above at {points[name].tolist()}; correct one"
        )
    points[name] = xyz
    return Mark(name, words[5], (values[3], values[4]), number)


def _unnamed(xyz: np.ndarray, points: Dict[str, np.ndarray]) -> str:
    """The name of a point without one: that of the same place, else the next number."""
    same = (n for n, p in points.items() if np.allclose(p, xyz, atol=1e-6, rtol=0.0))
    return next(same, f"point{len(points) + 1}")


def check_names(control: ControlList, words: Optional[str]) -> List[str]:
    """The points that are left out of the adjustment: names after commas, or a share of all, 0 to
    1, spread over their order. Raises SurveyError.

    >>> points = {n: np.zeros(3) for n in "abcde"}
    >>> check_names(ControlList(Path("g"), None, points, []), "0.4")
    ['b', 'd']
    """
    if not words:
        return []
    names = list(control.points)
    try:
        share = float(words)
    except ValueError:
        chosen = [w.strip() for w in words.split(",") if w.strip()]
        unknown = [n for n in chosen if n not in names]
        if unknown:
            raise SurveyError(
                f"--check-points: {control.path} has no {unknown[0]}; it has {', '.join(names)}"
            ) from None
        return chosen
    if not 0.0 <= share < 1.0:
        raise SurveyError(f"--check-points: a share is 0 to below 1, got {words}")
    count = int(round(share * len(names)))
    return [names[int((i + 0.5) * len(names) / count)] for i in range(count)]


@dataclass(frozen=True)
class ControlSight:
    """A control point as a view's depth tells it: ``p_cam`` (3,) m in the view's camera and map,
    with ``covariance`` (3,3)."""

    point: str
    view: str
    p_cam: np.ndarray
    covariance: np.ndarray


def sights(control: ControlList, views: Sequence[View]) -> Tuple[List[ControlSight], List[str]]:
    """What views' depths say of the points, and remarks on marks that tell nothing.

    A picture is named as its file is, or ``VIEW/FILE`` where several views have one of that name,
    or ``VIEW/reference.png`` for pixels of a map's own picture. Raises SurveyError where a name
    fits several views.
    """
    elsewhere: List[str] = []
    in_view: Dict[
        str, List[Tuple[int, bool]]
    ] = {}  # marks by number, and whether of its own picture
    for i, mark in enumerate(control.marks):
        view, own = _view_of(mark, control, views)
        if view is None:
            elsewhere.append(mark.picture)
        else:
            in_view.setdefault(view.name, []).append((i, own))
    told: Dict[int, Any] = {}
    for view in (v for v in views if v.name in in_view):
        pixels = view.load()  # one at a time
        told.update({i: _sight(control.marks[i], pixels, own) for i, own in in_view[view.name]})
    found: List[ControlSight] = []
    silent: Dict[str, List[str]] = {}
    for mark, sight in ((control.marks[i], told[i]) for i in sorted(told)):
        if isinstance(sight, str):
            silent.setdefault(mark.point, []).append(sight)
        else:
            found.append(sight)
    remarks = [
        f"control point {point}: {'; '.join(why)}; {'this mark tells' if len(why) == 1 else 'these marks tell'} nothing"
        for point, why in silent.items()
    ]
    if elsewhere:
        named = ", ".join(sorted(set(elsewhere))[:3])
        remarks.append(
            f"{len(elsewhere)} marks of control points are in pictures that are no view's reference, and tell nothing: "
            f"{named}{' ...' if len(set(elsewhere)) > 3 else ''}"
        )
    return found, remarks


def _view_of(mark: Mark, control: ControlList, views: Sequence[View]):
    """The view, and whether pixels are of the map's own picture; (None, False) where there is
    none."""
    for v in views:
        if mark.picture in (f"{v.name}/{REFERENCE}", v.name):
            return v, True
    fits = [v for v in views if mark.picture in (v.picture, f"{v.name}/{v.picture}")]
    if len(fits) > 1:
        names = " or ".join(f"{v.name}/{v.picture}" for v in fits[:3])
        raise SurveyError(
            f"{control.path}, line {mark.line}: {mark.picture} is the reference of {len(fits)} views; write {names}"
        )
    return (fits[0], False) if fits else (None, False)


def _sight(mark: Mark, view: View, own: bool):
    """A ControlSight, or words that say why there is none."""
    uv = np.array([mark.uv], float)
    taken = view.taken_with
    if not own and taken is not None:
        x, y = taken.normalize(uv)[0]
        c = taken
        uv = np.array([[x * c.fx + c.cx, y * c.fy + c.cy]])
    u, v = uv[0]
    height, width = view.depth.shape
    if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
        return f"pixel {mark.uv[0]:g}, {mark.uv[1]:g} is outside of {view.name}"
    column, row = int(round(u)), int(round(v))
    half = tuning.MARK_WINDOW_PX // 2
    window = (
        slice(max(row - half, 0), row + half + 1),
        slice(max(column - half, 0), column + half + 1),
    )
    known = view.known[window]
    if not known.any():
        return f"{view.name} has no depth at pixel {mark.uv[0]:g}, {mark.uv[1]:g}"
    depths, sigmas = view.depth[window][known], view.own_sigma[window][known]
    if np.ptp(depths) > tuning.MOST_FEATURE_STEP * np.median(depths):
        return f"it lies at a step of {view.name}'s depth"
    at = np.array([np.median(depths)], float), np.array([np.median(sigmas)], float)
    features = located(view.camera, uv, *at, np.zeros((1, 0), np.float32))
    return ControlSight(mark.point, view.name, features.points[0], features.covariances[0])
