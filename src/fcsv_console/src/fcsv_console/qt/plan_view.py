# SPDX-License-Identifier: Apache-2.0
"""Home from above: what mouse, wheel and keys do in it; plan_picture paints it."""

from typing import Optional

from python_qt_binding.QtCore import QPointF, Qt, Signal
from python_qt_binding.QtGui import QPainter, QPalette
from python_qt_binding.QtWidgets import QWidget

from fcsv_console.model import above_view as geometry
from fcsv_console.model.gauges import gauges as gauges_of
from fcsv_console.model.mission_file import USUAL
from fcsv_console.model.view import ConsoleView
from fcsv_console.qt.plan_picture import BAR_PX, Hand, PlanPicture

_STEPS = {Qt.Key_Right: 1, Qt.Key_Left: -1, Qt.Key_Up: 1, Qt.Key_Down: -1}
_TURNS = {Qt.Key_PageDown: 1, Qt.Key_PageUp: -1}


class PlanView(QWidget):
    """``goal_changed`` (index, baseline in m) and ``goal_turned`` (index, tilt in degrees) only
    while ``editable``; the wheel changes a vertical goal's height. Page up and down choose a goal,
    arrows move it, with shift turn it. ``station_chosen`` (rows of the list) where a station is
    clicked."""

    station_chosen = Signal(list)
    goal_changed, goal_turned = Signal(int, float), Signal(int, float)

    def __init__(self, parent=None):
        super().__init__(parent)
        self._view: Optional[ConsoleView] = None
        self._fov_rad, self._zoom, self.editable = USUAL.fov_rad("horizontal"), 1.0, False
        self._held = self._turned = self._chosen = None  # type: Optional[int] # by mouse, by its knob, by keys
        self._mouse = QPointF(0.0, 0.0)
        self.setMinimumSize(300, 120)
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.StrongFocus)
        self.setAccessibleName("Plan view from above")

    def show_view(self, view: ConsoleView) -> None:
        """Draw this from now on; words for a screen reader besides."""
        self._view, self._fov_rad = view, view.optics.fov_rad("horizontal")
        words = [a.words for a in view.above] or ["nobody is above another"]
        words += [g.words for g in gauges_of(view)]
        words += [mark.words for mark in geometry.stations(view)]
        words += [f"what the {seen.words} sees is drawn" for seen in view.ground_views]
        words += [f"robot: {view.guided_robot.words}"] if view.guided_robot.words else []
        row = self._row(self._chosen)
        words += [] if row is None else [f"goal {row.index + 1} is chosen: {row.title}"]
        self.setAccessibleDescription("; ".join(words))
        self.update()

    def _row(self, index: Optional[int]):
        """None where nothing is chosen, or the list has become shorter."""
        rows = self._view.file.rows if self._view is not None else ()
        return rows[index] if index is not None and index < len(rows) else None

    @property
    def scale(self) -> geometry.ViewScale:
        """Gives the scale as it is drawn now."""
        return geometry.fitted(
            self._view, self.width() - BAR_PX, self.height(), self._zoom, self._fov_rad
        )

    @property
    def bar(self) -> geometry.HeightBar:
        """Gives the bar as it is drawn now."""
        return geometry.HeightBar(*geometry.heights(self._view), self.height())

    # ---- mouse -----------------------------------------------------------------------------------

    def mousePressEvent(self, event) -> None:
        if self._view is not None:
            marks = geometry.stations(self._view)
            mark = geometry.station_picked(marks, self.scale, event.x(), event.y())
            if mark is not None:
                self.station_chosen.emit(list(mark.rows))
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
            self._chosen = geometry.following(
                self._view.file.rows, self._chosen, _TURNS[event.key()]
            )
            self.show_view(self._view)
        elif step and row is not None:
            if event.modifiers() & Qt.ShiftModifier:
                self._turn(row, geometry.within_tilt(row.tilt_deg - step))
            else:
                self.goal_changed.emit(
                    row.index, geometry.stepped(row.baseline_m + geometry.STEP_M * step)
                )
        else:
            super().keyPressEvent(event)

    def _turn(self, row, tilt_deg: float) -> None:
        """A vertical one has no tilt: a hovering multirotor cannot pitch a fixed camera."""
        if row.axis == "horizontal" and tilt_deg != row.tilt_deg:
            self.goal_turned.emit(row.index, tilt_deg)

    def wheelEvent(self, event) -> None:
        notches = event.angleDelta().y() / 120.0
        if self._mouse.x() < self.width() - BAR_PX:
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

    def paintEvent(self, _event) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.Antialiasing)
        painter.fillRect(self.rect(), self.palette().color(QPalette.Base))
        if self._view is not None:
            self.picture(painter).paint()

    def picture(self, painter: QPainter) -> PlanPicture:
        """Makes the picture of now, and not painted yet."""
        hand = Hand(
            self.editable,
            self._held,
            self._turned,
            self._chosen,
            (self._mouse.x(), self._mouse.y()),
        )
        return PlanPicture(
            painter, self._view, self.scale, self.bar, hand, self.palette(), self._fov_rad
        )
