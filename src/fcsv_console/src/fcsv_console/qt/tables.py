# SPDX-License-Identifier: Apache-2.0
"""Tables of cells. Only what changed is touched, so that ten refreshes a second cost little."""

from typing import List, Sequence

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QBrush
from python_qt_binding.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from fcsv_console.model.cells import Cell
from fcsv_console.qt import colours

_ROW_PX = 22


class CellTable(QTableWidget):
    """Rows of cells; ``right`` are the columns of figures, ``wide`` is the one that takes what is left."""

    def __init__(self, name: str, heads: Sequence[str], wide: int, right: Sequence[int] = (), rows: bool = True):
        super().__init__(0, len(heads))
        self._right, self._shown = set(right), []  # type: set, List[List[Cell]]
        self.setHorizontalHeaderLabels(list(heads))
        self.setAccessibleName(name)
        self.setEditTriggers(QAbstractItemView.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectRows)
        self.setSelectionMode(QAbstractItemView.ExtendedSelection if rows else QAbstractItemView.NoSelection)
        self.setShowGrid(False)
        self.setMinimumSize(80, 60)
        self.setAlternatingRowColors(True)
        self.setWordWrap(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(_ROW_PX)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        for k in range(len(heads)):
            header.setSectionResizeMode(k, QHeaderView.Stretch if k == wide else QHeaderView.ResizeToContents)

    def show_cells(self, rows: Sequence[Sequence[Cell]]) -> None:
        """In place of those before."""
        rows = [list(row) for row in rows]
        if rows == self._shown:
            return
        if self.rowCount() != len(rows):
            self.setRowCount(len(rows))
            self._shown = self._shown[: len(rows)]
        for i, row in enumerate(rows):
            before = self._shown[i] if i < len(self._shown) else []
            for k, cell in enumerate(row):
                if k >= len(before) or before[k] != cell:
                    self._put(i, k, cell)
        self._shown = rows

    def repaint_cells(self) -> None:
        """The palette changed: all tones anew."""
        rows, self._shown = self._shown, []
        self.show_cells(rows)

    def chosen(self) -> List[int]:
        """Numbers of the selected rows, in order."""
        return sorted({index.row() for index in self.selectionModel().selectedRows()})

    def _put(self, i: int, k: int, cell: Cell) -> None:
        item = self.item(i, k)
        if item is None:
            item = QTableWidgetItem()
            item.setTextAlignment((Qt.AlignRight if k in self._right else Qt.AlignLeft) | Qt.AlignVCenter)
            self.setItem(i, k, item)
        item.setText(cell.text)
        item.setToolTip(cell.text)
        item.setForeground(QBrush(colours.tone(cell.tone, self.palette())))
