# SPDX-License-Identifier: Apache-2.0
"""Planar gauges in the corner of the view from above: grey where a vehicle should be, coloured
where it is."""

from typing import Sequence

from python_qt_binding.QtCore import QPointF, QRectF, Qt
from python_qt_binding.QtGui import QColor, QPainter, QPalette, QPen

from fcsv_console.model.gauges import Gauge
from fcsv_console.qt import colours

SIDE_PX, _GAP_PX, _WORDS_PX = 52.0, 10.0, 16.0


def draw(painter: QPainter, gauges: Sequence[Gauge], palette: QPalette, bottom: float) -> None:
    """Side by side from the left, above ``bottom`` (px). Up is forward; the edge is REACH_M
    away."""
    ink = QColor(palette.color(QPalette.WindowText))
    for k, gauge in enumerate(gauges):
        left = _GAP_PX + k * (SIDE_PX + _GAP_PX)
        box = QRectF(left, bottom - SIDE_PX - _WORDS_PX - 4.0, SIDE_PX, SIDE_PX)
        ground = QColor(palette.color(QPalette.Base))
        ground.setAlpha(225)
        painter.fillRect(box.adjusted(0.0, 0.0, 0.0, _WORDS_PX), ground)
        ink.setAlpha(110)
        painter.setPen(QPen(ink, 1.0))
        painter.setBrush(Qt.NoBrush)
        painter.drawRect(box)
        _cross(painter, box, 0.0, 0.0)
        painter.setPen(QPen(QColor(colours.VEHICLES[gauge.number % len(colours.VEHICLES)]), 2.5))
        forward, to_left = gauge.shares
        _cross(painter, box, forward, to_left)
        ink.setAlpha(200)
        painter.setPen(ink)
        words = QRectF(left - 4.0, box.bottom(), SIDE_PX + 8.0, _WORDS_PX)
        painter.drawText(words, Qt.AlignCenter, gauge.name)


def _cross(painter: QPainter, box: QRectF, forward: float, to_left: float) -> None:
    half, middle = SIDE_PX / 2.0, box.center()
    up, right = middle.y() - forward * half, middle.x() - to_left * half
    painter.drawLine(QPointF(box.left(), up), QPointF(box.right(), up))
    painter.drawLine(QPointF(right, box.top()), QPointF(right, box.bottom()))
