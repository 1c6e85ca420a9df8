# SPDX-License-Identifier: Apache-2.0
"""How the view from above is painted: ground and route of a robot, rings, fence, what cameras on the
ground see, stations, goals, vehicles with names, where one would fall, height bar."""

import math
from dataclasses import dataclass
from typing import List, Optional, Tuple

import numpy as np
from python_qt_binding.QtCore import QPointF, QRectF, QSizeF, Qt
from python_qt_binding.QtGui import (
    QColor,
    QImage,
    QPainter,
    QPainterPath,
    QPalette,
    QPen,
    QPolygonF,
)

from fcsv_console.model import above_view as geometry
from fcsv_console.model import cells
from fcsv_console.model.gauges import gauges as gauges_of
from fcsv_console.model.vehicles import VehicleRow
from fcsv_console.model.view import ConsoleView
from fcsv_console.qt import colours, gauges

BAR_PX = 64.0
_LEAST_RADIUS_PX, _STATION_PX = 9.0, 7.0
_GROUND_ALPHA = 110
_RINGS_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


@dataclass(frozen=True)
class Hand:
    """What the operator has hold of: goals by mouse, by its knob, by keys; ``at_px``: where the
    mouse is."""

    editable: bool = False
    held: Optional[int] = None
    turned: Optional[int] = None
    chosen: Optional[int] = None
    at_px: Tuple[float, float] = (0.0, 0.0)


