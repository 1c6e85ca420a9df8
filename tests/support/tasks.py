# SPDX-License-Identifier: Apache-2.0
"""Tasks that workers of other processes can import."""

import os
import signal
import time

from fcsv_stereo.errors import InputError


def square(value):
    """The square; 13 is refused, 99 ends the process as a lack of memory does."""
    if value == 13:
        raise InputError("13 is refused")
    if value == 99:
        os._exit(1)
    return value * value


def write_number(path, value):
    """Leaves a file and this process's number."""
    path.write_text(str(value))
    return os.getpid()


def hang_once(path):
    """Hangs where it runs for the first time."""
    if not path.exists():
        path.write_text("hung")
        time.sleep(600)
    return "done"


def die_once(path):
    """Its process is killed where it runs for the first time."""
    if not path.exists():
        path.write_text("killed")
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def tell(progress):
    """Tells two steps."""
    progress("first", 0.0)
    progress("second", 0.5)


def wait_a_little(path):
    """Leaves a file when it begins, and another as it ends."""
    path.write_text("begun")
    time.sleep(3.0)
    path.with_suffix(".ended").write_text("ended")
