# SPDX-License-Identifier: Apache-2.0
"""Leads on after the flight, in a dock: three steps with their progress; a step that runs is
stopped by its own button."""

from typing import Dict

from python_qt_binding.QtCore import Signal
from python_qt_binding.QtWidgets import (
    QDockWidget,
    QGridLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QWidget,
)

from fcsv_console.model import after, cells
from fcsv_console.model.view import ConsoleView
from fcsv_console.qt import colours
from fcsv_console.qt.hold import stand_out

_FIELDS = (("sources", "Machines"), ("session", "Session"), ("out", "Map"))
_HINTS = {
    "sources": "uav1=pilot@HOST:FOLDER uav2=... control=FOLDER",
    "session": "folder of the session",
    "out": "folder of the map",
}


class AfterDock(QDockWidget):
    """``asked`` (step, places) for a step that is to begin, or to be stopped; ``changed`` (places)
    while typing."""

    asked, changed = Signal(str, object), Signal(object)

    def __init__(self, view: ConsoleView, parent=None):
        super().__init__("After the flight [F5]", parent)
        self.setAccessibleName("After the flight")
        self.setObjectName("after")
        self.fields: Dict[str, QLineEdit] = {}
        self.buttons: Dict[str, QPushButton] = {}
        self.bars: Dict[str, QProgressBar] = {}
        self.words: Dict[str, QLabel] = {}
        whole, grid = QWidget(), QGridLayout()
        whole.setLayout(grid)
        grid.setContentsMargins(8, 2, 8, 6)
        for k, ((field, name), step) in enumerate(zip(_FIELDS, view.after)):
            self.fields[field] = edit = QLineEdit(getattr(view.places, field))
            edit.setPlaceholderText(_HINTS[field])
            edit.setAccessibleName(name)
            edit.textChanged.connect(lambda _text: self.changed.emit(self.places))
            self.buttons[step.name] = button = QPushButton(step.title)
            button.clicked.connect(lambda _on, name=step.name: self.asked.emit(name, self.places))
            self.bars[step.name] = bar = QProgressBar()
            bar.setAccessibleName(f"Progress of {step.title.lower()}")
            bar.setFixedWidth(120)
            self.words[step.name] = words = QLabel()
            words.setAccessibleName(f"What {step.title.lower()} said")
            # a long line is cut; its tooltip is not
            words.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
            for column, widget in enumerate((QLabel(name), edit, button, bar, words)):
                grid.addWidget(widget, k, column)
        grid.setRowStretch(len(_FIELDS), 1)
        grid.setColumnStretch(1, 3)
        grid.setColumnStretch(4, 4)
        self.setWidget(whole)

    @property
    def places(self) -> after.Places:
        """Gives the places as they are typed."""
        return after.Places(**{name: edit.text().strip() for name, edit in self.fields.items()})

    def show_view(self, view: ConsoleView) -> None:
        """What can be done, and how far it is."""
        for step in view.after:
            button, bar, words = (
                self.buttons[step.name],
                self.bars[step.name],
                self.words[step.name],
            )
            runs = step.state == after.RUNS
            button.setText("Stop" if runs else step.title)
            button.setAccessibleName(f"Stop {step.title.lower()}" if runs else step.title)
            button.setEnabled(not step.why_not)
            button.setToolTip(step.tooltip)
            stand_out(button, step.next)
            busy = runs and step.share != step.share
            bar.setRange(0, 0 if busy else 100)
            bar.setValue(
                -1
                if busy
                else 100
                if step.state == after.DONE
                else int(100 * step.share)
                if runs
                else 0
            )
            bar.setVisible(step.name != after.REPORT)
            told = step.summary or step.why_not
            words.setText(told)
            words.setToolTip(told)
            tone = (
                cells.BAD
                if step.state == after.FAILED
                else cells.QUIET
                if not step.summary
                else cells.PLAIN
            )
            words.setStyleSheet(f"color: {colours.tone(tone, self.palette()).name()}")
