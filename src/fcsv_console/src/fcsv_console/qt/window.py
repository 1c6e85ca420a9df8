# SPDX-License-Identifier: Apache-2.0
"""The window: it shows a view and tells which action was asked for."""

from typing import Dict, Optional, Tuple

from python_qt_binding.QtCore import QCoreApplication, QEvent, Qt, Signal
from python_qt_binding.QtGui import QFont
from python_qt_binding.QtWidgets import (
    QApplication,
    QCheckBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QMainWindow,
    QProgressBar,
    QPushButton,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from fcsv_console.model import actions as model_actions
from fcsv_console.model import cells
from fcsv_console.model.events import calls_for_a_sound
from fcsv_console.model.guide import ACCEPT, AFTER
from fcsv_console.model.view import ConsoleView
from fcsv_console.qt import colours
from fcsv_console.qt.after_dock import AfterDock
from fcsv_console.qt.hold import ActionButton, stand_out
from fcsv_console.qt.keys import KeyFilter
from fcsv_console.qt.layouts import column, in_groups, panel
from fcsv_console.qt.lines import LinesLabel
from fcsv_console.qt.map_panel import RVIZ_ALONE, MapPanel
from fcsv_console.qt.mission_panel import MissionPanel
from fcsv_console.qt.pictures import PicturesDock
from fcsv_console.qt.room import Room
from fcsv_console.qt.tables import CellTable
from fcsv_control.flight_check.lines import Line

_GROUPS = (
    ("calibrate", "set_home", "hand_over", "execute"),
    ("previous", "next", "pause", "skip", "repeat", *model_actions.OF_STATIONS),
    ("record", "abort", "land"),
)
_EVENTS = 200
# a screen of 1920 x 1080 at 200 %, without the desktop's own bars
_LEAST_WIDE_PX, _LEAST_HIGH_PX = 900, 500
_HIGH_PX = 600  # below, one problem leaves room for the flight check
_HEAD_LINES, _STOP_LINES, _PROBLEM_LINES = 2, 2, 2
_LEVELS = {"info": cells.PLAIN, "warning": cells.CARE, "error": cells.BAD}


class ConsoleWindow(QMainWindow):
    """``asked`` (name, arguments); the goal that is dragged and the text that is edited go out as
    the others do."""

    asked = Signal(str, dict)
    edited, opened, planned = Signal(str), Signal(str), Signal(object)
    goal_changed, goal_turned = Signal(int, float), Signal(int, float)

    def __init__(self, view: ConsoleView, rviz_config: str = ""):
        super().__init__()
        self.setWindowTitle("fcsv console")
        self._view, self._lines = view, []  # type: ConsoleView, List[Line]
        # vehicle and name of the line that is chosen
        self._chosen: Optional[Tuple[str, str]] = None
        self.buttons: Dict[str, ActionButton] = {}
        for action in view.actions.values():
            self.buttons[action.name] = ActionButton(action)
            self.buttons[action.name].asked.connect(self._ask)
        self.accept = QPushButton("Accept line [Enter]")
        self.accept.clicked.connect(self._accept)
        self.map = MapPanel(rviz_config)
        self.plan, self.drag = self.map.plan, self.map.drag
        self._make_parts(view)
        self._lay_out()
        self.pictures = PicturesDock(view, self)
        self.addDockWidget(Qt.BottomDockWidgetArea, self.pictures)
        self.after = AfterDock(view, self)
        self.addDockWidget(Qt.BottomDockWidgetArea, self.after)
        for dock in (self.pictures, self.after):
            dock.hide()
        self.room = Room(self, self.panels, (self.pictures, self.after))
        self.keys = KeyFilter(
            self,
            self.buttons,
            {
                Qt.Key_Return: self._accept,
                Qt.Key_Enter: self._accept,
                Qt.Key_D: self.drag.toggle,
                Qt.Key_F2: self._turn_map,
                Qt.Key_F3: self._export,
                Qt.Key_Plus: lambda: self.plan.zoom(1.15),
                Qt.Key_Minus: lambda: self.plan.zoom(1 / 1.15),
                Qt.Key_F4: self._toggle_pictures,
                Qt.Key_F5: self._toggle_after,
            },
        )
        self.setMinimumSize(_LEAST_WIDE_PX, _LEAST_HIGH_PX)
        self.resize(1366, 740)
        self.show_view(view)

    def end(self) -> None:
        """Close it and delete it with all its parts, now.

        One that only loses its last name is deleted by Python's garbage collector. Until then its
        timers go on, and the collector may come while one of them is in Qt's code, which then goes
        on in freed memory.
        """
        self.close()
        self.deleteLater()
        QCoreApplication.sendPostedEvents(self, QEvent.DeferredDelete)

    # ---- parts -----------------------------------------------------------------------------------

    def _make_parts(self, view: ConsoleView) -> None:
        self.headline, self.stop_words = LinesLabel(_HEAD_LINES), LinesLabel(1)
        self.problems, self.verdict = LinesLabel(_PROBLEM_LINES), LinesLabel(1)
        named = (
            (self.headline, "What the mission does"),
            (self.stop_words, "What stop-all did"),
            (self.problems, "Problems"),
            (self.verdict, "Flight check"),
        )
        for label, name in named:
            label.setAccessibleName(name)
        big = QFont(self.headline.font())
        big.setPointSizeF(1.35 * big.pointSizeF())
        big.setBold(True)
        self.headline.setFont(big)
        self.progress = QProgressBar()
        self.progress.setAccessibleName("Progress of the list")
        self.progress.setRange(0, 100)
        self.progress.setFixedHeight(8)
        self.progress.setTextVisible(False)
        self.plan.goal_changed.connect(self.goal_changed)
        self.plan.goal_turned.connect(self.goal_turned)
        self.plan.station_chosen.connect(lambda rows: self.mission.table.choose(rows))
        self.map.showed.connect(self._make_room_for_map)
        self.vehicles = CellTable(
            "Vehicles",
            ["", *(v.name for v in view.vehicles)],
            range(1, len(view.vehicles) + 1),
            rows=False,
            wraps=True,
        )
        for k in range(1, len(view.vehicles) + 1):
            self.vehicles.horizontalHeaderItem(k).setIcon(colours.disc(k - 1))
        self.check = CellTable("Flight check", cells.CHECK_HEADS, (3, 4), wraps=True)
        self.check.setMinimumHeight(40)  # its heads and a line, where the window is low
        self.check.itemSelectionChanged.connect(self._choose_line)
        self.mission = MissionPanel([self.buttons["rehearse"], self.buttons["waive"]])
        self.mission.planned.connect(self.planned)
        self.mission.edited.connect(self.edited)
        self.mission.opened.connect(self.opened)
        self.events = CellTable("Events", ("time", "who", "what → answer"), (2,), wraps=True)
        self.export = QPushButton("Export\n[F3]")
        self.export.setToolTip("All events as a table (CSV, times in UTC)")
        self.export.clicked.connect(self._export)
        self.show_rviz = QPushButton("rviz\n[F2]")
        self.show_rviz.setToolTip(
            "The map, embedded from rviz, in the plan's place; again: alone; again: the plan"
        )
        self.show_rviz.clicked.connect(self._turn_map)
        self.show_pictures = QPushButton("Pictures\n[F4]")
        self.show_pictures.setToolTip("Show or hide what the cameras see, and the map's depth")
        self.show_pictures.clicked.connect(self._toggle_pictures)
        self.sound = QCheckBox("Sound")
        self.sound.setToolTip("A beep with every warning and error")
        self._sounded = 0
        self.show_after = QPushButton("After\n[F5]")
        self.show_after.setToolTip("After the flight: gather, map, open the report")
        self.show_after.clicked.connect(self._toggle_after)
        for button, name in (
            (self.show_pictures, "Pictures"),
            (self.show_after, "After the flight"),
            (self.sound, "Sound"),
            (self.export, "Export events"),
            (self.show_rviz, "Map in rviz"),
            (self.accept, "Accept line"),
        ):
            button.setAccessibleName(name)

    def _lay_out(self) -> None:
        stop = self.buttons["stop_all"]
        stop.setMinimumSize(170, 62)
        stop.setFont(self.font())
        shape = "font-weight: bold; border-radius: 6px"
        stop.setStyleSheet(
            f"QPushButton {{ background-color: {colours.STOP}; color: white; {shape} }} "
            f"QPushButton:disabled {{ background-color: gray; color: lightgray; {shape} }}"
        )
        head = QHBoxLayout()
        words = panel(column(self.headline, self.stop_words), stretch=None)
        # what stop-all did takes a line from the headline
        words.setFixedHeight(self.headline.height() + 2)
        head.addLayout(column(words, self.progress), 1)
        head.addWidget(stop)
        check_line = QHBoxLayout()
        check_line.addWidget(self.verdict, 1)
        check_line.addWidget(self.accept)
        middle = QSplitter(Qt.Vertical)
        middle.addWidget(self.vehicles)
        middle.addWidget(panel(check_line, self.check, self.problems, stretch=self.check))
        middle.setSizes([400, 200])
        lower = QHBoxLayout()
        lower.addWidget(self.sound)
        for button in (self.show_after, self.show_pictures, self.show_rviz, self.export):
            button.setFont(self.buttons["pause"].font())
            button.setMinimumWidth(50)
            lower.addWidget(button, 1)
        right = QSplitter(Qt.Vertical)
        right.addWidget(self.mission)
        right.addWidget(panel(self.events, lower, stretch=self.events))
        right.setSizes([380, 230])
        self.panels = across = QSplitter(Qt.Horizontal)
        self._beside_map = (middle, right)
        for part in (self.map, middle, right):
            across.addWidget(part)
        across.setSizes([400, 460, 506])
        for splitter, name in (
            (across, "Panels"),
            (middle, "Vehicles and check"),
            (right, "Mission and events"),
        ):
            splitter.setAccessibleName(name)
            splitter.setChildrenCollapsible(False)
        whole = QWidget()
        layout = QVBoxLayout(whole)
        layout.setContentsMargins(8, 8, 8, 8)
        layout.addLayout(head)
        layout.addWidget(across, 1)
        layout.addLayout(in_groups([[self.buttons[name] for name in group] for group in _GROUPS]))
        self.setCentralWidget(whole)

    # ---- what is shown ---------------------------------------------------------------------------

    def show_view(self, view: ConsoleView) -> None:
        """Everything, ten times a second: only what changed is touched."""
        self._view = view
        headline = cells.headline(view)
        self._say(self.headline, headline.text, headline.tone)
        own = mission_words(view)
        if self.headline.accessibleDescription() != own:
            self.headline.setAccessibleDescription(own)
        stop = view.stop.value
        told = [stop.words] if stop and stop.asked else []
        told += [a.words for a in view.above] if not self.plan.isVisibleTo(self) else []
        told += view.problems[:2] if not self.problems.parentWidget().isVisibleTo(self) else []
        self._say(self.stop_words, "\n".join(told), cells.BAD)
        self._share_head(min(len(told), _STOP_LINES))
        share = int(round(100.0 * view.progress))
        if self.progress.value() != share:
            self.progress.setValue(share)
        self.map.show_view(view)
        stereo = cells.stereo_cell(view)
        self._say(self.map.stereo, stereo.text, stereo.tone)
        rows = cells.vehicle_rows(view)
        self.vehicles.show_cells([[cells.Cell(label, cells.QUIET), *of] for label, of in rows])
        self._show_check(view)
        verdict = cells.check_words(view)
        self._say(self.verdict, verdict.text, verdict.tone)
        most = _PROBLEM_LINES if self.height() >= _HIGH_PX else 1
        if self.problems.lines != most:
            self.problems.lines = most
        shown = list(view.problems[:most])
        if len(view.problems) > most:
            shown[-1] += f" and {len(view.problems) - most} more"
        self._say(self.problems, "\n".join(shown), cells.problems_tone(view))
        self.problems.setToolTip("\n".join(view.problems))
        self.mission.show_view(view)
        self.pictures.show_view(view)
        self.after.show_view(view)
        if view.events and view.events[-1].number > self._sounded:
            if self.sound.isChecked() and calls_for_a_sound(view.events, self._sounded):
                QApplication.beep()
            self._sounded = view.events[-1].number
        self.events.show_cells(
            [
                [
                    cells.Cell(e.clock, cells.QUIET),
                    cells.Cell(e.who),
                    cells.Cell(f"{e.what} → {e.answer}" if e.answer else e.what, _LEVELS[e.level]),
                ]
                for e in reversed(view.events[-_EVENTS:])
            ]
        )
        for name, action in view.actions.items():
            self.buttons[name].show_action(action)
            if name != "stop_all":
                self.buttons[name].stand_out(name == view.guide.next)
        for name in model_actions.OF_STATIONS:
            self.buttons[name].setVisible(model_actions.has_stations(view.file.mission))
        stand_out(self.show_after, view.guide.next == AFTER and not self.after.isVisible())
        stand_out(self.accept, view.guide.next == ACCEPT)
        self._show_accept()

    def _share_head(self, stop_lines: int) -> None:
        """Shares out the head, of the fixed height of both: the headline has what the words below
        leave it."""
        headline = 1 if stop_lines else _HEAD_LINES
        if (self.headline.lines, self.stop_words.lines) != (headline, max(1, stop_lines)):
            self.headline.lines, self.stop_words.lines = headline, max(1, stop_lines)
        self.stop_words.setVisible(bool(stop_lines))

    def _say(self, label: QLabel, text: str, tone: str) -> None:
        if label.text() != text:
            label.setText(text)
        style = f"color: {colours.tone(tone, self.palette()).name()}"
        if label.styleSheet() != style:
            label.setStyleSheet(style)

    def _show_check(self, view: ConsoleView) -> None:
        """Lines come, go and change places; what is chosen stays the line, not its row."""
        self._lines = cells.check_lines(view)
        self.check.show_cells([cells.check_cells(li, view.waits(li)) for li in self._lines])
        self.check.choose(
            [k for k, li in enumerate(self._lines) if (li.vehicle, li.name) == self._chosen]
        )

    def _choose_line(self) -> None:
        chosen = self.check.chosen()
        line = self._lines[chosen[0]] if len(chosen) == 1 and chosen[0] < len(self._lines) else None
        self._chosen = None if line is None else (line.vehicle, line.name)
        self._show_accept()

    def _chosen_line(self) -> Optional[Line]:
        return next((li for li in self._lines if (li.vehicle, li.name) == self._chosen), None)

    def _show_accept(self) -> None:
        line = self._chosen_line()
        action = model_actions.accept(line) if line is not None else None
        self.accept.setEnabled(action is not None and action.enabled)
        self.accept.setToolTip(
            action.tooltip if action else "Choose one amber line of the flight check first"
        )

    # ---- what is asked ---------------------------------------------------------------------------

    def _ask(self, name: str) -> None:
        self.asked.emit(
            name, {"configurations": self.mission.table.chosen()} if name == "execute" else {}
        )

    def _accept(self) -> None:
        line = self._chosen_line()
        if line is not None and self.accept.isEnabled():
            self.asked.emit("accept", {"vehicle": line.vehicle, "line": line.name})

    def _turn_map(self) -> None:
        self.map.turn(self._view.master_problem)
        self.show_view(self._view)

    def _make_room_for_map(self, shows: int) -> None:
        for part in self._beside_map:
            part.setVisible(shows != RVIZ_ALONE)

    def _toggle_pictures(self) -> None:
        self.pictures.setVisible(not self.pictures.isVisible())
        if self.panels.isVisible():
            self.resizeDocks([self.pictures], [self.height() // 3], Qt.Vertical)
        self.pictures.show_view(self._view)

    def _toggle_after(self) -> None:
        self.after.setVisible(not self.after.isVisible())

    def _export(self) -> None:
        path, _ = QFileDialog.getSaveFileName(self, "Export events", "events.csv", "*.csv")
        if path:
            self.asked.emit("export", {"path": path})


def mission_words(view: ConsoleView) -> str:
    """The mission's own, for a screen reader: phase, what it waits for, detail."""
    m = view.mission.value
    waits = f", waits for {m.waits_for}" if m is not None and m.waits_for else ""
    return "" if m is None else f"{m.phase}{waits}: {m.detail}".rstrip(": ")
