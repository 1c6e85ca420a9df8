# SPDX-License-Identifier: Apache-2.0
"""A screen in memory (Xvfb) and the hands of who sits before it: mouse and keyboard as events of
the X server."""

import os
import select
import subprocess
import time
from pathlib import Path
from typing import Callable, Tuple

from Xlib import XK, X, display
from Xlib.ext import xtest

Point = Tuple[int, int]
_LEFT = 1
_STEPS = 12  # of a drag
_NAMED = {
    " ": "space",
    "/": "slash",
    "_": "underscore",
    "-": "minus",
    ".": "period",
    "=": "equal",
    ":": "colon",
}


class Screen:
    """An X server of its own; ``name`` is what DISPLAY is set to."""

    def __init__(self, folder: Path, size: str = "1366x768x24"):
        read, write = os.pipe()
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", size, "-nolisten", "tcp"]
        with open(folder / "screen.log", "wb") as log:
            self._server = subprocess.Popen(command, pass_fds=[write], stdout=log, stderr=log)
        os.close(write)
        with os.fdopen(read) as told:
            ready, _, _ = select.select([told], [], [], 30.0)
            number = told.readline().strip() if ready else ""  # it comes in pieces
        assert number, (folder / "screen.log").read_text()
        self.name = f":{number}"

    def close(self) -> None:
        self._server.terminate()
        self._server.wait(10.0)


class Hands:
    """``clock``: the time (s) by which a button is held."""

    def __init__(self, screen: Screen, clock: Callable[[], float] = time.monotonic):
        self._display, self.clock = display.Display(screen.name), clock

    def focus(self, window: int) -> None:
        """What a window manager does when a window is opened or clicked on."""
        self._display.create_resource_object("window", window).set_input_focus(
            X.RevertToParent, X.CurrentTime
        )
        self._display.sync()

    def click(self, at: Point) -> None:
        self.hold_mouse(at, 0.0)

    def hold_mouse(self, at: Point, seconds: float) -> None:
        self._move(at)
        self._send(X.ButtonPress, _LEFT)
        self._wait(seconds)
        self._send(X.ButtonRelease, _LEFT)

    def drag(self, begin: Point, end: Point) -> None:
        self._move(begin)
        self._send(X.ButtonPress, _LEFT)
        for k in range(1, _STEPS + 1):
            self._move(tuple(round(a + (b - a) * k / _STEPS) for a, b in zip(begin, end)))
            time.sleep(0.02)
        self._send(X.ButtonRelease, _LEFT)

    def key(self, name: str, seconds: float = 0.0) -> None:
        """By X's name of it: p, F5, Return, space."""
        code = self._display.keysym_to_keycode(XK.string_to_keysym(name))
        self._send(X.KeyPress, code)
        self._wait(seconds)
        self._send(X.KeyRelease, code)

    def write(self, text: str) -> None:
        """On a keyboard of the United States, as Xvfb has it."""
        for letter in text:
            keysym = XK.string_to_keysym(_NAMED.get(letter, letter))
            ((code, index), *_) = sorted(
                self._display.keysym_to_keycodes(keysym), key=lambda found: found[1]
            )
            shift = self._display.keysym_to_keycode(XK.XK_Shift_L) if index & 1 else None
            for kind, number in (
                (X.KeyPress, shift),
                (X.KeyPress, code),
                (X.KeyRelease, code),
                (X.KeyRelease, shift),
            ):
                if number is not None:
                    self._send(kind, number)

    def select_all(self) -> None:
        control = self._display.keysym_to_keycode(XK.XK_Control_L)
        self._send(X.KeyPress, control)
        self.key("a")
        self._send(X.KeyRelease, control)

    def _move(self, at: Point) -> None:
        xtest.fake_input(self._display, X.MotionNotify, x=at[0], y=at[1])
        self._display.sync()

    def _send(self, kind: int, detail: int) -> None:
        xtest.fake_input(self._display, kind, detail)
        self._display.sync()

    def _wait(self, seconds: float) -> None:
        until_s = self.clock() + seconds
        while self.clock() < until_s:
            time.sleep(0.01)

    def close(self) -> None:
        self._display.close()
