# SPDX-License-Identifier: Apache-2.0
"""One line that shows what a long command does now, below the lines that it has printed.

On a terminal it changes in place. Elsewhere it is printed every quarter of a minute, so that a log
grows and nobody thinks that the command hangs.
"""

import contextlib
import shutil
import sys
import threading
import time
from typing import Callable, Iterator, Optional, TextIO

from tqdm import tqdm

IN_PLACE_S, LOGGED_S = 0.5, 15.0  # how often the line is renewed: on a terminal, elsewhere
_ERASE = "\r\x1b[K"


class LiveLine:
    """Prints lines, and one status below them. Several threads may use it at once.

    ``clock`` gives monotonic time, s. ``terminal``: whether ``out`` can change a line in place;
    None: ask ``out``.
    """

    def __init__(
        self,
        out: Optional[TextIO] = None,
        clock: Callable[[], float] = time.monotonic,
        terminal: Optional[bool] = None,
    ):
        self._out = sys.stdout if out is None else out
        self._clock = clock
        self._terminal = self._out.isatty() if terminal is None else terminal
        self._lock = threading.RLock()
        self._shown = False
        self._written_s = clock()

    def say(self, line: str) -> None:
        """Prints a line that stays."""
        with self._lock:
            before = _ERASE if self._shown else ""
            self._shown = False
            self._write(f"{before}{line}\n")

    def status(self, line: str) -> None:
        """Shows what goes on now; it may be called as often as you like."""
        with self._lock:
            since_s = self._clock() - self._written_s
            if not self._terminal:
                if since_s >= LOGGED_S:
                    self.say(line)
            elif since_s >= IN_PLACE_S or not self._shown:
                self._write(_ERASE + line[: shutil.get_terminal_size().columns - 1])
                self._shown = True

    def clear(self) -> None:
        """Removes the status, so that others may print."""
        with self._lock:
            if self._shown:
                self._write(_ERASE)
                self._shown = False

    def _write(self, text: str) -> None:
        self._out.write(text)
        self._out.flush()
        self._written_s = self._clock()


@contextlib.contextmanager
def renewed(show: Callable[[], None]) -> Iterator[None]:
    """While the body runs, a thread shows anew every half a second, however busy the body is."""
    ended = threading.Event()

    def renew() -> None:
        while not ended.wait(IN_PLACE_S):
            show()

    thread = threading.Thread(target=renew, name="renewed line", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


class Counter:
    """A bar of what is done on a terminal, a line from time to time elsewhere; to standard error.

    ``unit``: of the bar; ``words`` follow the numbers of the line. A thread renews both, so that the
    time goes on where nothing is done for long.
    """

    def __init__(self, total: int, unit: str, words: str):
        self._total, self._words, self._live = total, words, LiveLine(sys.stderr)
        self._terminal = sys.stderr.isatty()
        # a terminal that does not tell its size gets no bar otherwise
        ncols, nrows = shutil.get_terminal_size()
        self._bar = tqdm(
            total=total, unit=unit, disable=not self._terminal, ncols=ncols, nrows=nrows
        )
        self._done, self._renewed = 0, contextlib.ExitStack()
        self._renewed.enter_context(renewed(self._renew))

    def show(self, done: int) -> None:
        """So many of ``total`` are done; it may be called as often as you like."""
        self._done = done
        if self._terminal and done > self._bar.n:
            self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Leaves the bar as it is, with the last number."""
        self._renewed.close()
        self._renew()
        self._bar.close()

    def _renew(self) -> None:
        if self._terminal:
            self._bar.refresh()
        else:
            self._live.status(f"{self._done} of {self._total} {self._words}")


class Steps:
    """The steps of a command, of which the newest is shown with the time since the command
    began."""

    def __init__(self, live: LiveLine, first: str, clock: Callable[[], float] = time.monotonic):
        self._live, self._clock, self._began_s = live, clock, clock()
        self._step = first, 0.0

    def begin(self, step: str, share: float) -> None:
        """Another step begins; ``share`` of the work, 0 to 1, is behind it."""
        self._step = step, share

    def show(self) -> None:
        """Renews the line; the window reads the share as it reads that of a progress bar."""
        step, share = self._step
        self._live.status(f"{share:4.0%}| {step}, {self._clock() - self._began_s:.0f} s")

    @contextlib.contextmanager
    def shown(self) -> Iterator["Steps"]:
        """While the body runs, the line is renewed."""
        try:
            with renewed(self.show):
                yield self
        finally:
            self._live.clear()
