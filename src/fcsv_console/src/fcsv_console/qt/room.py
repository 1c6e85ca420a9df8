# SPDX-License-Identifier: Apache-2.0
"""Room for what is opened below: where the window is too low for both, it stands in place of the
panels."""

from typing import Sequence

from python_qt_binding.QtCore import QEvent, QObject, Qt, QTimer
from python_qt_binding.QtWidgets import QDockWidget, QMainWindow, QWidget

_SEPARATOR_PX = 8


class Room(QObject):
    """``panels`` hide while a dock is open and the window is too low for both; all else in the
    window stays."""

    def __init__(self, window: QMainWindow, panels: QWidget, docks: Sequence[QDockWidget]):
        super().__init__(window)
        self._window, self._panels, self._docks = window, panels, list(docks)
        window.installEventFilter(self)
        for dock in self._docks:
            dock.visibilityChanged.connect(lambda _shown: self.share())
            dock.topLevelChanged.connect(lambda _out: self.share())

    def eventFilter(self, _watched, event) -> bool:
        if event.type() == QEvent.Resize:
            self.share()
        return False

    def share(self) -> None:
        """Sets the share of the window's height as it is now."""
        docks = [d for d in self._docks if not d.isHidden() and not d.isFloating()]
        fits = not docks or self._needed_px(docks) <= self._window.height()
        if fits != self._panels.isHidden():
            return
        self._panels.setVisible(fits)
        if not fits:
            QTimer.singleShot(0, lambda: self._fill(docks))

    def _needed_px(self, docks: Sequence[QDockWidget]) -> int:
        whole = self._window.centralWidget().layout()
        height = whole.minimumSize().height()
        if self._panels.isHidden():
            height += self._panels.minimumSizeHint().height() + whole.spacing()
        return height + max(d.minimumSizeHint().height() for d in docks) + _SEPARATOR_PX

    def _fill(self, docks: Sequence[QDockWidget]) -> None:
        self._window.resizeDocks(docks, [self._window.height()] * len(docks), Qt.Vertical)
