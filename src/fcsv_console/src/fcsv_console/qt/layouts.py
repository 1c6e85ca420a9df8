# SPDX-License-Identifier: Apache-2.0
"""Parts of a window, stacked."""

from python_qt_binding.QtWidgets import QVBoxLayout, QWidget


def column(*widgets) -> QVBoxLayout:
    """One below the other."""
    layout = QVBoxLayout()
    layout.setSpacing(2)
    for widget in widgets:
        layout.addWidget(widget)
    return layout


def panel(*parts, stretch=None) -> QWidget:
    """Widgets and layouts one below the other; ``stretch`` takes what is left."""
    made = QWidget()
    layout = QVBoxLayout(made)
    layout.setContentsMargins(0, 0, 0, 0)
    layout.setSpacing(4)
    for part in parts:
        if isinstance(part, QWidget):
            layout.addWidget(part, 1 if part is stretch else 0)
        else:
            layout.addLayout(part)
    return made
