# SPDX-License-Identifier: Apache-2.0
"""Tables of cells. Only what changed is touched, so that ten refreshes a second cost little."""

from typing import Callable, List, Sequence

from python_qt_binding.QtCore import QItemSelectionModel, Qt, QTimer
from python_qt_binding.QtGui import QBrush, QFont
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QTableWidget,
    QTableWidgetItem,
)

from fcsv_console.model.cells import Cell
from fcsv_console.qt import colours

_ROW_PX = 22
_SCALES = (1.0, 0.92, 0.84, 0.76, 0.68)


class CellTable(QTableWidget):
    """Rows of cells; ``right`` are the columns of figures, ``wide`` those that share what is left.

    ``wraps``: a long cell takes more lines; else its end is cut, and its tooltip has the whole.
    ``whole``: no cell is cut where a smaller font helps.
    """

    def __init__(
        self,
        name: str,
        heads: Sequence[str],
        wide: Sequence[int],
        right: Sequence[int] = (),
        rows: bool = True,
        wraps: bool = False,
        whole: bool = False,
    ):
        super().__init__(0, len(heads))
        self._wraps, self._whole, self._usual = wraps, whole, self.font()
        self._right, self._shown = set(right), []  # type: set, List[List[Cell]]
        self.setHorizontalHeaderLabels(list(heads))
        self.setAccessibleName(name)
        self.setEditTriggers(QAbstractItemView.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectRows)
        self.setSelectionMode(
            QAbstractItemView.ExtendedSelection if rows else QAbstractItemView.NoSelection
        )
        self.setShowGrid(False)
        self.setMinimumSize(80, 60)
        self.setAlternatingRowColors(True)
        self.setWordWrap(wraps)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(_ROW_PX)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        for k in range(len(heads)):
            header.setSectionResizeMode(
                k, QHeaderView.Stretch if k in wide else QHeaderView.ResizeToContents
            )
        self._fitting = QTimer(self)
        self._fitting.setSingleShot(True)
        self._fitting.timeout.connect(self.fit)
        if wraps:
            header.sectionResized.connect(lambda *_: self._fitting.start(0))

    def show_cells(self, rows: Sequence[Sequence[Cell]]) -> None:
        """Shows cells in place of those before."""
        rows = [list(row) for row in rows]
        if rows == self._shown:
            return
        if self.rowCount() != len(rows):
            # a row that goes is not let go of by the operator
            self._quietly(lambda: self.setRowCount(len(rows)))
            self._shown = self._shown[: len(rows)]
        for i, row in enumerate(rows):
            before = self._shown[i] if i < len(self._shown) else []
            for k, cell in enumerate(row):
                if k >= len(before) or before[k] != cell:
                    self._put(i, k, cell)
        self._shown = rows
        self.fit()

    def resizeEvent(self, event) -> None:
        super().resizeEvent(event)
        self._fitting.start(0)

    def fit(self) -> None:
        """Every row as high as its longest cell needs, and all columns in the width."""
        for scale in _SCALES if self._whole else ():
            font = QFont(self._usual)
            font.setPointSizeF(scale * font.pointSizeF())
            if font != self.font():
                self.setFont(font)
                self.horizontalHeader().setFont(font)
            header = self.horizontalHeader()
            hints = (
                max(self.sizeHintForColumn(k), header.sectionSizeHint(k))
                for k in range(self.columnCount())
            )
            if sum(hints) <= self.viewport().width():
                break
        for i in range(self.rowCount()) if self._wraps else ():
            height = max(_ROW_PX, self.sizeHintForRow(i))
            if self.rowHeight(i) != height:
                self.setRowHeight(i, height)

    def repaint_cells(self) -> None:
        """The palette changed: all tones anew."""
        rows, self._shown = self._shown, []
        self.show_cells(rows)

    def chosen(self) -> List[int]:
        """Numbers of the selected rows, in order."""
        return sorted({index.row() for index in self.selectionModel().selectedRows()})

    def choose(self, rows: Sequence[int]) -> None:
        """Selects rows in place of what is selected; nobody is told of it as of what the operator
        selects."""
        if list(rows) != self.chosen():
            self._quietly(self.clearSelection)
            how = QItemSelectionModel.Select | QItemSelectionModel.Rows
            for i in rows:
                at = self.model().index(i, 0)
                self._quietly(lambda at=at: self.selectionModel().select(at, how))

    def _quietly(self, change: Callable[[], None]) -> None:
        before = self.blockSignals(True)
        change()
        self.blockSignals(before)

    def _put(self, i: int, k: int, cell: Cell) -> None:
        item = self.item(i, k)
        if item is None:
            item = QTableWidgetItem()
            item.setTextAlignment(
                (Qt.AlignRight if k in self._right else Qt.AlignLeft) | Qt.AlignVCenter
            )
            self.setItem(i, k, item)
        item.setText(cell.text)
        item.setToolTip(cell.text)
        item.setForeground(QBrush(colours.tone(cell.tone, self.palette())))
