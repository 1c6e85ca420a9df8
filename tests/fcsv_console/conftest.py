# SPDX-License-Identifier: Apache-2.0
"""The window without a screen: one Qt application a process, and no window that outlives its
test."""

import os

import pytest


@pytest.fixture(scope="session")
def app():
    """Kept until the process ends: Qt takes a second application badly."""
    pytest.importorskip("python_qt_binding")
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from fcsv_console.ros.window_command import application

    return application("dark")


@pytest.fixture
def opened(app):
    """opened(console) -> its window at samples.NOW_S, not shown yet; deleted after the test."""
    from fcsv_console.model import samples
    from fcsv_console.qt.window import ConsoleWindow

    windows = []

    def of(console):
        windows.append(ConsoleWindow(console.view(samples.NOW_S)))
        return windows[-1]

    yield of
    for window in windows:
        window.end()
