# SPDX-License-Identifier: Apache-2.0
"""One survey at a time writes to a folder."""

import contextlib
import errno
import fcntl
import getpass
import json
import logging
import os
import socket
import time
from pathlib import Path
from typing import Iterator, TextIO

from fcsv_stereo.errors import OutputError

LOCK = ".survey.lock"
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
_log = logging.getLogger(__name__)


@contextlib.contextmanager
def alone_in(out: Path) -> Iterator[None]:
    """While the block runs, no other survey writes to ``out``, which is made where it is not there.

    The system gives the lock back where its process dies, however it does. Raises OutputError,
    which says who writes there, and OSError.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / LOCK
    file = _locked(path)
    try:
        json.dump(_who(), file)
        file.flush()
        yield
    finally:
        path.unlink(missing_ok=True)
        file.close()


def _locked(path: Path) -> TextIO:
    """The lock's file, ours and empty."""
    while True:
        file = path.open("a+", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            said = _in_words(file.read())
            file.close()
            raise OutputError(
                f"{path.parent}: another survey writes there ({said}); wait for its end, or give another "
                "folder with -o"
            ) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                file.close()
                raise
            _log.warning(
                "%s: its disk knows no locks; see that no other survey writes there", path.parent
            )
        if _is_at(file, path):
            file.truncate(0)
            return file
        file.close()  # who held it has removed it meanwhile


def _is_at(file: TextIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _who() -> dict:
    try:
        user = getpass.getuser()
    except (KeyError, OSError, ImportError):  # a container's user without a name
        user = str(os.getuid())
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return {"process": os.getpid(), "host": socket.gethostname(), "user": user, "since": since}


def _in_words(text: str) -> str:
    try:
        d = json.loads(text)
        return f"process {d['process']} of {d['user']} on {d['host']}, since {d['since']}"
    except (ValueError, KeyError, TypeError):
        return "it begins just now"
