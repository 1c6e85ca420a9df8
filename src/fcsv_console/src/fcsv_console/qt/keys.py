# SPDX-License-Identifier: Apache-2.0
"""Every action by key, wherever the focus is; in an editor letters write, and only a held space stops all."""

from typing import Callable, Dict, Optional

from python_qt_binding.QtCore import QEvent, QObject, Qt
from python_qt_binding.QtWidgets import QApplication, QDockWidget, QLineEdit, QPlainTextEdit, QWidget

from fcsv_console.qt.hold import ActionButton

_EDITORS = (QPlainTextEdit, QLineEdit)


class Keys(QObject):
    """An event filter of the application. A key that is held repeats itself: repeats are no presses."""

    def __init__(self, window: QWidget, buttons: Dict[str, ActionButton], others: Dict[int, Callable[[], None]]):
        super().__init__(window)
        self._window, self._others = window, others
        self._by_key = {self.code(b.action.key): b for b in buttons.values()}
        self._held: Optional[ActionButton] = None

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
        button = self._by_key.get(event.key())
        if button is None:
            return self._other(event) if not writes or Qt.Key_F1 <= event.key() <= Qt.Key_F35 else False
        if writes and event.key() != Qt.Key_Space:
            return False
        if not event.isAutoRepeat():
            button.begin() if event.type() == QEvent.KeyPress else button.end()
        return not writes  # an editor gets its blank besides

    def _ours(self, watched) -> bool:
        if not isinstance(watched, QWidget) or watched is not (QApplication.focusWidget() or self._window):
            return False
        top = watched.window()  # a dock that was taken out is a window of its own
        return top is self._window or (isinstance(top, QDockWidget) and top.parent() is self._window)

    def _other(self, event) -> bool:
        call = self._others.get(event.key())
        if call is None:
            return False
        if event.type() == QEvent.KeyPress and not event.isAutoRepeat():
            call()
        return True
