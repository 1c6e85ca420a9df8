# SPDX-License-Identifier: Apache-2.0
"""One child process on a terminal of its own, so that it shows its progress; a thread reads it."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import threading
import time
from typing import Callable, Sequence

_LOOK_S = 0.2
_PATIENCE_S = 3.0  # between TERM and KILL
_SIZE = struct.pack("HHHH", 24, 120, 0, 0)  # of its terminal: where it has none, bars are not drawn
_NICE = ("nice", "-n", "10")  # the flight is served first
_PERCENT = re.compile(r"(\d{1,3})%\|")
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Child:
    """``told`` (share 0..1 or NaN, line) with every line; ``ended`` (exit status, last line) once,
    both by its thread.

    Raises OSError where the program cannot be started.
    """

    def __init__(
        self,
        argv: Sequence[str],
        told: Callable[[float, str], None],
        ended: Callable[[int, str], None],
        cwd: str = "",
    ):
        self._told, self._ended, self.cancelled = told, ended, False
        self._terminal, end = pty.openpty()
        fcntl.ioctl(end, termios.TIOCSWINSZ, _SIZE)
        try:
            self._process = subprocess.Popen(
                [*_NICE, *argv],
                stdin=subprocess.DEVNULL,
                stdout=end,
                stderr=end,
                start_new_session=True,
                cwd=cwd or None,
            )
        except OSError:
            os.close(self._terminal)
            raise
        finally:
            os.close(end)
        self._thread = threading.Thread(target=self._watch, name=f"watches {argv[0]}", daemon=True)
        self._thread.start()

    @property
    def runs(self) -> bool:
        return self._thread.is_alive()

    def cancel(self) -> None:
        """End it and all that it started; returns at once."""
        self.cancelled = True
        self._signal(signal.SIGTERM)

    def wait(self) -> None:
        """Waits until it has ended; killed where it does not end by itself after ``cancel``."""
        self._thread.join(_PATIENCE_S)
        if self.runs and self.cancelled:
            self._signal(signal.SIGKILL)
        self._thread.join()

    def _signal(self, number: int) -> None:
        try:
            os.killpg(self._process.pid, number)
        except ProcessLookupError:
            pass

    def _watch(self) -> None:
        last, rest, told_s = "", "", 0.0
        while True:
            text = self._read()
            lines = re.split(r"[\r\n]+", rest + text)
            rest = lines.pop()
            for line in (_ESCAPES.sub("", li).strip() for li in lines):
                if line:
                    last = line
                    self._told(share_of(line), line)
            if not text and self._process.poll() is not None:
                break
            if self.cancelled:
                told_s = told_s or time.monotonic()
                if time.monotonic() - told_s > _PATIENCE_S:
                    self._signal(signal.SIGKILL)
        os.close(self._terminal)
        self._ended(self._process.returncode, _ESCAPES.sub("", rest).strip() or last)

    def _read(self) -> str:
        try:
            ready, _, _ = select.select([self._terminal], [], [], _LOOK_S)
            return os.read(self._terminal, 65536).decode(errors="replace") if ready else ""
        except OSError:  # nobody holds the other end
            time.sleep(0.0 if self._process.poll() is not None else _LOOK_S)
            return ""


def share_of(line: str) -> float:
    """Reads the share of a progress bar's line, 0..1; NaN: it tells none.

    >>> share_of(" 37%|###7      | 3/8"), share_of("wrote out/map")
    (0.37, nan)
    """
    found = _PERCENT.search(line)
    return min(1.0, int(found.group(1)) / 100.0) if found else float("nan")
