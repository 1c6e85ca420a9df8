# SPDX-License-Identifier: Apache-2.0
"""The configurations of a mission file with what each will show, or what is wrong with the file and
in which line."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Tuple

import numpy as np
import yaml

from fcsv_control.mission.activities.looking_round import turns_s
from fcsv_control.mission.ways.places import heading_rad
from fcsv_geometry import config, strict_yaml
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.camera_places import mover_end, mover_place
from fcsv_geometry.missions.mission import Mission
from fcsv_stereo.equations import ErrorThreshold, depth_error, farthest
from fcsv_stereo.planning.overlap import non_overlap, overlap_starts_m

_TURN_S = 1.0  # recorders on and off
STEP_M = 0.1  # goals are dragged in whole steps


@dataclass(frozen=True)
class Optics:
    """Describes the optics of the cameras, undistorted; ``disparity_error_px`` as ``plan`` has it.
    ``focal_v_px``: across the rows, None: as along them; ``heard_of``: the vehicle whose own camera
    this is, "" where none was heard."""

    focal_px: float = 602.0
    width: int = 640
    height: int = 480
    disparity_error_px: float = 1.0
    threshold: ErrorThreshold = ErrorThreshold(0.1, True)
    focal_v_px: Optional[float] = None
    heard_of: str = ""

    def focal_along(self, axis: str) -> float:
        """Focal length (px) that counts for disparities along a baseline's axis."""
        return self.focal_px if axis == "horizontal" or self.focal_v_px is None else self.focal_v_px

    def fov_rad(self, axis: str) -> float:
        """Whole angle of view along a baseline's axis."""
        size = self.width if axis == "horizontal" else self.height
        return 2.0 * float(np.arctan(size / 2.0 / self.focal_along(axis)))

    @property
    def words(self) -> str:
        """Says of whose camera ranges and errors are.

        >>> Optics().words
        'the usual camera (640x480, f 602 px): no camera_info is heard'
        >>> Optics(700.4, 800, 600, heard_of="uav1").words
        "uav1's own camera (800x600, f 700 px)"
        """
        size = f"({self.width}x{self.height}, f {self.focal_px:.0f} px)"
        if self.heard_of:
            return f"{self.heard_of}'s own camera {size}"
        return f"the usual camera {size}: no camera_info is heard"


USUAL = Optics()


@dataclass(frozen=True)
class ConfigurationRow:
    """One configuration; lengths in m. ``farthest_m``: equation 3.1; ``error_m``: equation 2.12 at
    that range."""

    index: int
    title: str
    axis: str
    baseline_m: float
    tilt_deg: float
    record_s: float
    settle_s: float
    vehicle: str
    nearest_m: float
    farthest_m: float
    error_m: float
    goal_m: Tuple[float, float, float]
    goal_heading_rad: float
    # of a sweep: its beginning and its end
    way_m: Optional[Tuple[Tuple[float, float, float], ...]] = None
    station: str = ""  # and its heading, to the left of x
    follows: bool = False  # for ``record_s``, and is not recorded


@dataclass(frozen=True)
class FileError:
    """``line``: counted from 1; 0: the file as a whole."""

    line: int
    text: str

    @property
    def words(self) -> str:
        return f"line {self.line}: {self.text}" if self.line else self.text


@dataclass(frozen=True)
class MissionFile:
    """A file as it was read; ``mission`` is None where it cannot be flown, then ``error`` says
    why."""

    source: str = ""
    text: str = ""
    mission: Optional[Mission] = None
    rows: Tuple[ConfigurationRow, ...] = ()
    error: Optional[FileError] = None


def load(path, optics: Optics = USUAL) -> MissionFile:
    """Loads a mission from a file; one that cannot be read is an error like any other."""
    try:
        return parse(Path(path).read_text(), str(path), optics)
    except (OSError, UnicodeDecodeError) as error:
        return MissionFile(str(path), error=FileError(0, f"cannot be read: {error}"))


def parse(text: str, source: str = "", optics: Optics = USUAL) -> MissionFile:
    """Parses a mission from what an editor holds.

    >>> parse("name: a\\nconfigurations:\\n  - {axis: horizontal, baseline_m: -2.0}\\n").error.words
    'line 3: configurations[0].baseline_m: -2.0 must be positive; the axis says the direction'
    """
    try:
        document = strict_yaml.parse(text)
        mission = config.from_mapping(document, Mission, source or "mission")
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = FileError(mark.line + 1 if mark else 0, f"not YAML: {error_words(error)}")
        return MissionFile(source, text, error=where)
    except ConfigError as error:
        where = f"{error.field}: " if error.field else ""
        return MissionFile(
            source,
            text,
            error=FileError(config.line_of(text, error.field), f"{where}{error.problem}"),
        )
    return MissionFile(source, text, mission, _rows(mission, optics))


def error_words(error: yaml.YAMLError) -> str:
    """What the parser says, on one line."""
    return str(getattr(error, "problem", None) or error).replace("\n", " ")


def _rows(mission: Mission, optics: Optics) -> Tuple[ConfigurationRow, ...]:
    return tuple(_row(i, mission, optics) for i in range(len(mission.configurations)))


