# SPDX-License-Identifier: Apache-2.0
"""Geometry of the plan view: home as seen from above, x up, y to the left. No toolkit."""

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

from fcsv_console.model.facts import CameraPoseReport
from fcsv_console.model.mission_file import STEP_M, ConfigurationRow, stepped
from fcsv_console.model.view import ConsoleView

VIEW_M = 6.0  # so far a camera's view is drawn
_LEAST_M, _MARGIN = 6.0, 1.25
_PICK_PX = 14.0
_HANDLE_PX = 34.0  # from a goal to the handle that turns it
_MOST_TILT_DEG = 30.0  # as a mission has it
_BAR_MARGIN_PX = 16.0


@dataclass(frozen=True)
class ViewScale:
    """Maps places from home (m) to a picture (px) of ``width`` x ``height``; ``middle_m`` (x, y) is
    in its middle."""

    width: float
    height: float
    px_per_m: float
    middle_m: Tuple[float, float] = (0.0, 0.0)

    def to_px(self, x_m: float, y_m: float) -> Tuple[float, float]:
        """
        >>> ViewScale(200, 100, 10.0).to_px(2.0, -3.0)
        (130.0, 30.0)
        """
        return (
            self.width / 2.0 - (y_m - self.middle_m[1]) * self.px_per_m,
            self.height / 2.0 - (x_m - self.middle_m[0]) * self.px_per_m,
        )

    def to_m(self, u_px: float, v_px: float) -> Tuple[float, float]:
        """
        >>> ViewScale(200, 100, 10.0).to_m(130.0, 30.0)
        (2.0, -3.0)
        """
        return (
            (self.height / 2.0 - v_px) / self.px_per_m + self.middle_m[0],
            (self.width / 2.0 - u_px) / self.px_per_m + self.middle_m[1],
        )


@dataclass(frozen=True)
class StationMark:
    """A mission's station: its place (x, y m in home), headings, ``rows`` of the list that are flown
    there, and whether one of these is."""

    name: str
    place_m: Tuple[float, float]
    headings_rad: Tuple[float, ...]
    rows: Tuple[int, ...]
    running: bool

    @property
    def words(self) -> str:
        """What a screen reader says."""
        return f"station {self.name}{' is flown' if self.running else ''}"


def stations(view: ConsoleView) -> List[StationMark]:
    """The stations of the mission that is shown, in the order of flight."""
    mission, found = view.file.mission, []
    if mission is None or not mission.stations:
        return []
    views = mission.viewpoints[1:]
    for name in dict.fromkeys(v.station for v in views):
        of = [v for v in views if v.station == name]
        listed = range(len(mission.configurations))
        rows = tuple(i for i in listed if mission.viewpoint(i).station == name)
        headings = tuple(v.heading_rad for v in of)
        found.append(StationMark(name, of[0].place_m[:2], headings, rows, view.running in rows))
    return found


def station_picked(
    marks: Sequence[StationMark], scale: ViewScale, u_px: float, v_px: float
) -> Optional[StationMark]:
    """The station whose mark is under the mouse; of several the nearest."""
    near = [(math.dist(scale.to_px(*m.place_m), (u_px, v_px)), k) for k, m in enumerate(marks)]
    at = min((n for n in near if n[0] <= _PICK_PX), default=None)
    return None if at is None else marks[at[1]]


def fitted(
    view: ConsoleView, width: float, height: float, zoom: float = 1.0, fov_rad: float = 0.0
) -> ViewScale:
    """Goals, home, vehicles with what they see, what cameras on the ground see, and a robot with
    its route, in the picture."""
    points = [(0.0, 0.0), *((p[0], p[1]) for r in view.file.rows for p in r.way_m or [r.goal_m])]
    points += [
        (v.place.value.p_home_m[0], v.place.value.p_home_m[1])
        for v in view.vehicles
        if v.place.value
    ]
    points += [
        p for v in view.vehicles if v.place.value and fov_rad for p in sight(v.place.value, fov_rad)
    ]
    points += [p for seen in view.ground_views for p in seen.outline_m]
    points += view.guided_robot.points_m
    points += [mark.place_m for mark in stations(view)]
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    high_m, wide_m = (max(_LEAST_M, _MARGIN * (max(s) - min(s))) for s in (xs, ys))
    per_m = min(height / (high_m + 2.0), width / (wide_m + 2.0)) * zoom
    return ViewScale(
        width, height, max(per_m, 0.1), ((max(xs) + min(xs)) / 2.0, (max(ys) + min(ys)) / 2.0)
    )


def sight(place: CameraPoseReport, fov_rad: float) -> List[Tuple[float, float]]:
    """Corners of what is drawn of a camera's view, (x, y) in home.

    >>> [(round(x, 1), round(y, 1)) for x, y in sight(CameraPoseReport("uav1", (1.0, 2.0, 0.0), 0.0), math.pi / 2.0)]
    [(5.2, -2.2), (7.0, 2.0), (5.2, 6.2)]
    """
    x_m, y_m, _ = place.p_home_m
    ways = (place.heading_rad + share * fov_rad / 2.0 for share in (-1.0, 0.0, 1.0))
    return [(x_m + VIEW_M * math.cos(way), y_m + VIEW_M * math.sin(way)) for way in ways]


def heights(view: ConsoleView) -> Tuple[float, float]:
    """(lowest, highest) of the height bar, m in home."""
    zs = [0.0, *(p[2] for r in view.file.rows for p in r.way_m or [r.goal_m])]
    zs += [v.place.value.p_home_m[2] for v in view.vehicles if v.place.value]
    return min(zs) - 1.0, max(max(zs), min(zs) + 4.0) + 1.0


