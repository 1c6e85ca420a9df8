# SPDX-License-Identifier: Apache-2.0
"""An end that leaves nothing behind, on SIGTERM and Ctrl-C, too: no process, no namespace, no
device, no folder."""

import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager, suppress
from typing import Iterator, List

import psutil

from fcsv_geometry.programs.interruption import leave_it, raise_again

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_END_S = 30.0
_NAME = re.compile(r"fcsv-.+-(\d+)")


@contextmanager
def clean_end() -> Iterator[None]:
    """A signal ends the block as an error would, so that everything in it closes; a second one does
    not hinder that.

    What a signal in the middle of a constructor left open is swept away last, also a process that
    nobody knows of as the signal came while it was made; and, before the beginning, what a run that
    was killed left.
    """
    sweep()
    raise_again(SystemExit)
    for number in SIGNALS:
        signal.signal(number, _end)
    try:
        yield
    finally:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        leave_it()
        _end_all(psutil.Process().children(recursive=True))
        sweep()


def sweep() -> List[str]:
    """Remove the namespaces of this process, and of those that are no more, with what runs in them;
    their names."""
    listed = subprocess.run(
        ["ip", "netns", "list"], capture_output=True, text=True
    ).stdout.splitlines()
    names = [line.split()[0] for line in listed if line and _is_over(line.split()[0])]
    for name in names:
        _end_all(processes_in(name))
        subprocess.run(["ip", "netns", "del", name], capture_output=True)
    return names


def processes_in(namespace: str) -> List[psutil.Process]:
    """What runs in a network namespace."""
    found = []
    for pid in subprocess.run(
        ["ip", "netns", "pids", namespace], capture_output=True, text=True
    ).stdout.split():
        with suppress(psutil.NoSuchProcess):  # it ended meanwhile
            found.append(psutil.Process(int(pid)))
    return found


def _end_all(processes: List[psutil.Process]) -> None:
    """They are no more when this returns: one that is killed may take its time on a busy
    machine."""
    for process in processes:
        with suppress(psutil.NoSuchProcess):  # it ended meanwhile
            process.kill()
    psutil.wait_procs(processes, _END_S)


def _is_over(namespace: str) -> bool:
    owner = _NAME.fullmatch(namespace)
    return owner is not None and (
        int(owner[1]) == os.getpid() or not psutil.pid_exists(int(owner[1]))
    )


def _end(number: int, _frame) -> None:
    for other in SIGNALS:
        signal.signal(other, signal.SIG_IGN)
    print(
        f"stopped by {signal.Signals(number).name}; removing what was started",
        file=sys.stderr,
        flush=True,
    )
    raise SystemExit(128 + number)
