# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_console console: the operator's window. It may be closed and opened in flight:
nothing depends on it."""

import argparse
import os
import signal
import sys
import time
from pathlib import Path
from typing import Optional, Sequence

import rospy
from python_qt_binding.QtCore import QTimer, QUrl
from python_qt_binding.QtGui import QDesktopServices
from python_qt_binding.QtWidgets import QApplication

from fcsv_console.children.after import report_of
from fcsv_console.model.after import REPORT, Places
from fcsv_console.qt import colours
from fcsv_console.qt.window import ConsoleWindow
from fcsv_console.ros.shell import ConsoleShell, open_shell
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs.workspace import bringup

_REFRESH_MS = 100
THEMES = {"dark": colours.dark, "light": colours.light}


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status: 0; 2 where a vehicle file cannot be used."""
    arguments = parser().parse_args(argv if argv is not None else rospy.myargv()[1:])
    names = [n for n in arguments.vehicles.split(",") if n]
    try:
        shell = open_shell(
            "console",
            names,
            arguments.mission,
            arguments.target_m,
            True,
            arguments.vehicles_dir,
            arguments.recorded,
            arguments.session,
        )
    except FcsvError as error:
        print(f"console: {error}", file=sys.stderr)
        return 2
    app = application(arguments.theme)
    window = connected(shell, app)
    window.show()
    signal.signal(signal.SIGINT, lambda *_: app.quit())
    signal.signal(signal.SIGTERM, lambda *_: app.quit())
    status = app.exec_()
    window.timer.stop()
    window.close()
    shell.close()
    sys.stdout.flush()
    os._exit(int(status))  # threads of rospy and rviz still run: Qt would be torn down beneath them


def parser() -> argparse.ArgumentParser:
    """Makes the parser of the command line."""
    found = argparse.ArgumentParser(prog="console", description=__doc__)
    found.add_argument(
        "--vehicles", default="", help="the column, front first; default: the mission node's"
    )
    found.add_argument("--mission", default="", help="mission file; default: the mission node's")
    found.add_argument(
        "--target-m", type=float, default=0.0, help="range wanted; default: the configuration's"
    )
    found.add_argument(
        "--vehicles-dir",
        default="",
        help="their files; default: the mission node's, else the usual",
    )
    found.add_argument(
        "--recorded", action="store_true", help="a bag is played: show the pictures that it holds"
    )
    shared = "all machines record into it, as in a simulation: nothing is gathered; default: each machine's own"
    found.add_argument("--session", default="", metavar="FOLDER", help=shared)
    found.add_argument(
        "--theme", choices=("system", *THEMES), default="system", help="colours; else the desktop's"
    )
    return found


def application(theme: str = "system") -> QApplication:
    """Makes the application with the palette that is wanted."""
    app = QApplication.instance() or QApplication(["fcsv_console"])
    if theme in THEMES:
        app.setStyle("Fusion")
        app.setPalette(THEMES[theme]())
    return app


def connected(shell: ConsoleShell, app: QApplication) -> ConsoleWindow:
    """A window that shows what the shell hears, and asks it for what the operator asks for."""
    console = shell.console
    config = bringup() / "rviz/map.rviz"
    window = ConsoleWindow(shell.view(), str(config))
    app.installEventFilter(window.keys)

    def ask(name: str, given: dict) -> None:
        if name == "export":
            export(shell, given["path"])
        else:
            shell.do(name, **given)

    window.asked.connect(ask)
    window.edited.connect(console.edit)
    window.opened.connect(console.load)
    window.goal_changed.connect(console.drag)
    window.goal_turned.connect(lambda index, tilt_deg: console.drag(index, tilt_deg, "tilt_deg"))
    window.planned.connect(lambda wanted: window.mission.plan.show_planned(console.plan(wanted)))
    window.after.changed.connect(shell.name_places)
    window.after.asked.connect(lambda step, places: after(shell, step, places))
    window.timer = QTimer(window)
    window.timer.timeout.connect(lambda: window.show_view(shell.view()))
    window.timer.start(_REFRESH_MS)
    return window


def after(shell: ConsoleShell, step: str, places: Places) -> None:
    """A step of after the flight; the report is opened by the desktop's own browser, if there is
    one."""
    if step == REPORT:
        page = report_of(places).resolve()
        shell.report_opened(page, QDesktopServices.openUrl(QUrl.fromLocalFile(str(page))))
    else:
        shell.after(step, places)


def export(shell: ConsoleShell, path: str) -> None:
    """All events as a table; what became of it is an event too."""
    number = shell.console.ask(time.monotonic(), "export", f"export events to {path}")
    try:
        Path(path).write_text(shell.console.log.as_csv())
        shell.console.answer(number, "written", True)
    except OSError as error:
        shell.console.answer(number, f"not written: {error.strerror}", False)
