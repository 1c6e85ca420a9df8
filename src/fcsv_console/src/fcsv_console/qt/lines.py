# SPDX-License-Identifier: Apache-2.0
"""A label of a fixed number of lines: nothing around it moves when its words change; what is too
long ends in dots."""

from python_qt_binding.QtCore import QPointF, Qt
from python_qt_binding.QtGui import QPainter, QTextLayout, QTextOption
from python_qt_binding.QtWidgets import QLabel, QSizePolicy

_DOTS = "…"


class LinesLabel(QLabel):
    """Plain text in at most ``lines`` lines; its tooltip has the whole where it is cut."""

    def __init__(self, lines: int, parent=None):
        super().__init__(parent)
        self._lines = 0
        self.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Fixed)
        self.lines = lines

    @property
    def lines(self) -> int:
        return self._lines

    @lines.setter
    def lines(self, lines: int) -> None:
        """Makes it as high as so many, whatever it says."""
        self._lines = lines
        self.setFixedHeight(lines * self.fontMetrics().lineSpacing() + 2)

    def setFont(self, font) -> None:
        super().setFont(font)
        self.lines = self._lines

    @property
    def shown(self) -> str:
        """What is painted, line by line."""
        return "\n".join(self._cut())

    def _cut(self):
        metrics, width = self.fontMetrics(), max(1, self.width())
        wrapped = [
            line for part in self.text().split("\n") for line in _wrapped(part, self.font(), width)
        ]
        if len(wrapped) <= self._lines:
            return wrapped
        rest = " ".join(wrapped[self._lines - 1 :])
        return [*wrapped[: self._lines - 1], metrics.elidedText(rest, Qt.ElideRight, width)]

    def setText(self, text: str) -> None:
        super().setText(text)
        self._tell_whole()

    def resizeEvent(self, event) -> None:
        super().resizeEvent(event)
        self._tell_whole()

    def _tell_whole(self) -> None:
        cut = self.shown.endswith(_DOTS)
        if cut or self.toolTip() == self.property("whole"):
            self.setProperty("whole", self.text() if cut else "")
            self.setToolTip(self.text() if cut else "")

    def paintEvent(self, _event) -> None:
        painter = QPainter(self)
        painter.setPen(self.palette().color(self.foregroundRole()))
        high = self.fontMetrics().lineSpacing()
        for k, line in enumerate(self._cut()):
            painter.drawText(QPointF(0.0, k * high + self.fontMetrics().ascent() + 1.0), line)


def _wrapped(text: str, font, width: int):
    """Lines of words in px ``width``; a word that is longer than a line is broken."""
    layout = QTextLayout(text, font)
    layout.setTextOption(QTextOption())
    layout.beginLayout()
    found = []
    while True:
        line = layout.createLine()
        if not line.isValid():
            break
        line.setLineWidth(width)
        found.append(text[line.textStart() : line.textStart() + line.textLength()].rstrip())
    layout.endLayout()
    return found or [""]