class PlanPicture:
    """Paints the plan of one moment: made for one painting, ``paint`` once."""

    def __init__(
        self,
        painter: QPainter,
        view: ConsoleView,
        scale: geometry.ViewScale,
        bar: geometry.HeightBar,
        hand: Hand,
        palette: QPalette,
        fov_rad: float,
    ):
        self._painter, self._view, self._scale, self._bar, self._hand = (
            painter,
            view,
            scale,
            bar,
            hand,
        )
        self._palette, self._fov_rad = palette, fov_rad
        self._width, self._height = scale.width + BAR_PX, scale.height
        self.taken: List[geometry.Box] = []  # by what stands in the picture already

    def paint(self) -> None:
        """Everything, from the ground up."""
        self._robot_ground()
        self._grid()
        self._fence()
        self._ground_views()
        self._stations()
        self._goals()
        self._robot()
        for k, vehicle in enumerate(self._view.vehicles):
            self._vehicle(vehicle, k)
        self._names()
        self._fall()
        gauges.draw(self._painter, gauges_of(self._view), self._palette, self._height)
        self._heights()

    def _ink(self, alpha: int) -> QColor:
        colour = QColor(self._palette.color(QPalette.WindowText))
        colour.setAlpha(alpha)
        return colour

    def _tone(self, name: str) -> QColor:
        return colours.tone(name, self._palette)

    def _gone(self) -> QColor:
        """Gives the colour of what is not heard any more; after the flight that is nothing to worry
        about."""
        return self._tone(cells.QUIET if self._view.ended else cells.GONE)

    def _at(self, x_m: float, y_m: float) -> QPointF:
        return QPointF(*self._scale.to_px(x_m, y_m))

    def _grid(self) -> None:
        step_m = next((m for m in _RINGS_M if m * self._scale.px_per_m > 55.0), _RINGS_M[-1])
        middle = self._at(0.0, 0.0)
        self._painter.setBrush(Qt.NoBrush)
        for k in range(1, 13):
            radius = k * step_m * self._scale.px_per_m
            self._painter.setPen(QPen(self._ink(36), 1.0))
            self._painter.drawEllipse(middle, radius, radius)
            self._painter.setPen(self._ink(110))
            self._painter.drawText(middle + QPointF(3.0, -radius - 2.0), f"{k * step_m:g} m")
        self._painter.setPen(QPen(self._ink(150), 1.5))
        for dx, dy in ((8.0, 0.0), (0.0, 8.0)):
            self._painter.drawLine(middle - QPointF(dx, dy), middle + QPointF(dx, dy))

    def _fence(self) -> None:
        mission = self._view.file.mission
        if mission is None:
            return
        self._painter.setPen(QPen(self._tone(cells.BAD), 1.5, Qt.DashLine))
        self._painter.setBrush(Qt.NoBrush)
        radius = mission.fence.radius_m * self._scale.px_per_m
        self._painter.drawEllipse(self._at(0.0, 0.0), radius, radius)
        if mission.fence.polygon:
            self._painter.drawPolygon(QPolygonF([self._at(x, y) for x, y in mission.fence.polygon]))

    def _ground_views(self) -> None:
        """Paints the views of the mocap in the colour of words, of a gimbal in that of the vehicle
        that it follows."""
        names = [v.name for v in self._view.vehicles]
        for seen in self._view.ground_views:
            colour = self._ink(255)
            if seen.vehicle in names:
                colour = QColor(colours.VEHICLES[names.index(seen.vehicle) % len(colours.VEHICLES)])
            fill = QColor(colour)
            fill.setAlpha(24)
            self._painter.setPen(QPen(colour, 1.5, Qt.DashDotLine))
            self._painter.setBrush(fill)
            self._painter.drawPolygon(QPolygonF([self._at(x, y) for x, y in seen.outline_m]))
            self._painter.setBrush(colour)
            self._painter.drawRect(
                QRectF(self._at(*seen.eye_m) - QPointF(4.0, 4.0), QSizeF(8.0, 8.0))
            )

    def _stations(self) -> None:
        """Paints stations as rings, with a line along each heading; the running one filled."""
        for mark in geometry.stations(self._view):
            at, ink = self._at(*mark.place_m), self._ink(170)
            if mark.running:
                ink = self._tone(cells.GOOD)
            self._painter.setPen(QPen(ink, 2.0))
            self._painter.setBrush(ink if mark.running else Qt.NoBrush)
            self._painter.drawEllipse(at, _STATION_PX, _STATION_PX)
            for heading in mark.headings_rad:
                ahead = QPointF(-math.sin(heading), -math.cos(heading))
                self._painter.drawLine(at + _STATION_PX * ahead, at + 3.0 * _STATION_PX * ahead)
            self.taken.append(
                (at.x() - _STATION_PX, at.y() - _STATION_PX, 2.0 * _STATION_PX, 2.0 * _STATION_PX)
            )

    def _robot_ground(self) -> None:
        """Paints the cells of a guided robot: known ones by how surely it can be there."""
        ground = self._view.guided_robot.ground
        if ground is None:
            return
        percents = np.frombuffer(ground.percents, np.int8).reshape(ground.rows, ground.columns)
        table = [QColor(colours.GROUND_FREE), QColor(colours.GROUND_OBSTACLE)]
        free, obstacle = (np.array([c.blue(), c.green(), c.red()], float) for c in table)
        share = np.clip(percents, 0, 100)[..., None] / 100.0
        argb = np.empty((*percents.shape, 4), np.uint8)
        argb[..., :3] = (1.0 - share) * free + share * obstacle
        argb[..., 3] = np.where(percents < 0, 0, _GROUND_ALPHA)
        # x up, y to the left
        turned = np.ascontiguousarray(argb.transpose(1, 0, 2)[::-1, ::-1])
        high, wide = turned.shape[:2]
        image = QImage(turned.data, wide, high, 4 * wide, QImage.Format_ARGB32)
        x1_m = ground.x0_m + ground.columns * ground.cell_m
        y1_m = ground.y0_m + ground.rows * ground.cell_m
        box = QRectF(self._at(x1_m, y1_m), self._at(ground.x0_m, ground.y0_m))
        self._painter.drawImage(box, image)

    def _robot(self) -> None:
        """Paints a guided robot and its route."""
        guided = self._view.guided_robot
        self._painter.setBrush(Qt.NoBrush)
        if guided.route_m:
            self._painter.setPen(QPen(QColor(colours.ROUTE), 2.5))
            self._painter.drawPolyline(QPolygonF([self._at(x, y) for x, y in guided.route_m]))
        seen = guided.robot.value
        if seen is None:
            return
        at = self._at(seen.x_m, seen.y_m)
        colour = self._gone() if guided.robot.stale else QColor(colours.ROUTE)
        self._painter.setPen(QPen(colour, 2.0))
        self._painter.setBrush(Qt.NoBrush if guided.robot.stale else colour)
        ahead = QPointF(-math.sin(seen.yaw_rad), -math.cos(seen.yaw_rad))
        aside = QPointF(-ahead.y(), ahead.x())
        corners = (
            at + 11.0 * ahead,
            at - 7.0 * ahead + 7.0 * aside,
            at - 7.0 * ahead - 7.0 * aside,
        )
        self._painter.drawPolygon(QPolygonF(list(corners)))
        self.taken.append((at.x() - 9.0, at.y() - 9.0, 18.0, 18.0))

    def _goals(self) -> None:
        lengths = []  # where, what, colour
        for row in self._view.file.rows:
            running = row.index == self._view.running
            at = self._at(row.goal_m[0], row.goal_m[1])
            baseline_m = row.baseline_m
            if row.index == self._hand.held:
                baseline_m = geometry.dragged(row, self._scale, *self._hand.at_px)
                at = self._at(0.0, -baseline_m if row.axis == "horizontal" else 0.0)
            self._painter.setPen(
                QPen(self._tone(cells.GOOD) if running else self._ink(150), 2.0 if running else 1.0)
            )
            self._painter.setBrush(self._tone(cells.GOOD) if running else Qt.NoBrush)
            if row.way_m is not None:
                self._painter.drawLine(*(self._at(x, y) for x, y, _ in row.way_m))
            if row.axis == "vertical":
                continue  # they stand on the height bar: from above they are home
            self._painter.drawPolygon(
                QPolygonF([at + QPointF(*d) for d in ((0, -6), (6, 0), (0, 6), (-6, 0))])
            )
            if row.index == self._hand.chosen:
                self._painter.drawRect(QRectF(at.x() - 10.0, at.y() - 10.0, 20.0, 20.0))
            if self._hand.editable and row.way_m is None:
                self._handle(row, at)
            self.taken.append((at.x() - 6.0, at.y() - 6.0, 12.0, 12.0))
            lengths.append(
                (at, f"{baseline_m:g}", self._tone(cells.GOOD) if running else self._ink(170))
            )
        for at, words, ink in lengths:  # once all goals are there: none hides another
            self._painter.setPen(ink)
            wide = float(self._painter.fontMetrics().horizontalAdvance(words))
            places = [
                (at.x() + right, at.y() + down, wide, 16.0)
                for right, down in (
                    (-0.5 * wide, 8.0),
                    (-0.5 * wide, -24.0),
                    (10.0, -8.0),
                    (-10.0 - wide, -8.0),
                )
            ]
            box = geometry.free(places, self.taken, self._room)
            self.taken.append(box)
            self._painter.drawText(QRectF(*box), Qt.AlignCenter | Qt.TextDontClip, words)

    def _handle(self, row, at: QPointF) -> None:
        """A line along the camera's view with a knob at its end; while it is dragged, its
        degrees."""
        end = QPointF(*geometry.handle(row, self._scale)) - self._at(row.goal_m[0], row.goal_m[1])
        if row.index == self._hand.turned:
            tilt_deg = geometry.turned(row, self._scale, *self._hand.at_px)
            heading, reach = math.radians(tilt_deg), math.hypot(end.x(), end.y())
            end = QPointF(-reach * math.sin(heading), -reach * math.cos(heading))
            self._painter.drawText(at + end + QPointF(8.0, 0.0), f"{tilt_deg:+.0f}°")
        self._painter.drawLine(at, at + end)
        self._painter.drawEllipse(at + end, 5.0, 5.0)

    def _vehicle(self, v: VehicleRow, k: int) -> None:
        place, colour = v.place.value, QColor(colours.VEHICLES[k % len(colours.VEHICLES)])
        if place is None:
            return
        at, heading = self._at(place.p_home_m[0], place.p_home_m[1]), place.heading_rad
        if v.place.stale:
            colour = self._gone()
        forward = QPointF(-math.sin(heading), -math.cos(heading))
        wedge, reach = QPainterPath(at), geometry.VIEW_M * self._scale.px_per_m
        half_deg, up_deg = math.degrees(self._fov_rad) / 2.0, 90.0 + math.degrees(heading)
        wedge.arcTo(
            QRectF(at.x() - reach, at.y() - reach, 2 * reach, 2 * reach),
            up_deg - half_deg,
            2 * half_deg,
        )
        fill = QColor(colour)
        fill.setAlpha(0 if v.place.stale else 34)
        self._painter.fillPath(wedge, fill)
        radius = max(_LEAST_RADIUS_PX, 0.25 * self._scale.px_per_m)
        self._painter.setPen(QPen(colour, 2.0, Qt.DashLine if v.place.stale else Qt.SolidLine))
        self._painter.setBrush(Qt.NoBrush if v.place.stale else colour)
        self._painter.drawEllipse(at, radius, radius)
        self._painter.drawLine(at, at + forward * (radius + 12.0))
        self.taken.append((at.x() - radius, at.y() - radius, 2.0 * radius, 2.0 * radius))

    def _names(self) -> None:
        """Writes the names of vehicles, with their heights, of home and of cameras on the ground;
        each where it hides least."""
        for v in self._view.vehicles:
            if v.place.value is not None:
                x, y, _ = v.place.value.p_home_m
                age = f", {v.place.words} old" if v.place.stale else ""
                self.label(self._at(x, y), f"{v.name}  {cells.height(v)}{age}")
        self.label(self._at(0.0, 0.0), "home")
        for mark in geometry.stations(self._view):
            self.label(self._at(*mark.place_m), mark.name)
        for seen in self._view.ground_views:
            self.label(self._at(*seen.eye_m), seen.words)
        guided = self._view.guided_robot
        if guided.robot.value is not None:
            self.label(self._at(guided.robot.value.x_m, guided.robot.value.y_m), guided.name)

    @property
    def _room(self) -> geometry.Box:
        return 4.0, 2.0, self._width - BAR_PX - 10.0, self._height - 4.0

    def label(self, at: QPointF, words: str) -> QRectF:
        """Beside ``at``, on a ground of its own, so that it can be read over rings; where it was
        written."""
        size = self._painter.boundingRect(
            QRectF(0.0, 0.0, 1.0, 1.0), Qt.AlignLeft | Qt.TextDontClip, words
        )
        wide, high = size.width(), size.height()
        places = [
            (at.x() + right, at.y() + down, wide, high)
            for down in (-high - 8.0, 28.0, -2.0 * high - 12.0, high + 34.0)
            for right in (12.0, -wide - 12.0, -0.5 * wide)
        ]
        box = QRectF(*geometry.free(places, self.taken, self._room))
        self.taken.append((box.x(), box.y(), wide, high))
        ground = QColor(self._palette.color(QPalette.Base))
        ground.setAlpha(210)
        self._painter.fillRect(box.adjusted(-3.0, 0.0, 3.0, 0.0), ground)
        self._painter.setPen(self._ink(255))
        self._painter.drawText(box, Qt.AlignLeft | Qt.TextDontClip, words)
        return box

    def _fall(self) -> None:
        for k, a in enumerate(self._view.above):
            at = self._at(*a.down_m)
            self._painter.setPen(QPen(self._tone(cells.CARE), 2.5, Qt.DotLine))
            self._painter.setBrush(Qt.NoBrush)
            self._painter.drawEllipse(at, 20.0, 20.0)
            self._painter.setPen(self._tone(cells.CARE))
            ground = QColor(self._palette.color(QPalette.Base))
            ground.setAlpha(225)
            box = QRectF(8.0, 6.0 + 36.0 * k, self._width - BAR_PX - 16.0, 36.0)
            self._painter.fillRect(box, ground)
            self._painter.drawText(box, Qt.AlignLeft | Qt.AlignTop | Qt.TextWordWrap, a.words)

    def _heights(self) -> None:
        """Heights in home; vertical goals as lines, vehicles as arrows."""
        bar, left = self._bar, self._width - BAR_PX + 26.0
        level, low_m, high_m = bar.to_px, bar.low_m, bar.high_m
        self._painter.fillRect(
            QRectF(self._width - BAR_PX, 0.0, BAR_PX, self._height),
            self._palette.color(QPalette.Window),
        )
        self._painter.setPen(QPen(self._ink(150), 1.0))
        self._painter.drawLine(QPointF(left, level(high_m)), QPointF(left, level(low_m)))
        step_m = next((m for m in _RINGS_M if m * bar.px_per_m > 26.0), _RINGS_M[-1])
        for k in range(math.ceil(low_m / step_m), math.floor(high_m / step_m) + 1):
            self._painter.drawLine(
                QPointF(left - 4.0, level(k * step_m)), QPointF(left, level(k * step_m))
            )
            box = QRectF(left - 28.0, level(k * step_m) - 8.0, 22.0, 16.0)
            self._painter.drawText(box, Qt.AlignRight | Qt.AlignVCenter, f"{k * step_m:g}")
        for row in self._view.file.rows:
            if row.axis == "vertical":
                running = row.index == self._view.running
                ink = self._tone(cells.GOOD) if running else self._ink(150)
                self._painter.setPen(QPen(ink, 3.0 if running else 1.5))
                self._painter.drawLine(
                    QPointF(left, level(row.goal_m[2])), QPointF(left + 14.0, level(row.goal_m[2]))
                )
        for k, v in enumerate(self._view.vehicles):
            if v.place.value is not None:
                z = level(v.place.value.p_home_m[2])
                colour = QColor(colours.VEHICLES[k % len(colours.VEHICLES)])
                self._painter.setPen(Qt.NoPen)
                self._painter.setBrush(self._gone() if v.place.stale else colour)
                tip = left + 3.0 + 13.0 * k
                corners = (tip, z), (tip + 11.0, z - 6.0), (tip + 11.0, z + 6.0)
                self._painter.drawPolygon(QPolygonF([QPointF(*c) for c in corners]))
