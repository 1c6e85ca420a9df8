# SPDX-License-Identifier: Apache-2.0
"""Every action by key, wherever the focus is; in an editor letters write, and only a held space
stops all."""

from typing import Callable, Dict, Optional

from python_qt_binding.QtCore import QEvent, QObject, Qt, QTimer
from python_qt_binding.QtWidgets import (
    QApplication,
    QDockWidget,
    QLineEdit,
    QPlainTextEdit,
    QWidget,
)

from fcsv_console.qt.hold import ActionButton

_EDITORS = (QPlainTextEdit, QLineEdit)
TAKES_ENTER = "takes_enter"  # property of a widget in which Enter chooses
_REPEAT_MS = 60  # a release that is followed by a press so soon was the key's own repetition


class KeyFilter(QObject):
    """An event filter of the application. A key that is held repeats itself: repeats are no
    presses, and the releases before them, which Qt takes for real ones where the window is late, do
    not let go of a button."""

    def __init__(
        self,
        window: QWidget,
        buttons: Dict[str, ActionButton],
        others: Dict[int, Callable[[], None]],
    ):
        super().__init__(window)
        self._window, self._others = window, others
        self._by_key = {self.code(b.action.key): b for b in buttons.values()}
        self._let_go: Optional[ActionButton] = None
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._end)

    @staticmethod
    def code(key: str) -> int:
        """Qt's number of a key as actions.TABLE names it."""
        return Qt.Key_Space if key == "Space" else getattr(Qt, f"Key_{key}")

    def eventFilter(self, watched, event) -> bool:
        if event.type() not in (QEvent.KeyPress, QEvent.KeyRelease) or not self._ours(watched):
            return False
        writes = isinstance(watched, _EDITORS)
        if event.modifiers() & (Qt.ControlModifier | Qt.AltModifier | Qt.MetaModifier):
            return False
        if event.key() in (Qt.Key_Return, Qt.Key_Enter) and watched.property(TAKES_ENTER):
            return False
        button = self._by_key.get(event.key())
        if button is None:
            return (
                self._other(event)
                if not writes or Qt.Key_F1 <= event.key() <= Qt.Key_F35
                else False
            )
        if writes and event.key() != Qt.Key_Space:
            return False
        if event.type() == QEvent.KeyPress:
            self._pressed(button, event.isAutoRepeat())
        elif not event.isAutoRepeat():
            self._released(button)
        return not writes  # an editor gets its blank besides

    def _pressed(self, button: ActionButton, repeats: bool) -> None:
        if self._let_go is button:
            self._let_go = None
            self._timer.stop()
            button.still_held()
        elif not repeats:
            button.begin()

    def _released(self, button: ActionButton) -> None:
        if self._let_go not in (None, button):
            self._end()
        button.let_go()
        self._let_go = button
        self._timer.start(_REPEAT_MS)

    def _end(self) -> None:
        button, self._let_go = self._let_go, None
        if button is not None:
            button.end()

    def _ours(self, watched) -> bool:
        if not isinstance(watched, QWidget) or watched is not (
            QApplication.focusWidget() or self._window
        ):
            return False
        top = watched.window()  # a dock that was taken out is a window of its own
        return top is self._window or (
            isinstance(top, QDockWidget) and top.parent() is self._window
        )

    def _other(self, event) -> bool:
        call = self._others.get(event.key())
        if call is None:
            return False
        if event.type() == QEvent.KeyPress and not event.isAutoRepeat():
            call()
        return True
