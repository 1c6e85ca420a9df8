# SPDX-License-Identifier: Apache-2.0
"""Parts of a window, stacked."""

from typing import Sequence

from python_qt_binding.QtWidgets import QFrame, QHBoxLayout, QVBoxLayout, QWidget


def column(*widgets) -> QVBoxLayout:
    """One below the other."""
    layout = QVBoxLayout()
    layout.setSpacing(2)
    for widget in widgets:
        layout.addWidget(widget)
    return layout


def in_groups(groups: Sequence[Sequence[QWidget]]) -> QHBoxLayout:
    """Side by side, a rule between groups; narrower than their own hints, so that 960 px are
    enough."""
    line = QHBoxLayout()
    line.setSpacing(4)
    for k, group in enumerate(groups):
        if k:
            rule = QFrame()
            rule.setFrameShape(QFrame.VLine)
            line.addWidget(rule)
        for widget in group:
            widget.setMinimumSize(64, 40)
            line.addWidget(widget, 1)
    return line


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
