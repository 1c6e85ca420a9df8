# SPDX-License-Identifier: Apache-2.0
"""An error that a signal's handler raises ends the program, also where Python drops errors.

Python runs a handler between any two steps of the main thread, those of callbacks too whose errors
nobody gets: of ``os.register_at_fork`` (logging has one; they run where ``subprocess`` is given a
``preexec_fn``), of finalisers. It tells ``sys.unraisablehook`` of such an error and goes on, as if
nobody had pressed Ctrl-C.
"""

import contextlib
import os
import signal
import socket
import sys
import threading
from typing import Callable, Iterator, Type

_AGAIN_S = 0.05  # by then the callback is over


class Terminated(KeyboardInterrupt):
    """SIGTERM came; whoever cleans up after Ctrl-C does after this, too."""


def raise_again(kind: Type[BaseException]) -> None:
    """Takes care that from now on an error of this ``kind`` that was dropped is raised again in the
    main thread, by SIGALRM."""
    before = sys.unraisablehook

    def on_dropped(dropped) -> None:
        if not isinstance(dropped.exc_value, kind):
            before(dropped)
            return
        error = dropped.exc_value.with_traceback(None)

        def again(_number, _frame) -> None:
            raise error

        signal.signal(signal.SIGALRM, again)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)

    sys.unraisablehook = on_dropped


def leave_it() -> None:
    """What was dropped is not raised any more."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)


@contextlib.contextmanager
def raised_again(kind: Type[BaseException]) -> Iterator[None]:
    """Does as ``raise_again``, until the block is left."""
    before = sys.unraisablehook
    raise_again(kind)
    try:
        yield
    finally:
        leave_it()
        sys.unraisablehook = before


@contextlib.contextmanager
def termination_raised() -> Iterator[None]:
    """SIGTERM in the block raises Terminated, so that what is half written is removed. Nothing of
    this outside the main thread, and where SIGTERM is handled already."""
    is_free = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if threading.current_thread() is not threading.main_thread() or not is_free:
        yield
        return

    def end(_number, _frame) -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextlib.contextmanager
def ended_soon(
    limit_s: float, say: Callable[[], None], give_up: Callable[[], None]
) -> Iterator[None]:
    """Ctrl-C in the block ends the program within ``limit_s``, whatever the main thread does then.

    ``say`` is called at once, by another thread, though the main thread may be in a library that
    does not return for long. The interrupt is raised as ever; where the program has not ended by
    itself after ``limit_s``, or at a second Ctrl-C, ``give_up`` is called, and it ends with status
    130. Nothing of this outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    watch = _InterruptWatch(limit_s, say, give_up)
    before = signal.set_wakeup_fd(watch.fileno(), warn_on_full_buffer=False)
    ends = False
    try:
        yield
    except KeyboardInterrupt:
        ends = watch.pressed()  # else code raised it
        raise
    finally:
        if not ends:  # else what is left of the program must end as well
            signal.set_wakeup_fd(before)
            watch.close()


class _InterruptWatch:
    """A thread that waits for numbers of signals, as Python's own handler writes them."""

    def __init__(self, limit_s: float, say: Callable[[], None], give_up: Callable[[], None]):
        self._limit_s, self._say, self._give_up = limit_s, say, give_up
        self._told, self._tells = socket.socketpair()
        self._tells.setblocking(False)
        self._pressed = threading.Event()
        threading.Thread(target=self._wait, name="watches for Ctrl-C", daemon=True).start()

    def fileno(self) -> int:
        """Where numbers are written to."""
        return self._tells.fileno()

    def pressed(self) -> bool:
        """Whether Ctrl-C was pressed."""
        return self._pressed.wait(_AGAIN_S)

    def close(self) -> None:
        """Ends the thread."""
        self._tells.close()

    def _wait(self) -> None:
        if not self._interrupted():
            return
        self._pressed.set()
        self._say()
        self._told.settimeout(self._limit_s)
        try:
            if not self._interrupted():
                return
        except socket.timeout:
            pass
        self._give_up()
        os._exit(130)

    def _interrupted(self) -> bool:
        """Waits for an interrupt; false where the block was left."""
        while True:
            number = self._told.recv(1)
            if not number or number[0] == signal.SIGINT:
                return bool(number)
