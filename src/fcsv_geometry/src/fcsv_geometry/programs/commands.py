# SPDX-License-Identifier: Apache-2.0
"""How a command ends: its exit status, and one line on stderr where it could not do its work."""

import argparse
import contextlib
import os
import signal
import sys
from typing import Callable, Iterator, List, Optional, Sequence, Tuple, Type

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs.interruption import Terminated, raised_again
from fcsv_geometry.programs.writing import in_words

Action = Callable[[argparse.Namespace], Optional[int]]


@contextlib.contextmanager
def loading(name: str) -> Iterator[None]:
    """While a command imports what it needs, which takes seconds, Ctrl-C ends it with one line and
    status 130.

    Python would print what it was importing, or lose the interrupt where a library catches it.
    """

    def end(*_):
        os.write(2, f"{name}: interrupted; nothing was begun\n".encode())
        os._exit(130)

    before = signal.getsignal(signal.SIGINT)
    # who started this in the background may have it ignored
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def run(
    parser: argparse.ArgumentParser,
    argv: Optional[List[str]],
    action: Action,
    refused: Tuple[Type[Exception], ...] = (FcsvError,),
    left: str = "",
    writes: Sequence[str] = ("out",),
) -> int:
    """The action's exit status; 2 with one line on stderr that says what is wrong, 130 on Ctrl-C,
    143 on SIGTERM where the action raises Terminated.

    ``refused``: errors whose words are that line. ``left``: what a full disk or Ctrl-C leaves,
    behind the line's end. ``writes``: arguments that name where it writes, for errors of the system
    that do not; the first that is given.
    """
    args = parser.parse_args(argv)
    left = f"; {left}" if left else ""
    try:
        with raised_again(KeyboardInterrupt):
            return action(args) or 0
    except refused as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        place = next(filter(None, (getattr(args, name, None) for name in writes)), "")
        print(f"{parser.prog}: {in_words(error, place)}{left}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:
        print(f"{parser.prog}: interrupted{left}", file=sys.stderr)
        return 143 if isinstance(error, Terminated) else 130