def _row(i: int, mission: Mission, optics: Optics) -> ConfigurationRow:
    c = mission.configurations[i]
    far_m = farthest(
        c.baseline_m, optics.focal_along(c.axis), optics.threshold, optics.disparity_error_px
    )
    error_m = float(
        depth_error(far_m, c.baseline_m, optics.focal_along(c.axis), optics.disparity_error_px)
    )
    T_home_cam = mover_place(mission, i)
    x, y, z = (float(v) for v in T_home_cam[:3, 3])
    view = mission.viewpoint(i)
    settle_s, record_s, way_m = mission.settle.time_s, c.stands_s, None
    if c.follow_s is not None:
        settle_s = 0.0
    if c.sweep is not None:
        settle_s, record_s = 0.0, round(c.sweep.takes_s(mission.flight), 1)
        way_m = ((x, y, z), tuple(mover_end(mission, i)[:3, 3].tolist()))
    return ConfigurationRow(
        i,
        mission.title(i),
        c.axis,
        c.baseline_m,
        c.tilt_deg,
        record_s,
        settle_s,
        c.vehicle or "",
        overlap_starts_m(c.baseline_m, optics.fov_rad(c.axis), c.tilt_rad),
        far_m,
        error_m,
        (x, y, z),
        heading_rad(T_home_cam),
        way_m,
        f"{view.station} {math.degrees(view.heading_rad):.0f}°" if mission.stations else "",
        mission.follows(i),
    )


def differs(flown: Optional[Mission], shown: Optional[Mission]) -> str:
    """What the mission flies otherwise than the file that is shown says; "" where nothing, or one
    is not known."""
    if flown is None or shown is None or flown == shown:
        return ""
    for i, (a, b) in enumerate(zip(flown.configurations, shown.configurations)):
        if a != b:
            return f"configuration {i + 1}: {_apart(a, b)}"
    found = [
        n.name
        for n in dataclasses.fields(Mission)
        if getattr(flown, n.name) != getattr(shown, n.name)
    ]
    return "" if found == ["name"] else f"other {' and '.join(n for n in found if n != 'name')}"


def _apart(flown, shown) -> str:
    """Says the difference of two configurations."""
    names = [
        n.name
        for n in dataclasses.fields(flown)
        if getattr(flown, n.name) != getattr(shown, n.name)
    ]
    return ", ".join(f"{n} is {getattr(flown, n)} there, {getattr(shown, n)} here" for n in names)


def overlap_share(row: ConfigurationRow, z_m: float, optics: Optics) -> float:
    """Share (0..1) of the reference picture that both cameras see at depth ``z_m``."""
    return 1.0 - float(
        non_overlap(z_m, row.baseline_m, optics.fov_rad(row.axis), float(np.radians(row.tilt_deg)))
    )


def seconds_left(mission_file: MissionFile, first: int, vehicles: int = 2) -> float:
    """Flight time (s) of so many vehicles from configuration ``first`` on, by the mission's speeds,
    with settling, recording and looking round."""
    mission = mission_file.mission
    if mission is None:
        return float("nan")
    total_s = turns_s(mission, range(first, len(mission_file.rows)), 0 if first else vehicles)
    here = np.zeros(3)
    for row in mission_file.rows[first:]:
        way = np.array(row.goal_m) - here
        total_s += mission.flight.leg_s(float(np.hypot(way[0], way[1])), float(way[2]))
        total_s += row.settle_s + row.record_s + _TURN_S
        here = np.array(row.goal_m if row.way_m is None else row.way_m[1])
    return total_s


def stepped(baseline_m: float) -> float:
    """Rounds the length in whole steps, never under one of them.

    >>> stepped(3.04), stepped(-2.0)
    (3.0, 0.1)
    """
    return round(max(STEP_M, round(baseline_m / STEP_M) * STEP_M), 3)


def changed(
    file: MissionFile, index: int, field: str, value: float, optics: Optics
) -> Tuple[MissionFile, str]:
    """Gives the file with another value of one configuration's field, and ""; or as it was, and
    why: it could not be flown."""
    if file.mission is None or not 0 <= index < len(file.rows):
        return file, "there is no such configuration"
    if file.mission.stations:
        return file, "its list is flown at several stations: change it in the file"
    found = parse(with_value(file.text, index, field, value), file.source, optics)
    return (file, found.error.text) if found.error else (found, "")


def with_value(text: str, index: int, field: str, value: float) -> str:
    """The file's text with another value of a configuration's field; all else, comments too, as it
    was.

    >>> with_value("configurations: # two\\n  - {axis: vertical, baseline_m: 5.0}  # up\\n", 0, "baseline_m", 6.5)
    'configurations: # two\\n  - {axis: vertical, baseline_m: 6.5}  # up\\n'
    >>> with_value("configurations:\\n  - axis: horizontal\\n    baseline_m: 5.0\\n", 0, "tilt_deg", -4.0)
    'configurations:\\n  - axis: horizontal\\n    baseline_m: 5.0\\n    tilt_deg: -4.0\\n'
    """
    node = yaml.compose(text)
    listed = next(v for k, v in node.value if k.value == "configurations")
    mapping = listed.value[index]
    words = f"{value:.3f}".rstrip("0").rstrip(".") + (".0" if value == int(value) else "")
    there = next((v for k, v in mapping.value if k.value == field), None)
    if there is not None:
        return text[: there.start_mark.index] + words + text[there.end_mark.index :]
    key, after = mapping.value[-1]
    between = ", " if mapping.flow_style else "\n" + " " * key.start_mark.column
    return (
        text[: after.end_mark.index] + f"{between}{field}: {words}" + text[after.end_mark.index :]
    )
