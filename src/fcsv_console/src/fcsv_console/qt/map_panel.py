# SPDX-License-Identifier: Apache-2.0
"""Where everything is: the plan view, or rviz in its place; the stereo pair below it."""

from python_qt_binding.QtCore import Qt, Signal
from python_qt_binding.QtWidgets import (
    QHBoxLayout,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from fcsv_console.model.view import ConsoleView
from fcsv_console.qt.lines import LinesLabel
from fcsv_console.qt.plan_view import PlanView
from fcsv_console.qt.rviz_view import RvizView

PLAN, RVIZ, RVIZ_ALONE = range(3)
_STEREO_LINES = 5


class MapPanel(QWidget):
    """``showed``: PLAN, RVIZ (in the plan's place) or RVIZ_ALONE (it asks for the room of the other
    panels, too)."""

    showed = Signal(int)

    def __init__(self, rviz_config: str = "", parent=None):
        super().__init__(parent)
        self.shows = PLAN
        self.plan, self.rviz = PlanView(), RvizView(rviz_config)
        self._stack = QStackedWidget()
        for view in (self.plan, self.rviz):
            self._stack.addWidget(view)
        self.stereo = LinesLabel(_STEREO_LINES)
        self.stereo.setAccessibleName("Stereo pair")
        self.drag = QPushButton("Drag goals [D]")
        self.drag.setCheckable(True)
        self.drag.setToolTip(
            "Change baselines: goals sideways with the mouse, vertical ones with the wheel; their knobs turn the camera"
        )
        self.drag.setAccessibleName("Drag goals")
        self.drag.toggled.connect(lambda on: setattr(self.plan, "editable", on))
        below = QHBoxLayout()
        below.addWidget(self.stereo, 1)
        below.addWidget(self.drag, 0, Qt.AlignTop)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        layout.addWidget(self._stack, 1)
        layout.addLayout(below)

    def turn(self, master_problem: str) -> None:
        """Turns to the next of the three."""
        self.shows = (self.shows + 1) % 3
        if self.shows != PLAN:
            self.rviz.open(master_problem)
        self._stack.setCurrentWidget(self.plan if self.shows == PLAN else self.rviz)
        self.showed.emit(self.shows)

    def show_view(self, view: ConsoleView) -> None:
        """Costs nothing while rviz is shown."""
        if self.shows == PLAN:
            self.plan.show_view(view)
