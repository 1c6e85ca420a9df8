# SPDX-License-Identifier: Apache-2.0
"""rviz inside the window, through its Python bindings; made when it is looked at first."""

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtWidgets import QDockWidget, QLabel, QVBoxLayout, QWidget


class RvizView(QWidget):
    """``config``: path of an .rviz file; without bindings or without a master it says so."""

    def __init__(self, config: str, parent=None):
        super().__init__(parent)
        self.setAccessibleName("Map in rviz")
        self._config, self._inside, self._frame = config, None, None
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)

    def open(self, master_problem: str) -> None:
        """What is missing is told in its place, and looked for again at the next opening."""
        if self._frame is not None:
            return
        if self._inside is not None:
            self._inside.hide()
            self._layout.removeWidget(self._inside)
            self._inside.deleteLater()
        self._inside = self._made(master_problem)
        self._layout.addWidget(self._inside)

    def showEvent(self, event) -> None:
        super().showEvent(event)
        if self._frame is not None:
            self._frame.getManager().startUpdate()

    def hideEvent(self, event) -> None:
        """What nobody sees is not drawn."""
        super().hideEvent(event)
        if self._frame is not None:
            self._frame.getManager().stopUpdate()

    def _made(self, master_problem: str) -> QWidget:
        if master_problem:
            return _words(f"{master_problem}: open it again once it does")
        try:
            from rviz import bindings
        except ImportError as error:
            return _words(f"rviz cannot be embedded: {error}")
        frame = bindings.VisualizationFrame()
        frame.setSplashPath("")
        frame.initialize()
        reader, config = bindings.YamlConfigReader(), bindings.Config()
        reader.readFile(config, self._config)
        frame.load(config)
        for dock in frame.findChildren(QDockWidget):  # displays and cameras would take all room
            dock.hide()
        frame.setMenuBar(None)
        frame.setStatusBar(None)
        frame.setAccessibleName("Map in rviz")
        self._frame = frame
        return frame


def _words(text: str) -> QLabel:
    label = QLabel(text)
    label.setAlignment(Qt.AlignCenter)
    label.setWordWrap(True)
    return label
