# SPDX-License-Identifier: Apache-2.0
"""An error that a signal's handler raises ends the program, also where Python drops errors.

Python runs a handler between any two steps of the main thread, those of callbacks too whose errors
nobody gets: of ``os.register_at_fork`` (logging has one; they run where ``subprocess`` is given a
``preexec_fn``), of finalisers. It tells ``sys.unraisablehook`` of such an error and goes on, as if
nobody had pressed Ctrl-C.
"""

import contextlib
import signal
import sys
from typing import Iterator, Type

_AGAIN_S = 0.05  # by then the callback is over


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
