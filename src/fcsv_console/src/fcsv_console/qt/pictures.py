# SPDX-License-Identifier: Apache-2.0
"""Pictures in a dock: every camera with its tags, the map's reference picture under its depth."""

from typing import Optional

import numpy as np
from python_qt_binding.QtCore import QPointF, QRectF, Qt
from python_qt_binding.QtGui import QColor, QImage, QPainter, QPalette, QPen, QPolygonF
from python_qt_binding.QtWidgets import QDockWidget, QHBoxLayout, QWidget

from fcsv_console.model import cells
from fcsv_console.model.pictures import CameraPicture, MapPictures, overlaid, pixels
from fcsv_console.model.view import ConsoleView
from fcsv_console.qt import colours

_LINE_PX, _MARGIN_PX = 20.0, 8.0


class PictureBox(QWidget):
    """A picture as large as there is room, words beneath it, outlines on it."""

    def __init__(self, name: str, parent=None):
        super().__init__(parent)
        self._name, self._of = name, None
        self.image, self.words, self.tone, self.outlines = QImage(), "", cells.PLAIN, ()
        self.empty = ""  # why there is no picture
        self.setMinimumSize(100, 64)
        self.setAccessibleName(name)

    def show_camera(self, camera: CameraPicture) -> None:
        """Unpacked only where it is another one; one that cannot be unpacked is told in words."""
        heard = camera.picture.value
        if heard is not None and heard is not self._of:
            self._of, self.image = heard, QImage.fromData(heard.data) if heard.data else QImage()
        packed = heard is not None and heard.data and self.image.isNull()
        broken = f"{len(heard.data)} octets that cannot be unpacked" if packed else ""
        wrong = bool(camera.problem or broken) or camera.picture.stale
        self.empty = camera.empty
        words = f"{camera.vehicle}: {broken}" if broken and not camera.problem else camera.words
        self._say(words, cells.GONE if wrong else cells.PLAIN, camera.outlines)

    def show_map(self, pictures: MapPictures) -> None:
        """The reference picture with its depth over it."""
        of = (pictures.reference, pictures.depth)
        if self._of is None or of[0] is not self._of[0] or of[1] is not self._of[1]:
            self._of, self.image = of, _image(pictures)
        self.empty = pictures.empty
        self._say(pictures.words, cells.GONE if pictures.problem else cells.PLAIN, ())

    def _say(self, words: str, tone: str, outlines) -> None:
        self.words, self.tone, self.outlines = words, tone, outlines
        self.setAccessibleDescription(words)
        self.setToolTip(words)
        self.update()

    def paintEvent(self, _event) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), self.palette().color(QPalette.Base))
        room = QRectF(0.0, 0.0, self.width(), self.height() - _LINE_PX)
        if not self.image.isNull():
            self._draw(painter, room)
        elif self.empty:
            painter.setPen(colours.tone(cells.QUIET, self.palette()))
            inside = room.adjusted(_MARGIN_PX, _MARGIN_PX, -_MARGIN_PX, -_MARGIN_PX)
            painter.drawText(inside, Qt.AlignCenter | Qt.TextWordWrap, self.empty)
        painter.setPen(colours.tone(self.tone, self.palette()))
        line = QRectF(2.0, room.bottom(), self.width() - 4.0, _LINE_PX)
        words = painter.fontMetrics().elidedText(self.words, Qt.ElideRight, int(line.width()))
        painter.drawText(line, Qt.AlignLeft | Qt.AlignVCenter, words)

    def _draw(self, painter: QPainter, room: QRectF) -> None:
        scale = min(room.width() / self.image.width(), room.height() / self.image.height())
        wide, high = scale * self.image.width(), scale * self.image.height()
        left, top = (room.width() - wide) / 2.0, (room.height() - high) / 2.0
        painter.setRenderHint(QPainter.SmoothPixmapTransform)
        painter.drawImage(QRectF(left, top, wide, high), self.image)
        if self.tone == cells.GONE:
            painter.fillRect(QRectF(left, top, wide, high), QColor(0, 0, 0, 120))
        painter.setRenderHint(QPainter.Antialiasing)
        for width, colour in ((4.0, "#000000"), (2.0, "#F0E442")):  # to be seen on light and dark
            painter.setPen(QPen(QColor(colour), width))
            for outline in self.outlines:
                painter.drawPolygon(
                    QPolygonF(
                        [
                            QPointF(left + (u + 0.5) * scale, top + (v + 0.5) * scale)
                            for u, v in outline
                        ]
                    )
                )


def _image(pictures: MapPictures) -> QImage:
    if pictures.reference is None:
        return QImage()
    depth: Optional[np.ndarray] = None if pictures.depth is None else pixels(pictures.depth)
    rgb = np.ascontiguousarray(overlaid(pixels(pictures.reference), depth))
    return QImage(
        rgb.data, rgb.shape[1], rgb.shape[0], 3 * rgb.shape[1], QImage.Format_RGB888
    ).copy()


class PicturesDock(QDockWidget):
    """One box a vehicle, and one for the map."""

    def __init__(self, view: ConsoleView, parent=None):
        super().__init__("Pictures [F4]", parent)
        self.setAccessibleName("Pictures")
        self.setObjectName("pictures")
        self.boxes = {v.name: PictureBox(f"Picture of {v.name}") for v in view.vehicles}
        self.map = PictureBox("Reference picture with depth")
        row, layout = QWidget(), QHBoxLayout()
        row.setLayout(layout)
        layout.setContentsMargins(4, 0, 4, 4)
        for box in (*self.boxes.values(), self.map):
            layout.addWidget(box, 1)
        self.setWidget(row)

    def show_view(self, view: ConsoleView) -> None:
        """Costs nothing while it is hidden."""
        if self.isVisible():
            for camera in view.cameras:
                self.boxes[camera.vehicle].show_camera(camera)
            self.map.show_map(view.map_pictures)
