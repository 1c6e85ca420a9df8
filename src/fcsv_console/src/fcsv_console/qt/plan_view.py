# SPDX-License-Identifier: Apache-2.0
"""Home from above, drawn by ourselves: vehicles with headings and fields of view, goals, fence, height bar."""

import math
from typing import List, Optional

from python_qt_binding.QtCore import QPointF, QRectF, Qt, Signal
from python_qt_binding.QtGui import QColor, QPainter, QPainterPath, QPalette, QPen, QPolygonF
from python_qt_binding.QtWidgets import QWidget

from fcsv_console.model import above_view as geometry
from fcsv_console.model import cells
from fcsv_console.model.gauges import gauges as gauges_of
from fcsv_console.model.vehicles import VehicleRow
from fcsv_console.model.view import View
from fcsv_console.qt import colours, gauges

_BAR_PX, _LEAST_RADIUS_PX, _VIEW_M = 64.0, 9.0, 6.0
_STEPS = {Qt.Key_Right: 1, Qt.Key_Left: -1, Qt.Key_Up: 1, Qt.Key_Down: -1}
_TURNS = {Qt.Key_PageDown: 1, Qt.Key_PageUp: -1}
_RINGS_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


class PlanView(QWidget):
    """``goal_changed`` (index, baseline in m) and ``goal_turned`` (index, tilt in degrees) only while ``editable``; the
    wheel changes a vertical goal's height. Page up and down choose a goal, arrows move it, with shift turn it."""

    goal_changed, goal_turned = Signal(int, float), Signal(int, float)

    def __init__(self, fov_rad: float, parent=None):
        super().__init__(parent)
        self._view: Optional[View] = None
        self._fov_rad, self._zoom, self.editable = fov_rad, 1.0, False
        self._held = self._turned = self._chosen = None  # type: Optional[int] # by mouse, by its knob, by keys
        self._mouse = QPointF(0.0, 0.0)
        self._taken: List[geometry.Box] = []  # by what stands in the picture already
        self.setMinimumSize(300, 120)
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.StrongFocus)
        self.setAccessibleName("Plan view from above")

    def show_view(self, view: View) -> None:
        """Draw this from now on; words for a screen reader besides."""
        self._view = view
        words = [a.words for a in view.above] or ["nobody is above another"]
        words += [g.words for g in gauges_of(view)]
        row = self._row(self._chosen)
        words += [] if row is None else [f"goal {row.index + 1} is chosen: {row.title}"]
        self.setAccessibleDescription("; ".join(words))
        self.update()

    def _row(self, index: Optional[int]):
        """None where nothing is chosen, or the list has become shorter."""
        rows = self._view.file.rows if self._view is not None else ()
        return rows[index] if index is not None and index < len(rows) else None

    @property
    def scale(self) -> geometry.Scale:
        """As it is drawn now."""
        return geometry.fitted(self._view, self.width() - _BAR_PX, self.height(), self._zoom)

    @property
    def bar(self) -> geometry.HeightBar:
        """As it is drawn now."""
        return geometry.HeightBar(*geometry.heights(self._view), self.height())

    # ---- mouse ---------------------------------------------------------------------------------------------------

    def mousePressEvent(self, event) -> None:
        if self.editable and self._view is not None:
            rows, scale, at = self._view.file.rows, self.scale, (event.x(), event.y())
            self._turned = geometry.handle_picked(rows, scale, *at)
            self._held = geometry.picked(rows, scale, *at) if self._turned is None else None

    def mouseReleaseEvent(self, event) -> None:
        turned, self._turned = self._row(self._turned), None
        if turned is not None:
            self._turn(turned, geometry.turned(turned, self.scale, event.x(), event.y()))
        if self._held is not None:
            row = self._view.file.rows[self._held]
            baseline_m = geometry.dragged(row, self.scale, event.x(), event.y())
            self._held = None
            if baseline_m != row.baseline_m:
                self.goal_changed.emit(row.index, baseline_m)
        self.update()

    def mouseMoveEvent(self, event) -> None:
        self._mouse = QPointF(event.x(), event.y())
        if self._held is not None or self._turned is not None:
            self.update()

    def keyPressEvent(self, event) -> None:
        row, step = self._row(self._chosen) if self.editable else None, _STEPS.get(event.key(), 0)
        if event.key() in _TURNS and self.editable and self._view is not None:
            self._chosen = geometry.following(self._view.file.rows, self._chosen, _TURNS[event.key()])
            self.show_view(self._view)
        elif step and row is not None:
            if event.modifiers() & Qt.ShiftModifier:
                self._turn(row, geometry.within_tilt(row.tilt_deg - step))
            else:
                self.goal_changed.emit(row.index, geometry.stepped(row.baseline_m + geometry.STEP_M * step))
        else:
            super().keyPressEvent(event)

    def _turn(self, row, tilt_deg: float) -> None:
        """A vertical one has no tilt: a hovering multirotor cannot pitch a fixed camera."""
        if row.axis == "horizontal" and tilt_deg != row.tilt_deg:
            self.goal_turned.emit(row.index, tilt_deg)

    def wheelEvent(self, event) -> None:
        notches = event.angleDelta().y() / 120.0
        if self._mouse.x() < self.width() - _BAR_PX:
            self.zoom(1.15**notches)
            return
        rows = self._view.file.rows if self._view is not None and self.editable else ()
        index = self.bar.picked(rows, self._mouse.y()) if rows else None
        if index is not None:
            self.goal_changed.emit(index, geometry.wheeled(rows[index], notches))

    def zoom(self, factor: float) -> None:
        """Nearer or further."""
        self._zoom = min(20.0, max(0.1, self._zoom * factor))
        self.update()

    # ---- drawing -------------------------------------------------------------------------------------------------

    def paintEvent(self, _event) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.Antialiasing)
        painter.fillRect(self.rect(), self.palette().color(QPalette.Base))
        if self._view is None:
            return
        scale = self.scale
        self._taken = []
        self._grid(painter, scale)
        self._fence(painter, scale)
        self._goals(painter, scale)
        for k, vehicle in enumerate(self._view.vehicles):
            self._vehicle(painter, scale, vehicle, k)
        self._names(painter, scale)
        self._fall(painter, scale)
        gauges.draw(painter, gauges_of(self._view), self.palette(), self.height())
        self._bar(painter)

    def _ink(self, alpha: int) -> QColor:
        colour = QColor(self.palette().color(QPalette.WindowText))
        colour.setAlpha(alpha)
        return colour

    def _tone(self, name: str) -> QColor:
        return colours.tone(name, self.palette())

    def _at(self, scale: geometry.Scale, x_m: float, y_m: float) -> QPointF:
        return QPointF(*scale.to_px(x_m, y_m))

    def _grid(self, painter: QPainter, scale: geometry.Scale) -> None:
        step_m = next((m for m in _RINGS_M if m * scale.px_per_m > 55.0), _RINGS_M[-1])
        middle = self._at(scale, 0.0, 0.0)
        painter.setBrush(Qt.NoBrush)
        for k in range(1, 13):
            radius = k * step_m * scale.px_per_m
            painter.setPen(QPen(self._ink(36), 1.0))
            painter.drawEllipse(middle, radius, radius)
            painter.setPen(self._ink(110))
            painter.drawText(middle + QPointF(3.0, -radius - 2.0), f"{k * step_m:g} m")
        painter.setPen(QPen(self._ink(150), 1.5))
        for dx, dy in ((8.0, 0.0), (0.0, 8.0)):
            painter.drawLine(middle - QPointF(dx, dy), middle + QPointF(dx, dy))

    def _fence(self, painter: QPainter, scale: geometry.Scale) -> None:
        mission = self._view.file.mission
        if mission is None:
            return
        painter.setPen(QPen(self._tone(cells.BAD), 1.5, Qt.DashLine))
        painter.setBrush(Qt.NoBrush)
        radius = mission.fence.radius_m * scale.px_per_m
        painter.drawEllipse(self._at(scale, 0.0, 0.0), radius, radius)
        if mission.fence.polygon:
            painter.drawPolygon(QPolygonF([self._at(scale, x, y) for x, y in mission.fence.polygon]))

    def _goals(self, painter: QPainter, scale: geometry.Scale) -> None:
        for row in self._view.file.rows:
            running = row.index == self._view.running
            at = self._at(scale, row.goal_m[0], row.goal_m[1])
            baseline_m = row.baseline_m
            if row.index == self._held:
                baseline_m = geometry.dragged(row, scale, self._mouse.x(), self._mouse.y())
                at = self._at(scale, 0.0, -baseline_m if row.axis == "horizontal" else 0.0)
            painter.setPen(QPen(self._tone(cells.GOOD) if running else self._ink(150), 2.0 if running else 1.0))
            painter.setBrush(self._tone(cells.GOOD) if running else Qt.NoBrush)
            if row.way_m is not None:
                painter.drawLine(*(self._at(scale, x, y) for x, y, _ in row.way_m))
            if row.axis == "vertical":
                continue  # they stand on the height bar: from above they are home
            painter.drawPolygon(QPolygonF([at + QPointF(*d) for d in ((0, -6), (6, 0), (0, 6), (-6, 0))]))
            if row.index == self._chosen:
                painter.drawRect(QRectF(at.x() - 10.0, at.y() - 10.0, 20.0, 20.0))
            if self.editable and row.way_m is None:
                self._handle(painter, scale, row, at)
            painter.setPen(self._tone(cells.GOOD) if running else self._ink(170))
            painter.drawText(QRectF(at.x() - 30.0, at.y() + 8.0, 60.0, 16.0), Qt.AlignCenter, f"{baseline_m:g}")
            self._taken.append((at.x() - 9.0, at.y() - 6.0, 18.0, 30.0))

    def _handle(self, painter: QPainter, scale: geometry.Scale, row, at: QPointF) -> None:
        """A line along the camera's view with a knob at its end; while it is dragged, its degrees."""
        end = QPointF(*geometry.handle(row, scale)) - self._at(scale, row.goal_m[0], row.goal_m[1])
        if row.index == self._turned:
            tilt_deg = geometry.turned(row, scale, self._mouse.x(), self._mouse.y())
            heading, reach = math.radians(tilt_deg), math.hypot(end.x(), end.y())
            end = QPointF(-reach * math.sin(heading), -reach * math.cos(heading))
            painter.drawText(at + end + QPointF(8.0, 0.0), f"{tilt_deg:+.0f}°")
        painter.drawLine(at, at + end)
        painter.drawEllipse(at + end, 5.0, 5.0)

    def _vehicle(self, painter: QPainter, scale: geometry.Scale, v: VehicleRow, k: int) -> None:
        place, colour = v.place.value, QColor(colours.VEHICLES[k % len(colours.VEHICLES)])
        if place is None:
            return
        at, heading = self._at(scale, place.p_home_m[0], place.p_home_m[1]), place.heading_rad
        if v.place.stale:
            colour = self._tone(cells.GONE)
        forward = QPointF(-math.sin(heading), -math.cos(heading))
        wedge, reach = QPainterPath(at), _VIEW_M * scale.px_per_m
        half_deg, up_deg = math.degrees(self._fov_rad) / 2.0, 90.0 + math.degrees(heading)
        wedge.arcTo(QRectF(at.x() - reach, at.y() - reach, 2 * reach, 2 * reach), up_deg - half_deg, 2 * half_deg)
        fill = QColor(colour)
        fill.setAlpha(0 if v.place.stale else 34)
        painter.fillPath(wedge, fill)
        radius = max(_LEAST_RADIUS_PX, 0.25 * scale.px_per_m)
        painter.setPen(QPen(colour, 2.0, Qt.DashLine if v.place.stale else Qt.SolidLine))
        painter.setBrush(Qt.NoBrush if v.place.stale else colour)
        painter.drawEllipse(at, radius, radius)
        painter.drawLine(at, at + forward * (radius + 12.0))
        self._taken.append((at.x() - radius, at.y() - radius, 2.0 * radius, 2.0 * radius))

    def _names(self, painter: QPainter, scale: geometry.Scale) -> None:
        """Of vehicles, with their heights, and of home; each where it hides least."""
        for v in self._view.vehicles:
            if v.place.value is not None:
                x, y, z = v.place.value.p_home_m
                age = f", {v.place.words} old" if v.place.stale else ""
                self._label(painter, self._at(scale, x, y), f"{v.name}  {round(z, 1) + 0.0:+.1f} m{age}")
        self._label(painter, self._at(scale, 0.0, 0.0), "home")

    def _label(self, painter: QPainter, at: QPointF, words: str) -> QRectF:
        """Beside ``at``, on a ground of its own, so that it can be read over rings; where it was written."""
        size = painter.boundingRect(QRectF(0.0, 0.0, 1.0, 1.0), Qt.AlignLeft | Qt.TextDontClip, words)
        wide, high = size.width(), size.height()
        places = [(at.x() + right, at.y() + down, wide, high) for down in (-high - 8.0, 28.0, -2.0 * high - 12.0,
                  high + 34.0) for right in (12.0, -wide - 12.0, -0.5 * wide)]  # fmt: skip
        room = (4.0, 2.0, self.width() - _BAR_PX - 10.0, self.height() - 4.0)
        box = QRectF(*geometry.free(places, self._taken, room))
        self._taken.append((box.x(), box.y(), wide, high))
        ground = QColor(self.palette().color(QPalette.Base))
        ground.setAlpha(210)
        painter.fillRect(box.adjusted(-3.0, 0.0, 3.0, 0.0), ground)
        painter.setPen(self._ink(255))
        painter.drawText(box, Qt.AlignLeft | Qt.TextDontClip, words)
        return box

    def _fall(self, painter: QPainter, scale: geometry.Scale) -> None:
        for k, a in enumerate(self._view.above):
            at = self._at(scale, *a.down_m)
            painter.setPen(QPen(self._tone(cells.CARE), 2.5, Qt.DotLine))
            painter.setBrush(Qt.NoBrush)
            painter.drawEllipse(at, 20.0, 20.0)
            painter.setPen(self._tone(cells.CARE))
            ground = QColor(self.palette().color(QPalette.Base))
            ground.setAlpha(225)
            box = QRectF(8.0, 6.0 + 36.0 * k, self.width() - _BAR_PX - 16.0, 36.0)
            painter.fillRect(box, ground)
            painter.drawText(box, Qt.AlignLeft | Qt.AlignTop | Qt.TextWordWrap, a.words)

    def _bar(self, painter: QPainter) -> None:
        """Heights in home; vertical goals as lines, vehicles as arrows."""
        bar, left = self.bar, self.width() - _BAR_PX + 26.0
        level, low_m, high_m = bar.to_px, bar.low_m, bar.high_m
        painter.fillRect(QRectF(self.width() - _BAR_PX, 0.0, _BAR_PX, self.height()),
                         self.palette().color(QPalette.Window))  # fmt: skip
        painter.setPen(QPen(self._ink(150), 1.0))
        painter.drawLine(QPointF(left, level(high_m)), QPointF(left, level(low_m)))
        step_m = next((m for m in _RINGS_M if m * bar.px_per_m > 26.0), _RINGS_M[-1])
        for k in range(math.ceil(low_m / step_m), math.floor(high_m / step_m) + 1):
            painter.drawLine(QPointF(left - 4.0, level(k * step_m)), QPointF(left, level(k * step_m)))
            box = QRectF(left - 28.0, level(k * step_m) - 8.0, 22.0, 16.0)
            painter.drawText(box, Qt.AlignRight | Qt.AlignVCenter, f"{k * step_m:g}")
        for row in self._view.file.rows:
            if row.axis == "vertical":
                running = row.index == self._view.running
                painter.setPen(QPen(self._tone(cells.GOOD) if running else self._ink(150), 3.0 if running else 1.5))
                painter.drawLine(QPointF(left, level(row.goal_m[2])), QPointF(left + 14.0, level(row.goal_m[2])))
        for k, v in enumerate(self._view.vehicles):
            if v.place.value is not None:
                z = level(v.place.value.p_home_m[2])
                colour = QColor(colours.VEHICLES[k % len(colours.VEHICLES)])
                painter.setPen(Qt.NoPen)
                painter.setBrush(self._tone(cells.GONE) if v.place.stale else colour)
                tip = left + 3.0 + 13.0 * k
                corners = (tip, z), (tip + 11.0, z - 6.0), (tip + 11.0, z + 6.0)
                painter.drawPolygon(QPolygonF([QPointF(*c) for c in corners]))