Box = Tuple[float, float, float, float]  # left, top, width, height in px


def free(places: Sequence[Box], taken: Sequence[Box], room: Box) -> Box:
    """Where a label hides least: of ``places``, the best first, the one that covers least of
    ``taken``.

    What stands out of ``room`` is moved into it first.

    >>> room = (0.0, 0.0, 100.0, 100.0)
    >>> free([(10.0, 10.0, 20.0, 10.0), (10.0, 50.0, 20.0, 10.0)], [(25.0, 5.0, 9.0, 9.0)], room)
    (10.0, 50.0, 20.0, 10.0)
    >>> free([(95.0, -4.0, 20.0, 10.0)], [], room)
    (80.0, 0.0, 20.0, 10.0)
    """
    inside = [_moved_into(place, room) for place in places]
    return min(inside, key=lambda place: sum(_shared(place, other) for other in taken))


def _moved_into(box: Box, room: Box) -> Box:
    left, top, wide, high = box
    left = max(room[0], min(left, room[0] + room[2] - wide))
    return left, max(room[1], min(top, room[1] + room[3] - high)), wide, high


def _shared(a: Box, b: Box) -> float:
    """Area in px²."""
    wide = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    high = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    return max(0.0, wide) * max(0.0, high)


@dataclass(frozen=True)
class HeightBar:
    """Maps heights from heights in home (m) to a picture of ``height`` px."""

    low_m: float
    high_m: float
    height: float

    @property
    def px_per_m(self) -> float:
        return (self.height - 2.0 * _BAR_MARGIN_PX) / (self.high_m - self.low_m)

    def to_px(self, z_m: float) -> float:
        """
        >>> HeightBar(-1.0, 9.0, 232.0).to_px(4.0)
        116.0
        """
        return _BAR_MARGIN_PX + (self.high_m - z_m) * self.px_per_m

    def picked(self, rows: Sequence[ConfigurationRow], v_px: float) -> Optional[int]:
        """The vertical configuration to stand at whose line is under the mouse."""
        distances = {
            r.index: abs(self.to_px(r.goal_m[2]) - v_px)
            for r in rows
            if r.axis == "vertical" and r.way_m is None
        }
        near = [i for i, d in distances.items() if d <= _PICK_PX]
        return min(near, key=lambda i: distances[i]) if near else None


def picked(
    rows: Sequence[ConfigurationRow], scale: ViewScale, u_px: float, v_px: float
) -> Optional[int]:
    """The horizontal configuration to stand at whose goal is under the mouse; of several the
    nearest."""
    distances = {
        r.index: math.dist(scale.to_px(r.goal_m[0], r.goal_m[1]), (u_px, v_px))
        for r in rows
        if r.axis == "horizontal" and r.way_m is None
    }
    near = [i for i, d in distances.items() if d <= _PICK_PX]
    return min(near, key=lambda i: distances[i]) if near else None


def dragged(row: ConfigurationRow, scale: ViewScale, u_px: float, v_px: float) -> float:
    """The baseline (m) of a horizontal configuration whose goal is dragged there; a vertical one
    keeps its own."""
    return stepped(-scale.to_m(u_px, v_px)[1]) if row.axis == "horizontal" else row.baseline_m


def following(rows: Sequence[ConfigurationRow], index: Optional[int], step: int) -> Optional[int]:
    """The next configuration to stand at (``step`` 1) or the one before (-1), round and round;
    None: there is none."""
    stands = [r.index for r in rows if r.way_m is None]
    if index not in stands:
        return stands[0] if stands else None
    return stands[(stands.index(index) + step) % len(stands)]


def handle(row: ConfigurationRow, scale: ViewScale) -> Tuple[float, float]:
    """Where the handle is (px) by which a horizontal goal is turned: along its camera's view."""
    u, v = scale.to_px(row.goal_m[0], row.goal_m[1])
    return u - _HANDLE_PX * math.sin(row.goal_heading_rad), v - _HANDLE_PX * math.cos(
        row.goal_heading_rad
    )


def handle_picked(
    rows: Sequence[ConfigurationRow], scale: ViewScale, u_px: float, v_px: float
) -> Optional[int]:
    """The horizontal configuration to stand at whose handle is under the mouse; of several the
    nearest."""
    distances = {
        r.index: math.dist(handle(r, scale), (u_px, v_px))
        for r in rows
        if r.axis == "horizontal" and r.way_m is None
    }
    near = [i for i, d in distances.items() if d <= _PICK_PX]
    return min(near, key=lambda i: distances[i]) if near else None


def turned(row: ConfigurationRow, scale: ViewScale, u_px: float, v_px: float) -> float:
    """The tilt (whole degrees, inward, to the left) of a horizontal configuration whose handle is
    dragged there."""
    u, v = scale.to_px(row.goal_m[0], row.goal_m[1])
    return within_tilt(math.degrees(math.atan2(u - u_px, v - v_px)))


def within_tilt(tilt_deg: float) -> float:
    """Clamps an angle in whole degrees, as far as a mission may turn a camera.

    >>> within_tilt(-4.4), within_tilt(95.0)
    (-4.0, 30.0)
    """
    return float(round(max(-_MOST_TILT_DEG, min(_MOST_TILT_DEG, tilt_deg)))) + 0.0


def wheeled(row: ConfigurationRow, notches: float) -> float:
    """The baseline of a vertical configuration after the wheel; a horizontal one keeps its own."""
    return (
        stepped(row.baseline_m + 5.0 * STEP_M * notches)
        if row.axis == "vertical"
        else row.baseline_m
    )
