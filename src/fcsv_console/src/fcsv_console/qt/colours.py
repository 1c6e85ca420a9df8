# SPDX-License-Identifier: Apache-2.0
"""Colours that colour-blind people tell apart (Okabe and Ito), for dark and for light palettes."""

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QColor, QIcon, QPainter, QPalette, QPixmap

from fcsv_console.model import cells

_DARK = {cells.GOOD: "#56B4E9", cells.CARE: "#E69F00", cells.BAD: "#FF7F45", cells.GONE: "#D98CB8"}
_LIGHT = {cells.GOOD: "#005A8C", cells.CARE: "#8A5A00", cells.BAD: "#B03A00", cells.GONE: "#8E3A6B"}
VEHICLES = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#F0E442", "#0072B2")
STOP = "#C62828"
# of a guided robot: cells by how surely it can be there, its route
GROUND_FREE, GROUND_OBSTACLE, ROUTE = "#009E73", "#D55E00", "#0072B2"


def is_dark(palette: QPalette) -> bool:
    """Judges the palette by the window's own colour."""
    return palette.color(QPalette.Window).lightness() < 128


def tone(name: str, palette: QPalette) -> QColor:
    """Gives the tone of a cell's text."""
    if name == cells.QUIET:
        colour = QColor(palette.color(QPalette.WindowText))
        colour.setAlpha(150)
        return colour
    found = (_DARK if is_dark(palette) else _LIGHT).get(name)
    return QColor(found) if found else palette.color(QPalette.WindowText)


def disc(number: int) -> QIcon:
    """A vehicle's colour, as the plan view has it."""
    pixmap = QPixmap(12, 12)
    pixmap.fill(Qt.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.Antialiasing)
    painter.setPen(Qt.NoPen)
    painter.setBrush(QColor(VEHICLES[number % len(VEHICLES)]))
    painter.drawEllipse(1, 1, 10, 10)
    painter.end()
    return QIcon(pixmap)


def dark() -> QPalette:
    """A dark palette of our own, for a desktop that has none."""
    p = QPalette()
    for role, colour in (
        (QPalette.Window, "#1f2329"),
        (QPalette.Base, "#181b20"),
        (QPalette.AlternateBase, "#1f2329"),
        (QPalette.Button, "#2c323a"),
        (QPalette.WindowText, "#e6e6e6"),
        (QPalette.Text, "#e6e6e6"),
        (QPalette.ButtonText, "#e6e6e6"),
        (QPalette.ToolTipBase, "#2c323a"),
        (QPalette.ToolTipText, "#e6e6e6"),
        (QPalette.Highlight, "#2f5d8a"),
        (QPalette.HighlightedText, "#ffffff"),
        (QPalette.Mid, "#3a414b"),
    ):
        p.setColor(role, QColor(colour))
    for role in (QPalette.WindowText, QPalette.Text, QPalette.ButtonText):
        p.setColor(QPalette.Disabled, role, QColor("#7d858f"))
    return p


def light() -> QPalette:
    """A light palette of our own."""
    p = QPalette(QColor("#e9ebee"), QColor("#f4f5f7"))
    p.setColor(QPalette.Base, QColor("#ffffff"))
    p.setColor(QPalette.AlternateBase, QColor("#f4f5f7"))
    p.setColor(QPalette.Highlight, QColor("#b9d7f0"))
    p.setColor(QPalette.HighlightedText, QColor("#101418"))
    return p
