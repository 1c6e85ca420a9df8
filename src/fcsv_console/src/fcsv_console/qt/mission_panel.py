# SPDX-License-Identifier: Apache-2.0
"""The configurations: a table, the file's text beside it, and what is wrong in which line."""

from pathlib import Path
from typing import Optional, Sequence

from python_qt_binding.QtCore import Signal
from python_qt_binding.QtGui import QFontDatabase, QTextCursor
from python_qt_binding.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QPlainTextEdit,
    QPushButton,
    QSplitter,
    QTabWidget,
    QTextEdit,
    QVBoxLayout,
    QWidget,
)

from fcsv_console.model import cells, mission_folder
from fcsv_console.model.mission_file import MissionFile
from fcsv_console.model.view import ConsoleView
from fcsv_console.qt import colours
from fcsv_console.qt.lines import LinesLabel
from fcsv_console.qt.mission_folder import MissionFolder
from fcsv_console.qt.plan_form import PlanForm
from fcsv_console.qt.tables import CellTable

_BESIDE_PX, _FILES_PX = 460, 110


class MissionPanel(QWidget):
    """``edited`` with the whole text, ``opened`` with a path, ``planned`` with what is wanted.

    ``buttons``: those of the rehearsal, which stand beside its outcome.
    """

    edited, opened, planned = Signal(str), Signal(str), Signal(object)

    def __init__(self, buttons: Sequence[QPushButton] = (), parent=None):
        super().__init__(parent)
        self.table = CellTable(
            "Configurations", cells.CONFIGURATION_HEADS, (1,), (2, 3, 4, 5), whole=True
        )
        self.text = QPlainTextEdit()
        self.text.setAccessibleName("Text of the mission file")
        self.text.setFont(QFontDatabase.systemFont(QFontDatabase.FixedFont))
        self.text.textChanged.connect(self._changed)
        self.note = LinesLabel(1)
        self.note.setAccessibleName("Mission file")
        self.optics = LinesLabel(1)
        self.optics.setAccessibleName("Camera of ranges and errors")
        self.save = self._button(
            "&Save", "Write the file; the mission node reads it when it starts", self._save
        )
        self.revert = self._button(
            "Re&vert", "Leave the changes; Ctrl+Z in the text brings them back", self._revert
        )
        kept = self.revert.sizePolicy()
        kept.setRetainSizeWhenHidden(True)
        self.revert.setSizePolicy(kept)
        open_ = self._button("&Open", "Open another mission file", self._open)
        open_.setObjectName("open")
        self._tabs = QTabWidget()
        self._tabs.setAccessibleName("Configurations as table or text")
        self.files = MissionFolder()
        self.files.wanted.connect(self._want)
        self._beside = QSplitter()
        self._beside.setAccessibleName("Files and configurations")
        self._beside.setChildrenCollapsible(False)
        self._beside.addWidget(self.table)
        self._tabs.addTab(self._beside, "&Table")
        self._tabs.addTab(self.text, "Te&xt")
        self.plan = PlanForm()
        self.plan.wanted.connect(self.planned)
        self._tabs.addTab(self.plan, "&Plan")
        self._tabs.addTab(self.files, "F&iles")
        self.rehearsal = LinesLabel(1)
        self.rehearsal.setAccessibleName("Rehearsal")
        self._source, self._saved, self._shown, self._quiet = "", "", None, False
        self._running: Optional[int] = None
        line = QHBoxLayout()
        line.setSpacing(4)
        for button in (open_, self.save, *buttons):
            button.setMinimumWidth(60)
            line.addWidget(button, button.sizeHint().width())
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        layout.addWidget(self._tabs, 1)
        told = QHBoxLayout()
        told.addWidget(self.note, 1)
        told.addWidget(self.revert)
        layout.addLayout(told)
        layout.addWidget(self.optics)
        layout.addWidget(self.rehearsal)
        layout.addLayout(line)

    def _button(self, title: str, what: str, call) -> QPushButton:
        button = QPushButton(title)
        button.setToolTip(what)
        button.setAccessibleName(title.replace("&", ""))
        button.clicked.connect(call)
        return button

    def resizeEvent(self, event) -> None:
        """The files stand beside their configurations where both have room, else in a tab of their
        own."""
        super().resizeEvent(event)
        beside = self.width() >= _BESIDE_PX
        if beside == (self._beside.count() == 2):
            return
        if beside:
            if self._tabs.currentWidget() is self.files:
                self._tabs.setCurrentWidget(self._beside)
            self._tabs.removeTab(self._tabs.indexOf(self.files))
            self._beside.insertWidget(0, self.files)
            self._beside.setSizes([_FILES_PX, self.width() - _FILES_PX])
            self.files.show()
        else:
            self._tabs.addTab(self.files, "F&iles")

    def show_view(self, view: ConsoleView) -> None:
        """Table, text, error."""
        rows = [cells.configuration_cells(r, r.index == view.running) for r in view.file.rows]
        self.table.show_cells(rows)
        if view.running is not None and view.running != self._running:
            self.table.scrollToItem(self.table.item(view.running, 0))
        self._running = view.running
        told = cells.rehearsal_cell(view)
        if self.rehearsal.text() != told.text:
            self.rehearsal.setText(told.text)
            self.rehearsal.setStyleSheet(f"color: {colours.tone(told.tone, self.palette()).name()}")
        if view.file is not self._shown:
            self._shown = view.file
            self._show_file(view.file)
        self._show_optics(view)

    def _show_optics(self, view: ConsoleView) -> None:
        """Whose camera ranges and errors are computed with: a line only while it is not the
        vehicle's own."""
        words = f"Ranges and errors: {view.optics.words}"
        if self.optics.text() != words:
            self.optics.setText(words)
            self.optics.setStyleSheet(f"color: {colours.tone(cells.CARE, self.palette()).name()}")
            self.optics.setVisible(not view.optics.heard_of)
            self.table.setToolTip(words)

    def _show_file(self, file: MissionFile) -> None:
        if file.source != self._source or not self._saved:
            self._source, self._saved = file.source, file.text
        if self.text.toPlainText() != file.text:
            self._quiet = True
            self.text.setPlainText(file.text)
            self._quiet = False
        changed = file.text != self._saved
        name = Path(file.source).name or ("the mission's own file" if file.text else "no file")
        words = (
            file.error.words
            if file.error
            else f"{name}, changed and not saved"
            if changed
            else name
        )
        self.note.setText(words)
        tone = cells.BAD if file.error else cells.CARE if changed else cells.QUIET
        self.note.setStyleSheet(f"color: {colours.tone(tone, self.palette()).name()}")
        self.files.show_loaded(file.source, changed)
        self.revert.setVisible(changed)
        self.save.setEnabled(changed and file.mission is not None and bool(file.source))
        self._mark(file.error.line if file.error else 0)

    def _mark(self, line: int) -> None:
        """The line of the error, from 1 on; 0: none."""
        marks = []
        if line:
            mark = QTextEdit.ExtraSelection()
            mark.cursor = QTextCursor(self.text.document().findBlockByNumber(line - 1))
            mark.cursor.select(QTextCursor.LineUnderCursor)
            mark.format.setUnderlineStyle(mark.format.WaveUnderline)
            mark.format.setUnderlineColor(colours.tone(cells.BAD, self.palette()))
            marks.append(mark)
        self.text.setExtraSelections(marks)

    def _changed(self) -> None:
        if not self._quiet:
            self.edited.emit(self.text.toPlainText())

    def _save(self) -> None:
        try:
            Path(self._source).write_text(self.text.toPlainText())
        except OSError as error:
            self.note.setText(f"not saved: {error.strerror}")
            return
        self._saved, self._shown = self.text.toPlainText(), None

    def _revert(self) -> None:
        """Puts the text back, as an edit, so that the editor can undo it."""
        cursor = QTextCursor(self.text.document())
        cursor.select(QTextCursor.Document)
        cursor.insertText(self._saved)

    def _want(self, path: str) -> None:
        """Another file, or this one anew; what was not saved is never lost by it."""
        why = mission_folder.refused(path, self._source, self.text.toPlainText() != self._saved)
        if why:
            self.note.setText(why)
            self.note.setStyleSheet(f"color: {colours.tone(cells.CARE, self.palette()).name()}")
            return
        self._saved = ""  # what is read now is what is saved
        self.opened.emit(path)

    def _open(self) -> None:
        path, _ = QFileDialog.getOpenFileName(
            self, "Mission file", str(Path(self._source).parent), "*.yaml"
        )
        if path:
            self._want(path)
