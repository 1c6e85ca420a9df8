# SPDX-License-Identifier: Apache-2.0
"""A button of an action: a click, or held for so long; its reason in the tooltip; the key does the
same."""

import time
from typing import Optional

from python_qt_binding.QtCore import QRectF, QTimer, Signal
from python_qt_binding.QtGui import QColor, QPainter
from python_qt_binding.QtWidgets import QPushButton

from fcsv_console.model.actions import Action

_PAINT_MS = 33
_LONG = 11  # letters of a title for which a button of the row has no room
_NEXT = "background-color: #005A8C; color: white; border: 2px solid #56B4E9; border-radius: 5px; padding: 2px"


class ActionButton(QPushButton):
    """Emits ``asked`` with the action's name. Begin and end of holding come from mouse and keys
    alike."""

    asked = Signal(str)

    def __init__(self, action: Action, parent=None):
        super().__init__(action.title, parent)
        self.action = action
        self._since_s: Optional[float] = None
        self._let_go_s: Optional[float] = None
        font = self.font()
        font.setPointSizeF(0.84 * font.pointSizeF())  # twelve of them stand in 960 px
        self.setFont(font)
        self._is_next = False
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._tick)
        self.pressed.connect(self.begin)
        self.released.connect(self.end)
        self.show_action(action)

    def show_action(self, action: Action) -> None:
        """Enabled or not, and why not."""
        self.action = action
        if self.isEnabled() != action.enabled:
            self.setEnabled(action.enabled)
        if self.toolTip() != action.tooltip:
            self.setToolTip(action.tooltip)
            self.setStatusTip(action.tooltip.replace("\n", " "))
            hold = f" {action.hold_s:g} s" if action.hold_s else ""
            first, _, rest = action.title.partition(" ")
            of_two_words = len(action.title) > _LONG  # its second word stands beside the key
            name = f"{first}\n{rest} " if of_two_words else f"{action.title}\n"
            self.setText(f"{name}[{action.key}{hold}]")
            self.setAccessibleName(action.title)
            self.setAccessibleDescription(action.tooltip)
        if not action.enabled:
            self.end()

    def stand_out(self, is_next: bool) -> None:
        """It is the one to press next."""
        if is_next != self._is_next:
            self._is_next = is_next
            stand_out(self, is_next)

    def begin(self) -> None:
        """Mouse or key went down."""
        if not self.action.enabled or self._since_s is not None:
            return
        self._let_go_s = None
        if not self.action.hold_s:
            self.asked.emit(self.action.name)
            return
        self._since_s = time.monotonic()
        self._timer.start(_PAINT_MS)

    def let_go(self) -> None:
        """Perhaps let go of, now: ``still_held`` takes it back, ``end`` makes it so."""
        self._let_go_s = time.monotonic()

    def still_held(self) -> None:
        """The key only repeated itself."""
        self._let_go_s = None

    def end(self) -> None:
        """It was let go of; too early is nothing."""
        self._tick()
        self._since_s = self._let_go_s = None
        self._timer.stop()
        self.update()

    @property
    def share(self) -> float:
        """How much of the time it was held, 0..1."""
        if self._since_s is None:
            return 0.0
        until_s = time.monotonic() if self._let_go_s is None else self._let_go_s
        return min(1.0, (until_s - self._since_s) / self.action.hold_s)

    def _tick(self) -> None:
        if self._since_s is not None and self.share >= 1.0:
            self._since_s = None
            self._timer.stop()
            self.asked.emit(self.action.name)
        self.update()

    def paintEvent(self, event) -> None:
        super().paintEvent(event)
        if self._since_s is not None:
            painter = QPainter(self)
            bar = QRectF(2.0, self.height() - 7.0, (self.width() - 4.0) * self.share, 5.0)
            painter.fillRect(
                bar, QColor("#ffffff") if self.action.name == "stop_all" else QColor("#E69F00")
            )


def stand_out(button: QPushButton, is_next: bool) -> None:
    """Paints the button in the colour of what is well, with a frame: it is what comes next. A
    screen reader is told, too."""
    if bool(button.property("next")) == is_next:
        return
    button.setProperty("next", is_next)
    button.setStyleSheet(f"QPushButton {{ {_NEXT} }}" if is_next else "")
