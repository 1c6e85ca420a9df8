# SPDX-License-Identifier: Apache-2.0
"""rviz inside the window, through its Python bindings; made when it is looked at first."""

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtWidgets import QDockWidget, QLabel, QWidget


class RvizDock(QDockWidget):
    """``config``: path of an .rviz file; without bindings or without a master it says so."""

    def __init__(self, config: str, parent=None):
        super().__init__("Map in rviz [F2]", parent)
        self.setAccessibleName("Map in rviz")
        self.setObjectName("rviz")
        self._config, self._frame = config, None  # type: str, Optional[QWidget]
        self.setMinimumSize(320, 240)

    def open(self, master_problem: str) -> None:
        """Show it; what is missing is told in its place."""
        if self._frame is None:
            self.setWidget(self._made(master_problem))
        self.show()

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
        frame.setMenuBar(None)
        frame.setStatusBar(None)
        frame.setHideButtonVisibility(False)
        frame.setAccessibleName("Map in rviz")
        self._frame = frame
        return frame


def _words(text: str) -> QLabel:
    label = QLabel(text)
    label.setAlignment(Qt.AlignCenter)
    label.setWordWrap(True)
    return label
