# SPDX-License-Identifier: Apache-2.0
"""The mission files of the folder of the one that is loaded; a click or Enter asks for one."""

import os

from python_qt_binding.QtCore import QFileSystemWatcher, Qt, Signal
from python_qt_binding.QtGui import QPainter
from python_qt_binding.QtWidgets import QListWidget, QListWidgetItem

from fcsv_console.model import cells, mission_folder
from fcsv_console.qt import colours
from fcsv_console.qt.keys import TAKES_ENTER

_MARGIN_PX = 4


class MissionFolder(QListWidget):
    """``wanted`` with a path. Files that come and go are seen."""

    wanted = Signal(str)

    def __init__(self, parent=None):
        super().__init__(parent)
        self.setAccessibleName("Mission files of the folder")
        self.setToolTip(
            "Click or Enter loads a file; > is loaded, * has changes that are not saved"
        )
        self.setMinimumWidth(60)
        # a long name is cut, its tooltip is whole
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarAlwaysOff)
        self.setUniformItemSizes(True)
        self.setProperty(TAKES_ENTER, True)
        self._path, self._changed, self._rows = "", False, ()
        self._watch = QFileSystemWatcher(self)
        self._watch.directoryChanged.connect(lambda _folder: self._list())
        self.itemClicked.connect(self._want)
        self._say()

    def show_loaded(self, path: str, changed: bool) -> None:
        """The file that is loaded, "" where there is none, and whether it has changes that are not
        saved."""
        if (path, changed) == (self._path, self._changed):
            return
        folder = os.path.dirname(os.path.abspath(path)) if path else ""
        self._path, self._changed = path, changed
        if self._watch.directories() != ([folder] if folder else []):
            if self._watch.directories():
                self._watch.removePaths(self._watch.directories())
            if os.path.isdir(folder):
                self._watch.addPath(folder)
        self._list()

    def _list(self) -> None:
        try:
            names = os.listdir(os.path.dirname(os.path.abspath(self._path))) if self._path else []
        except OSError:
            names = []  # the folder is gone: the note tells of the file
        rows = mission_folder.rows(names, os.path.basename(self._path), self._changed)
        self._say(rows)
        if rows == self._rows:
            return
        chosen = self.currentItem().data(Qt.UserRole) if self.currentItem() is not None else ""
        self._rows = rows
        self.clear()
        for name, shown in rows:
            item = QListWidgetItem(shown)
            item.setData(Qt.UserRole, name)
            item.setToolTip(name)
            self.addItem(item)
            if name == chosen:
                self.setCurrentItem(item)

    def _say(self, rows=()) -> None:
        self.empty = "" if rows else mission_folder.empty(self._path)
        self.setAccessibleDescription(self.empty)
        self.viewport().update()

    def paintEvent(self, event) -> None:
        super().paintEvent(event)
        if self.empty:
            painter = QPainter(self.viewport())
            painter.setPen(colours.tone(cells.QUIET, self.palette()))
            room = self.viewport().rect().adjusted(_MARGIN_PX, _MARGIN_PX, -_MARGIN_PX, -_MARGIN_PX)
            painter.drawText(room, Qt.AlignLeft | Qt.AlignTop | Qt.TextWordWrap, self.empty)

    def keyPressEvent(self, event) -> None:
        if event.key() in (Qt.Key_Return, Qt.Key_Enter):
            if self.currentItem() is not None and not event.isAutoRepeat():
                self._want(self.currentItem())
        else:
            super().keyPressEvent(event)

    def _want(self, item: QListWidgetItem) -> None:
        self.wanted.emit(os.path.join(os.path.dirname(self._path), item.data(Qt.UserRole)))
