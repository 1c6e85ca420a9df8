# SPDX-License-Identifier: Apache-2.0
"""Planning from range and error into the list: a form, and what became of it."""

from python_qt_binding.QtCore import Signal
from python_qt_binding.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QGridLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QWidget,
)

from fcsv_console.model import cells
from fcsv_console.model.planning import Planned, Wanted
from fcsv_console.qt import colours
from fcsv_stereo.model import AXES


class PlanForm(QWidget):
    """``wanted`` with a planning.Wanted; ``show_planned`` tells what became of it."""

    wanted = Signal(object)

    def __init__(self, parent=None):
        super().__init__(parent)
        usual = Wanted()
        self.range = QDoubleSpinBox()
        self.range.setRange(1.0, 5000.0)
        self.range.setDecimals(0)
        self.range.setSuffix(" m")
        self.range.setValue(usual.range_m)
        self.error = QLineEdit(usual.error)
        self.error.setToolTip("Share of the distance (10%), or metres (0.5)")
        self.number = QSpinBox()
        self.number.setRange(1, 20)
        self.number.setValue(usual.number)
        self.axis = QComboBox()
        self.axis.addItems([*AXES, "both"])
        self.whole = QCheckBox("whole metres")
        self.whole.setChecked(usual.whole)
        self.go = QPushButton("Into the &list")
        self.go.setToolTip(
            "Put these configurations in place of the list; the file is not saved by it"
        )
        self.go.clicked.connect(self._ask)
        self.note = QLabel()
        self.note.setWordWrap(True)
        named = (
            (self.range, "Range"),
            (self.error, "Error"),
            (self.number, "Baselines"),
            (self.axis, "Axis"),
        )
        form = QGridLayout(self)
        for k, (widget, name) in enumerate(named):
            widget.setMinimumWidth(50)
            form.addWidget(QLabel(name), k // 2, 2 * (k % 2))
            form.addWidget(widget, k // 2, 2 * (k % 2) + 1)
        form.addWidget(self.whole, 2, 0, 1, 2)
        form.addWidget(self.go, 2, 2, 1, 2)
        form.addWidget(self.note, 3, 0, 1, 4)
        form.setRowStretch(3, 1)
        form.setContentsMargins(4, 4, 4, 4)
        for widget, name in (
            *named,
            (self.whole, "Whole metres"),
            (self.go, "Into the list"),
            (self.note, "Plan"),
        ):
            widget.setAccessibleName(name)

    def _ask(self) -> None:
        self.wanted.emit(
            Wanted(
                self.range.value(),
                self.error.text(),
                self.number.value(),
                self.axis.currentText(),
                self.whole.isChecked(),
            )
        )

    def show_planned(self, planned: Planned) -> None:
        """Notes, or why there is no plan."""
        self.note.setText(planned.problem or "; ".join(planned.notes))
        tone = cells.BAD if planned.problem else cells.PLAIN
        self.note.setStyleSheet(f"color: {colours.tone(tone, self.palette()).name()}")
