# SPDX-License-Identifier: Apache-2.0
"""The operator's window as a process on a screen: looked at by the names that a screen reader would
read, and handled by mouse and keys.

Run as a program this is that process: the console's own, and a thread that answers where things
stand and what they say. It touches nothing.
"""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

from support.waiting import within

_TESTS = Path(__file__).resolve().parents[1]
BUTTON, FIELD, LABEL, TABLE, BAR = (
    "QPushButton",
    "QLineEdit",
    "QLabel",
    "QTableWidget",
    "QProgressBar",
)


class Window:
    """``hands`` are of its screen; ``env``: of the process. Waiting is in real time."""

    def __init__(self, hands, env: Dict[str, str], log: Path, *args: str):
        self.hands, self._log = hands, log
        self._process = subprocess.Popen(
            [sys.executable, "-m", "support.console_window", *args],
            env={**env, "PYTHONPATH": f"{_TESTS}:{env.get('PYTHONPATH', '')}"},
            stdin=subprocess.PIPE,
            text=True,
            stdout=subprocess.PIPE,
            stderr=open(log, "ab"),
            bufsize=1,
        )
        self.until(lambda: self.ask(what="shown"), "the window is shown", 90.0)
        hands.focus(self.ask(what="id"))

    def ask(self, **question) -> Any:
        """What the window answers; AssertionError where it is no more."""
        try:
            self._process.stdin.write(json.dumps(question) + "\n")
            line = self._process.stdout.readline()
        except OSError:
            line = ""
        assert line, f"the window ended ({self._process.poll()}):\n{self.said()}"
        return json.loads(line)

    def said(self) -> str:
        return self._log.read_text(errors="replace")[-3000:]

    # ---- what is seen ----------------------------------------------------------------------------

    def find(self, name: str, kind: str = BUTTON) -> Optional[dict]:
        """{"at": middle on the screen, "on": enabled, "text", "why": tooltip, "described": for a
        screen reader} of what is visible; None: nothing is."""
        return self.ask(what="control", name=name, kind=kind)

    def text(self, name: str, kind: str = LABEL) -> str:
        found = self.find(name, kind)
        return found["text"] if found else ""

    def enabled(self, name: str, kind: str = BUTTON) -> bool:
        """Whether it is shown and can be clicked; what is opened by a key is shown later."""
        found = self.find(name, kind)
        return bool(found and found["on"])

    def rows(self, name: str) -> List[List[str]]:
        return self.ask(what="rows", name=name)

    def of_vehicle(self, label: str) -> List[str]:
        """The cells of one line of the vehicles' table."""
        return next(row[1:] for row in self.rows("Vehicles") if row[0] == label)

    # ---- what is done ----------------------------------------------------------------------------

    def click(self, name: str, kind: str = BUTTON, seconds: float = 0.0) -> None:
        """Once it can be."""
        self.until(lambda: self.enabled(name, kind), f"'{name}' can be clicked")
        self.hands.hold_mouse(self.find(name, kind)["at"], seconds)

    def key(self, name: str, seconds: float = 0.0) -> None:
        """Into this window, or into the dialog that it opened."""
        self.hands.focus(self.ask(what="id"))
        self.hands.key(name, seconds)

    def choose(self, table: str, row: int) -> None:
        self.hands.click(self.ask(what="cell", name=table, row=row))

    def write(self, name: str, text: str) -> None:
        """In place of what stands in a field."""
        self.click(name, FIELD)
        self.hands.select_all()
        self.hands.write(text)
        self.until(lambda: self.text(name, FIELD) == text, f"'{text}' stands in '{name}'")

    def until(self, condition: Callable[[], Any], what: str, limit_s: float = 30.0) -> None:
        within(limit_s)(condition, what=lambda: f"{what}:\n{self.said()}", every_s=0.1)

    def picture(self, path: Path) -> None:
        self.ask(what="picture", path=str(path))

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def close(self) -> int:
        """Told to end: its exit status."""
        self._process.terminate()
        return self._process.wait(30.0)


# ---- in the process of the window ----------------------------------------------------------------


def _answer(window, question: dict) -> Any:
    from python_qt_binding import QtCore, QtWidgets

    def middle(widget, rect) -> Tuple[int, int]:
        at = widget.mapToGlobal(rect.center())
        return at.x(), at.y()

    def named(name: str, kind: str):
        found = (
            w for w in window.findChildren(getattr(QtWidgets, kind)) if w.accessibleName() == name
        )
        return next((w for w in found if w.isVisible()), None)

    what = question["what"]
    if what == "shown":
        return window.isVisible()
    if what == "id":
        return int((QtWidgets.QApplication.activeModalWidget() or window).winId())
    dialog = QtWidgets.QApplication.activeModalWidget()
    if what == "dialog":
        return (
            dialog is not None
            and dialog.windowHandle() is not None
            and dialog.windowHandle().isExposed()
        )
    if what == "typed in a dialog":
        field = QtWidgets.QApplication.focusWidget()
        return (
            field.text()
            if isinstance(field, QtWidgets.QLineEdit) and field.window() == dialog
            else None
        )
    if what == "picture":  # of the screen: with what is opened above the window
        return QtWidgets.QApplication.primaryScreen().grabWindow(0).save(question["path"])
    if what == "place":
        plan = window.plan
        at = plan.mapToGlobal(
            QtCore.QPoint(*(round(v) for v in plan.scale.to_px(*question["home_m"])))
        )
        return at.x(), at.y()
    widget = named(question["name"], question.get("kind", TABLE))
    if what == "rows":
        cells = [
            [widget.item(i, k) for k in range(widget.columnCount())]
            for i in range(widget.rowCount())
        ]
        return [[item.text() if item else "" for item in row] for row in cells]
    if what == "cell":
        item = widget.item(question["row"], 0)
        widget.scrollToItem(item)
        return middle(widget.viewport(), widget.visualItemRect(item))
    if widget is None:
        return None
    text = widget.value() if isinstance(widget, QtWidgets.QProgressBar) else widget.text()
    return {
        "at": middle(widget, widget.rect()),
        "on": widget.isEnabled(),
        "text": text,
        "why": widget.toolTip(),
        "described": widget.accessibleDescription(),
    }


def main() -> int:
    """The console, and a thread that reads questions and writes answers, each a line of JSON."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what else is printed goes to the log
    from python_qt_binding import QtCore

    from fcsv_console.ros import window_command

    class Witness(QtCore.QObject):
        asked = QtCore.Signal(str)

    def watch(window) -> None:
        witness = window.witness = Witness(window)
        witness.asked.connect(
            lambda line: answers.write(json.dumps(_answer(window, json.loads(line))) + "\n")
        )
        read = lambda: [witness.asked.emit(line) for line in sys.stdin]  # noqa: E731
        threading.Thread(target=read, daemon=True).start()

    connected = window_command.connected

    def watched(shell, app):
        window = connected(shell, app)
        QtCore.QTimer.singleShot(0, lambda: watch(window))
        return window

    window_command.connected = watched
    return window_command.main(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
